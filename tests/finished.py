"""Finished work that several tests look at: made once in a test run, whatever process asks first."""

from __future__ import annotations

import copyreg
import fcntl
import os
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import pytest

if TYPE_CHECKING:
    from scaling_service.capabilities.scaling.result import Results
    from scaling_service.documents.results import TruthDocument

Made = TypeVar("Made")


def freeze(held: dict[object, object]) -> MappingProxyType[object, object]:
    """A mapping that nobody changes: by this name, as pickle does not find the type's own."""
    return MappingProxyType(held)


copyreg.pickle(MappingProxyType, lambda proxy: (freeze, (dict(proxy),)))  # type: ignore[arg-type]


class Demo(NamedTuple):
    """What ``demo`` computes, and what its progress was told."""

    results: Results
    truth: TruthDocument
    shares: list[tuple[str, float]]


@contextmanager
def hold(factory: pytest.TempPathFactory, name: str) -> Iterator[Path]:
    """A place that all processes of this run share, for one of them at a time."""
    base = factory.getbasetemp()
    home = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "finished"
    home.mkdir(exist_ok=True)
    with (home / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield home / name


def make_once(factory: pytest.TempPathFactory, name: str, make: Callable[[], Made]) -> Made:
    """What ``make`` gives; each process reads a copy of its own. ``name``: one for each thing made."""
    with hold(factory, name) as place:
        if not place.is_file():
            content = pickle.dumps(make())
            place.write_bytes(content)
        found: Made = pickle.loads(place.read_bytes())
        return found


def fill_once(factory: pytest.TempPathFactory, name: str, fill: Callable[[Path], object]) -> Path:
    """A folder that ``fill`` wrote, to be read only. ``name``: one for each folder."""
    with hold(factory, name) as place:
        if not (place / ".finished").is_file():
            place.mkdir(exist_ok=True)
            fill(place)
            (place / ".finished").touch()
        return place
