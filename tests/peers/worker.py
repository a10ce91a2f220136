"""Work in a process and a scratch folder of its own, on one thread: a request goes in, an answer comes out.

For libraries that cannot live in the tests' own process, and for what is timed. A worker is a module
that ends in ``if __name__ == "__main__": serve(function)``; :func:`ask` runs it for one request, and
:func:`standing` for as many as there are. Both sides need the standard library only, so that a worker may
run in another environment.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any

ROOT = Path(__file__).resolve().parents[2]


def ask(
    worker: str,
    request: Mapping[str, Any] | None = None,
    *,
    python: Path | None = None,
    time_limit_s: float = 600.0,
) -> Any:
    """The answer of a worker.

    Parameters
    ----------
    worker : str
        Its module, as ``tests.peers.opensim_ik``.
    request : mapping, optional
        JSON-ready, NaN included; file names must be absolute.
    python : Path, optional
        Another environment's interpreter.

    Raises
    ------
    RuntimeError
        If it fails, with the end of what it said.
    subprocess.TimeoutExpired
    """
    with tempfile.TemporaryDirectory() as scratch:
        done = subprocess.run(
            [str(python or sys.executable), "-m", worker],
            input=json.dumps(request or {}),
            capture_output=True,
            text=True,
            cwd=scratch,
            env=make_environment(),
            timeout=time_limit_s,
            check=False,
        )
    if done.returncode:
        raise RuntimeError(f"{worker} failed: {done.stderr[-2000:]}")
    return json.loads(done.stdout)


@contextmanager
def standing(worker: str, *, time_limit_s: float = 120.0) -> Iterator[Callable[[Mapping[str, Any]], Any]]:
    """A function that asks one worker again and again; after a request that failed, a new one.

    Parameters
    ----------
    worker : str
        Its module.
    time_limit_s : float
        For one answer; then the worker is killed, and the request has failed.

    Raises
    ------
    RuntimeError
        By that function, with the end of what the worker said.
    """
    with ExitStack() as opened:
        scratch = opened.enter_context(tempfile.TemporaryDirectory())
        log = opened.enter_context(tempfile.TemporaryFile("w+"))
        process: subprocess.Popen[str] | None = None

        def ask_again(request: Mapping[str, Any]) -> Any:
            nonlocal process
            if process is None:
                process = opened.enter_context(_started(worker, scratch, log))  # its end closes the pipes
            assert process.stdin is not None
            assert process.stdout is not None
            clock = threading.Timer(time_limit_s, process.kill)
            clock.start()
            try:
                process.stdin.write(json.dumps(request) + "\n")
                process.stdin.flush()
                line = process.stdout.readline()
            finally:
                clock.cancel()
            if not line:
                process = None
                log.seek(0)
                raise RuntimeError(f"{worker} failed: {log.read()[-2000:]}")
            return json.loads(line)

        yield ask_again


def _started(worker: str, scratch: str, log: IO[str]) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", worker],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=log,
        text=True,
        cwd=scratch,
        env=make_environment(),
    )


def serve(function: Callable[[dict[str, Any]], Any]) -> None:
    """Answer the requests on standard input, one a line; what the function prints goes to standard error."""
    with os.fdopen(os.dup(1), "w") as out:
        os.dup2(2, 1)  # compiled libraries print, too; only answers may reach standard output
        for line in sys.stdin:
            out.write(json.dumps(function(json.loads(line))) + "\n")
            out.flush()


def make_environment() -> dict[str, str]:
    """This process's, with the repository importable and one thread per library."""
    path = os.environ.get("PYTHONPATH")
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(ROOT), path] if path else [str(ROOT)]),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
