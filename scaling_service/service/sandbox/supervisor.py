"""Starts a child, follows it, stops it, and says how it ended. Nothing from a child is trusted."""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import signal
import stat
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import connection, forkserver
from multiprocessing.connection import wait
from multiprocessing.popen_forkserver import Popen
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from scaling_service.core.errors import InputError
from scaling_service.documents.jobs import Failure
from scaling_service.service.sandbox import child as children
from scaling_service.service.sandbox import outcomes
from scaling_service.service.store.blobs import prepare
from scaling_service.service.store.errors import StoreUnavailable

PRELOAD = "scaling_service.service.sandbox.warm"  # what the fork server imports before any job

_ROOT = Path(__file__).resolve().parents[3]
_CONTEXT = multiprocessing.get_context("forkserver")
_GONE_S = 10.0  # chosen: SIGKILL takes effect at once, unless the machine itself is stuck

TICK_S = 0.1
"""Between looks at the clock and the wish to stop. Chosen: quick for a person, nothing for a machine."""

_LOOK_AT_DISK_S = 1.0
_LONGEST_LINE = 1 << 16  # bytes. A child that sends a longer line is not ours any more.
_LARGEST_RESULT = 64 << 20  # bytes. Chosen: far above any document, far below the memory of a machine.
_MOST_FILES = 10_000
_LONGEST_PATH = 512  # characters, as in the table of files

_CRASHES = (signal.SIGSEGV, signal.SIGBUS, signal.SIGABRT, signal.SIGILL, signal.SIGFPE, signal.SIGSYS)


def find_python(module: str, *arguments: str) -> tuple[list[str], dict[str, str]]:
    """Command line and environment of a process of ours that finds this very package."""
    path = os.pathsep.join(filter(None, [str(_ROOT), os.environ.get("PYTHONPATH")]))
    return [sys.executable, "-m", module, *arguments], {**os.environ, "PYTHONPATH": path}


def warm_up() -> None:
    """Start the fork server where it does not run, so that it is warm when a child is asked for."""
    _CONTEXT.set_forkserver_preload([PRELOAD])
    forkserver.ensure_running()


class SandboxProcess:
    """A child that makes a call with a pipe for its messages, as soon as the fork server is warm.

    It sees this process end by ``multiprocessing.parent_process().sentinel``. OSError or EOFError is raised
    where the machine gives no more processes, or the fork server was killed meanwhile.
    """

    def __init__(self, call: Callable[[connection.Connection], None]) -> None:
        self.messages, theirs = _CONTEXT.Pipe(duplex=False)
        try:
            with theirs:
                warm_up()
                # What `Process.start` uses, without its bookkeeping: that is for one thread, and refuses
                # daemonic processes, which Dask's workers are.
                self._process = Popen(_CONTEXT.Process(target=call, args=(theirs,)))
        except BaseException:
            self.messages.close()
            raise

    @property
    def sentinel(self) -> int:
        """A descriptor that can be read when the child is gone."""
        return self._process.sentinel

    @property
    def exit_code(self) -> int | None:
        """Of a child that is gone: a negative signal number, or what it ended with."""
        return self._process.poll()

    def end(self) -> None:
        """Kill the child with all that it started, if it lives, and wait until it is gone."""
        if self._process.poll() is None:
            self._process.kill()
        with suppress(ProcessLookupError, PermissionError):  # while one of a group lives, its number is taken
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait(_GONE_S)
        self._process.close()
        self.messages.close()


def supervise(
    child: children.Child, *, stop: Callable[[], bool], progress: children.Progress
) -> outcomes.Outcome:
    """Have work done in a limited process, and wait for its end, whatever that is.

    ``stop`` is asked ten times a second whether to stop; ``progress`` hears what is being done and the
    share that is done.
    """
    try:
        launched = SandboxProcess(child)
    except (OSError, EOFError) as error:
        return outcomes.Lost(f"no process could be started ({error})")
    try:
        answer = _await_answer(launched, child, stop, progress)
    finally:
        launched.end()
    return _parse_answer(answer, child) if isinstance(answer, dict) else answer


