"""The process that computes: it limits itself, makes one call, and answers in lines of JSON."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import select
import signal
import tempfile
import traceback
from collections import abc
from dataclasses import dataclass
from itertools import pairwise
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from scaling_service.core.errors import InputError
from scaling_service.documents.jobs import Failure
from scaling_service.service.sandbox.limits import Limits
from scaling_service.service.sandbox.outcomes import make_failure

RESULT = "result.json"
SECRETS = "SCALING_SERVICE_"
"""Environment variables that begin so are for the service, not for what parses foreign bytes."""

_HINDRANCES = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.ESTALE)
_LONGEST = 2000  # characters of a text in a message. Chosen: a message must fit the pipe's buffer whole.

Progress = abc.Callable[[str, float], None]
Work = abc.Callable[[Path, Progress], Any]
"""What a child computes: folder of the attempt, progress -> a result that is JSON-ready."""


@dataclass(frozen=True, slots=True)
class Child:
    """A call that a process of its own makes, in an attempt's folder with ``outputs`` and ``tmp``."""

    work: Work
    folder: Path
    limits: Limits

    def __call__(self, messages: Connection) -> None:
        """Do the work and end this process with everything that it started."""
        os.setsid()
        pipe, parent = messages.fileno(), parent_process()
        assert parent is not None
        # Have the kernel kill this process group when the writing end of a pipe closes. No thread of ours
        # has to run for that, so it also ends a process that is stuck in a library: SIGKILL is sent in
        # place of SIGIO (fcntl(2), "Signal-driven I/O").
        fcntl.fcntl(parent.sentinel, fcntl.F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(parent.sentinel, fcntl.F_SETOWN, -os.getpgrp())
        fcntl.fcntl(parent.sentinel, fcntl.F_SETFL, fcntl.fcntl(parent.sentinel, fcntl.F_GETFL) | os.O_ASYNC)
        watch = select.poll()
        watch.register(parent.sentinel, select.POLLHUP)
        if watch.poll(0):  # it was closed before the kernel was asked
            os.killpg(os.getpgrp(), signal.SIGKILL)
        # Be quiet, know no secrets, hold these pipes only, and keep everything temporary in the folder
        pipes = {pipe, parent.sentinel}
        nowhere = os.open(os.devnull, os.O_RDWR)
        for descriptor in range(3):
            os.dup2(nowhere, descriptor)
        ends = [2, *sorted(pipes), os.sysconf("SC_OPEN_MAX")]
        for before, after in pairwise(ends):
            os.closerange(before + 1, after)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
        for name in [name for name in os.environ if name.startswith(SECRETS)]:
            del os.environ[name]
        os.environ["TMPDIR"] = tempfile.tempdir = str(self.folder / "tmp")
        os.chdir(self.folder / "tmp")
        self.limits.apply()
        _send(pipe, self._answer(lambda what, share: _send(pipe, {"progress": [what[:200], share]})))
        os.killpg(os.getpgrp(), signal.SIGKILL)

    def _answer(self, progress: Progress) -> dict[str, Any]:
        try:
            result = self.work(self.folder, progress)
            text = json.dumps(result, ensure_ascii=False, allow_nan=False)
            (self.folder / RESULT).write_text(text, encoding="utf-8")
        except BaseException as error:  # noqa: BLE001 (whatever it is, it is the answer)
            # An error and what it came from
            causes: list[BaseException] = []
            seen: BaseException | None = error
            while seen is not None:
                causes.append(seen)
                seen = seen.__cause__ or seen.__context__
            for cause in causes:
                number = cause.errno if isinstance(cause, OSError) else None
                if number in _HINDRANCES:
                    return {"hindered": os.strerror(number or 0)}
                if number == errno.EFBIG:
                    return self._failure_message(self.limits.report_exceeded("limit_file_mb"))
                out_of_memory = isinstance(cause, MemoryError) and not isinstance(error, InputError)
                if number == errno.ENOMEM or out_of_memory:
                    return self._failure_message(self.limits.report_exceeded("limit_memory_mb"))
            if isinstance(error, InputError):
                return self._failure_message(error)
            unexpected = Failure(
                kind="ProgramError",
                problem=f"the program failed on this job ({type(error).__name__})",
                remedy="Report it with the number of the job; the service's log says where it happened",
            )
            return {"failure": unexpected.model_dump(), "trace": code_places(error)}
        return {"finished": True}

    def _failure_message(self, error: InputError) -> dict[str, Any]:
        """The failure without the places on this machine, which mean nothing to a client."""
        fields = make_failure(error).model_dump()
        for name, text in fields.items():
            for place in (self.folder / "inputs", self.folder / "outputs", self.folder):
                text = text and text.replace(f"{place}/", "").replace(str(place), "")
            fields[name] = text and text[:_LONGEST]
        return {"failure": fields}


def code_places(error: BaseException) -> str:
    """Where it broke: lines of code only, for a message may hold what stands in a patient's file."""
    lines = [f"{f.filename}:{f.lineno} {f.name}" for f in traceback.extract_tb(error.__traceback__)]
    return " < ".join(reversed(lines))[:_LONGEST]


def _send(pipe: int, message: dict[str, Any]) -> None:
    content = (json.dumps(message) + "\n").encode()
    while content:
        content = content[os.write(pipe, content) :]
