"""Work in a process and a scratch folder of its own, on one thread: a request goes in, an answer comes out.

For libraries that cannot live in the tests' own process, and for what is timed. A worker is a module
that ends in ``if __name__ == "__main__": serve(function)``; :func:`ask` runs it. Both sides need the
standard library only, so that a worker may run in another environment.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
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
    path = os.environ.get("PYTHONPATH")
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(ROOT), path] if path else [str(ROOT)]),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    with tempfile.TemporaryDirectory() as scratch:
        done = subprocess.run(
            [str(python or sys.executable), "-m", worker],
            input=json.dumps(request or {}),
            capture_output=True,
            text=True,
            cwd=scratch,
            env=environment,
            timeout=time_limit_s,
            check=False,
        )
    if done.returncode:
        raise RuntimeError(f"{worker} failed: {done.stderr[-2000:]}")
    return json.loads(done.stdout)


def serve(function: Callable[[dict[str, Any]], Any]) -> None:
    """Answer the request on standard input; what the function prints goes to standard error."""
    request = json.loads(sys.stdin.read())
    reply = os.dup(1)
    os.dup2(2, 1)  # compiled libraries print, too; only the answer may reach standard output
    text = json.dumps(function(request))
    with os.fdopen(reply, "w") as out:
        out.write(text)
