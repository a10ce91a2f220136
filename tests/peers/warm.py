"""OpenSim loaded once in a process of tests: every request is answered in a fork of it, as by a fresh worker.

``python -m tests.peers.warm`` reads requests, one a line, and writes how each ended: what the worker of
``files.osim`` would have written, or the signal that ended it.
"""

from __future__ import annotations

import atexit
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from tests.peers.worker import make_environment

_STANDING: dict[int, subprocess.Popen[str]] = {}
"""By the process that started it: a fork of that one starts its own."""

_ONE_AT_A_TIME = threading.Lock()


def work(request: Mapping[str, Any], scratch: str, time_limit_s: float) -> subprocess.CompletedProcess[str]:
    """Have a request carried out in a scratch folder; the first one loads OpenSim."""
    with _ONE_AT_A_TIME:
        process = _STANDING.get(os.getpid())
        if process is None or process.poll() is not None:
            process = _STANDING[os.getpid()] = _start()
        assert process.stdin is not None
        assert process.stdout is not None
        clock = threading.Timer(time_limit_s, process.kill)
        clock.start()
        try:
            process.stdin.write(json.dumps({"request": dict(request), "scratch": scratch}) + "\n")
            process.stdin.flush()
            ended = json.loads(process.stdout.readline())
        finally:
            clock.cancel()
    return subprocess.CompletedProcess([], ended["code"], ended["out"], ended["err"])


def _start() -> subprocess.Popen[str]:
    folder = tempfile.mkdtemp()  # OpenSim writes its log where it is loaded
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.peers.warm"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=folder,
        env=make_environment(),
    )

    def end() -> None:
        process.kill()
        process.communicate()
        shutil.rmtree(folder, ignore_errors=True)

    atexit.register(end)
    return process


def _fork(answer: Callable[[dict[str, Any]], Any], request: dict[str, Any], scratch: str) -> dict[str, Any]:
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+", errors="replace") as err:
        child = os.fork()
        if child == 0:
            code = 1
            try:
                os.chdir(scratch)
                os.dup2(err.fileno(), 1)
                os.dup2(err.fileno(), 2)
                out.write(json.dumps(answer(request)))
                out.flush()
                code = 0
            except BaseException as error:  # noqa: BLE001 (the fork must end here, whatever happens)
                os.write(2, f"{type(error).__name__}: {error}\n".encode())
            finally:
                os._exit(code)
        _, status = os.waitpid(child, 0)
        for stream in (out, err):
            stream.seek(0)
        return {"code": os.waitstatus_to_exitcode(status), "out": out.read(), "err": err.read()}


def main() -> None:
    """Answer requests until there are no more; OpenSim's own printing goes to standard error."""
    from scaling_service.core.errors import DependencyMissing
    from scaling_service.files.osim.library import import_opensim
    from scaling_service.files.osim.worker import answer

    with suppress(DependencyMissing):  # the answers say so
        import_opensim()
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as reply:
        os.dup2(2, 1)
        for line in sys.stdin:
            asked = json.loads(line)
            reply.write(json.dumps(_fork(answer, asked["request"], asked["scratch"])) + "\n")
            reply.flush()


if __name__ == "__main__":
    main()
