"""Run the opensim library in a process of its own: JSON in, JSON out."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from scaling_service.core import errors
from scaling_service.core.errors import FileUnreadable, InputError

TIME_LIMIT_S = 120.0
"""Chosen: loading the largest public models takes about one second, also on a busy machine some ten."""

_WORKER = "scaling_service.files.osim.worker"
_KINDS: Mapping[str, type[InputError]] = {
    kind.__name__: kind
    for kind in (errors.DependencyMissing, errors.FileUnreadable, errors.ModelRefused, errors.InputError)
}


def ask(request: Mapping[str, Any], *, time_limit_s: float = TIME_LIMIT_S) -> dict[str, Any]:
    """Send one request to a fresh worker and return its answer.

    ``request``: JSON-ready; ``file`` names the file that an unexplained failure is blamed on. Raises
    DependencyMissing if opensim is not installed. Raises FileUnreadable if OpenSim cannot read the file,
    crashes on it or takes too long. Raises ModelRefused if the model holds a component that cannot be
    represented.
    """
    with tempfile.TemporaryDirectory(prefix="osim-") as scratch:
        try:
            done = subprocess.run(
                [sys.executable, "-m", _WORKER],
                input=json.dumps(request),
                capture_output=True,
                encoding="utf-8",
                errors="replace",
                cwd=scratch,
                env=_make_environment(),
                timeout=time_limit_s,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise FileUnreadable(
                f"OpenSim gave no answer within {time_limit_s:g} s",
                file=request.get("file"),
                remedy="Open the file in OpenSim itself to see where it hangs",
            ) from error
    return _answer(done, request)


def _make_environment() -> dict[str, str]:
    """The caller's environment, with this package importable and one thread per library."""
    root = str(Path(__file__).resolve().parents[3])
    path = os.environ.get("PYTHONPATH")
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([root, path] if path else [root]),
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }


def _answer(done: subprocess.CompletedProcess[str], request: Mapping[str, Any]) -> dict[str, Any]:
    try:
        answer: dict[str, Any] = json.loads(done.stdout)
    except ValueError:
        raise FileUnreadable(
            f"OpenSim ended without an answer ({_describe_ending(done)})",
            file=request.get("file"),
            remedy="Open the file in OpenSim itself to see whether it is sound",
        ) from None
    problem = answer.get("error")
    if problem is not None:
        kind = _KINDS.get(problem["kind"], InputError)
        raise kind(
            problem["problem"],
            file=problem["file"] or request.get("file"),
            field=problem["field"],
            remedy=problem["remedy"],
        )
    return answer


def _describe_ending(done: subprocess.CompletedProcess[str]) -> str:
    if done.returncode < 0:
        return signal.Signals(-done.returncode).name
    lines = done.stderr.strip().splitlines()
    return f"exit {done.returncode}: {lines[-1]}" if lines else f"exit {done.returncode}"