def _await_answer(
    launched: SandboxProcess, child: children.Child, stop: Callable[[], bool], progress: children.Progress
) -> dict[str, Any] | outcomes.Outcome:
    """The child's answer, or how it ended without one."""
    begun = looked = time.monotonic()
    pipe = launched.messages.fileno()
    lines = _Lines(pipe)
    while True:
        ready = wait([launched.sentinel] if lines.ended else [pipe, launched.sentinel], TICK_S)
        if pipe in ready:
            for message in lines.read():
                if "progress" not in message:
                    return message
                match message["progress"]:
                    case [str() as what, int() | float() as share]:
                        progress(
                            _make_printable(what)[:200],
                            min(max(float(share), 0.0), 1.0) if math.isfinite(share) else 0.0,
                        )
        elif launched.sentinel in ready:  # all messages were read before
            # What the exit of a child that gave no answer means.
            code = launched.exit_code
            if code == -signal.SIGXCPU:
                return outcomes.Failed.of(child.limits.report_exceeded(child.limits.cpu_setting))
            if code is not None and -code in _CRASHES:
                return outcomes.Failed(
                    Failure(
                        kind="ProgramError",
                        problem=f"a library crashed on this job ({signal.Signals(-code).name})",
                        remedy="Check that the files are sound: damaged ones can do this",
                    )
                )
            return outcomes.Lost(f"the process ended with {code}")
        if lines.broken:
            return outcomes.Lost("it sent what cannot be read")
        now = time.monotonic()
        if stop():
            return outcomes.Stopped()
        if now - begun > child.limits.wall_s:
            return outcomes.Failed.of(child.limits.report_exceeded("limit_wall_s"))
        if now - looked > _LOOK_AT_DISK_S:
            looked = now
            if _count_bytes(child.folder) > child.limits.output_bytes:
                return outcomes.Failed.of(child.limits.report_exceeded("limit_output_mb"))


class _Lines:
    """Lines of JSON from a pipe, as far as they have come."""

    def __init__(self, pipe: int) -> None:
        self._pipe, self._rest = pipe, b""
        self.broken = self.ended = False

    def read(self) -> list[dict[str, Any]]:
        more = os.read(self._pipe, _LONGEST_LINE)
        self.ended = not more
        *whole, self._rest = (self._rest + more).split(b"\n")
        self.broken = len(self._rest) > _LONGEST_LINE
        messages: list[dict[str, Any]] = []
        for line in whole:
            message = None
            with suppress(ValueError):
                message = json.loads(line)
            if not isinstance(message, dict):
                self.broken = True
                return messages
            messages.append(message)
        return messages


def _parse_answer(answer: dict[str, Any], child: children.Child) -> outcomes.Outcome:
    """A child's last message as an outcome, with its files counted and synced by us."""
    try:
        if "failure" in answer:
            fields = {k: v if v is None else _make_printable(v) for k, v in dict(answer["failure"]).items()}
            return outcomes.Failed(
                Failure.model_validate(fields), _make_printable(answer.get("trace", ""))[:4000]
            )
        if "hindered" in answer:
            return outcomes.Lost(_make_printable(answer["hindered"])[:200])
        if _count_bytes(child.folder) > child.limits.output_bytes:
            return outcomes.Failed.of(child.limits.report_exceeded("limit_output_mb"))
        # The result document, which must be JSON in the narrow sense.
        file = child.folder / children.RESULT
        if file.lstat().st_size > _LARGEST_RESULT:
            raise ValueError("no result is so large")
        return outcomes.Finished(
            json.loads(file.read_bytes(), parse_constant=_reject_constant),
            _list_files(child.folder / "outputs"),
        )
    except StoreUnavailable as error:
        return outcomes.Lost(error.problem)
    except InputError as error:
        return outcomes.Failed.of(error)
    except (ValidationError, ValueError, TypeError, RecursionError, OSError) as error:
        return outcomes.Lost(f"its answer cannot be read ({type(error).__name__})")


def _list_files(outputs: Path) -> tuple[tuple[str, str, int], ...]:
    """All files that were made, safely on disk; links are none."""
    found: list[tuple[str, str, int]] = []
    for path in sorted(outputs.rglob("*")):
        if stat.S_ISREG(path.lstat().st_mode):
            name = path.relative_to(outputs).as_posix()
            if not name.isprintable() or len(name) > _LONGEST_PATH or len(found) == _MOST_FILES:
                raise ValueError("files with such names, or so many, are not ours")
            content = prepare(path)
            found.append((name, content.sha256, content.size))
    return tuple(found)


def _reject_constant(name: str) -> None:
    raise ValueError(f"{name} is no number of JSON")


def _make_printable(text: object) -> str:
    """A text that any database takes: no control characters, no halves of characters."""
    return "".join(c if c.isprintable() else " " for c in str(text))


def _count_bytes(folder: Path) -> int:
    """Bytes that the child wrote so far, whatever else happens to the files meanwhile."""
    total = 0
    for path in (folder / children.RESULT, *(folder / "outputs").rglob("*"), *(folder / "tmp").rglob("*")):
        with suppress(OSError):  # removed since it was listed
            total += path.lstat().st_size
    return total
