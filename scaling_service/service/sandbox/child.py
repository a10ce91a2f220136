"""The process that computes: it limits itself, makes one call, and answers in lines of JSON."""

from __future__ import annotations

import errno
import json
import os
import signal
import tempfile
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scaling_service.core.errors import InputError
from scaling_service.documents.jobs import Failure
from scaling_service.service.jobs.outcomes import failure_of
from scaling_service.service.sandbox import lifeline, limits

RESULT = "result.json"
SECRETS = "SCALING_SERVICE_"
"""Environment variables that begin so are for the service, not for what parses foreign bytes."""

_NICENESS = 10
"""Chosen: a computation gives way to whoever answers requests on the same processors."""

_HINDRANCES = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.ESTALE)
_LONGEST = 2000
"""Characters of a text in a message. Chosen: a message must fit the pipe's buffer whole."""

Progress = Callable[[str, float], None]
Work = Callable[[Path, Progress], Any]
"""What a child computes: folder of the attempt, progress -> a result that is JSON-ready."""


@dataclass(frozen=True, slots=True)
class Child:
    """A call that a process of its own makes.

    Parameters
    ----------
    work : callable
    folder : Path
        Of the attempt; it has ``outputs`` and ``tmp``.
    limits : Limits
    """

    work: Work
    folder: Path
    limits: limits.Limits

    def __call__(self, messages: int, line: int) -> None:
        """Do the work and end this process with everything that it started."""
        os.setsid()
        os.nice(_NICENESS)
        lifeline.bind(line)
        _alone_in(self.folder)
        limits.apply(self.limits)
        _tell(messages, self._answer(lambda what, share: _tell(messages, {"progress": [what[:200], share]})))
        os.killpg(os.getpgrp(), signal.SIGKILL)

    def _answer(self, progress: Progress) -> dict[str, Any]:
        try:
            result = self.work(self.folder, progress)
            text = json.dumps(result, ensure_ascii=False, allow_nan=False)
            (self.folder / RESULT).write_text(text, encoding="utf-8")
        except BaseException as error:  # noqa: BLE001 (whatever it is, it is the answer)
            return _explained(error, self.folder, self.limits)
        return {"finished": True}


def _explained(error: BaseException, folder: Path, bounds: limits.Limits) -> dict[str, Any]:
    for cause in _chain(error):
        number = cause.errno if isinstance(cause, OSError) else None
        if number in _HINDRANCES:
            return {"hindered": os.strerror(number or 0)}
        if number == errno.EFBIG:
            return _failed(limits.too_large_file(bounds), folder)
        if number == errno.ENOMEM or (isinstance(cause, MemoryError) and not isinstance(error, InputError)):
            return _failed(limits.out_of_memory(bounds), folder)
    if isinstance(error, InputError):
        return _failed(error, folder)
    unexpected = Failure(
        kind="ProgramError",
        problem=f"the program failed on this job ({type(error).__name__})",
        remedy="Report it with the number of the job; the service's log says where it happened",
    )
    return {"failure": unexpected.model_dump(), "trace": _places(error)}


def _chain(error: BaseException) -> Iterator[BaseException]:
    """An error and what it came from."""
    seen: BaseException | None = error
    while seen is not None:
        yield seen
        seen = seen.__cause__ or seen.__context__


def _failed(error: InputError, folder: Path) -> dict[str, Any]:
    told = failure_of(error).model_dump()
    return {"failure": {k: None if v is None else _plain(v, folder)[:_LONGEST] for k, v in told.items()}}


def _plain(text: str, folder: Path) -> str:
    """A text without the places on this machine, which mean nothing to a client."""
    for place in (folder / "inputs", folder / "outputs", folder):
        text = text.replace(f"{place}/", "").replace(str(place), "")
    return text


def _places(error: BaseException) -> str:
    """Where it broke: lines of code only, for a message may hold what stands in a patient's file."""
    lines = [f"{f.filename}:{f.lineno} {f.name}" for f in traceback.extract_tb(error.__traceback__)]
    return " < ".join(reversed(lines))[:_LONGEST]


def _alone_in(folder: Path) -> None:
    """Be quiet, know no secrets, and keep everything temporary in the attempt's folder."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in range(3):
        os.dup2(nowhere, descriptor)
    os.close(nowhere)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in [name for name in os.environ if name.startswith(SECRETS)]:
        del os.environ[name]
    os.environ["TMPDIR"] = tempfile.tempdir = str(folder / "tmp")
    os.chdir(folder / "tmp")


def _tell(pipe: int, message: dict[str, Any]) -> None:
    content = (json.dumps(message) + "\n").encode()
    while content:
        content = content[os.write(pipe, content) :]
