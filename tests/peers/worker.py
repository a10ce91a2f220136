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
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

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
            env=_environment(),
            timeout=time_limit_s,
            check=False,
        )
    if done.returncode:
        raise RuntimeError(f"{worker} failed: {done.stderr[-2000:]}")
    return json.loads(done.stdout)


@contextmanager
def standing(worker: str) -> Iterator[Callable[[Mapping[str, Any]], Any]]:
    """A function that asks one worker again and again; a request that fails is the last.

    Parameters
    ----------
    worker : str
        Its module.

    Raises
    ------
    RuntimeError
        By that function, with the end of what the worker said.
    """
    with tempfile.TemporaryDirectory() as scratch, tempfile.TemporaryFile("w+") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", worker],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
            cwd=scratch,
            env=_environment(),
        )
        assert process.stdin is not None
        assert process.stdout is not None
        asked, answers = process.stdin, process.stdout

        def ask_again(request: Mapping[str, Any]) -> Any:
            asked.write(json.dumps(request) + "\n")
            asked.flush()
            line = answers.readline()
            if not line:
                log.seek(0)
                raise RuntimeError(f"{worker} failed: {log.read()[-2000:]}")
            return json.loads(line)

        with process:  # closes the pipes, so that the worker ends, and waits for it
            yield ask_again


def serve(function: Callable[[dict[str, Any]], Any]) -> None:
    """Answer the requests on standard input, one a line; what the function prints goes to standard error."""
    with os.fdopen(os.dup(1), "w") as out:
        os.dup2(2, 1)  # compiled libraries print, too; only answers may reach standard output
        for line in sys.stdin:
            out.write(json.dumps(function(json.loads(line))) + "\n")
            out.flush()


def _environment() -> dict[str, str]:
    """This process's, with the repository importable and one thread per library."""
    path = os.environ.get("PYTHONPATH")
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(ROOT), path] if path else [str(ROOT)]),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
