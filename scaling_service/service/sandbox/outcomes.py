"""How an attempt ended, as plain values that travel between processes and machines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

from scaling_service.core.errors import InputError
from scaling_service.documents.jobs import Failure


@dataclass(frozen=True, slots=True)
class Finished:
    """There is a result, JSON-ready, with path, SHA-256 and size of each file, all safely on disk."""

    result: Any
    files: tuple[tuple[str, str, int], ...] = ()
    host: str = ""


@dataclass(frozen=True, slots=True)
class Failed:
    """There is none, and this is why; trying again would end the same way."""

    failure: Failure
    trace: str = ""  # where the program broke, for the log: places in the code, never values

    @classmethod
    def of(cls, error: InputError) -> Failed:
        """By an error that a user can act on."""
        return cls(make_failure(error))


@dataclass(frozen=True, slots=True)
class Lost:
    """It ended by no fault of its own: killed from outside, or the machine's disk is full. Another may do."""

    reason: str


@dataclass(frozen=True, slots=True)
class Stopped:
    """It was stopped because that was asked for."""


Outcome: TypeAlias = Finished | Failed | Lost | Stopped


def make_failure(error: InputError) -> Failure:
    """An error that a user can act on, as it travels."""
    fields = {name: getattr(error, name) for name in ("problem", "file", "field", "remedy")}
    return Failure(kind=type(error).__name__, **fields)
