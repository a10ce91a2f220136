"""nimblephysics' inverse kinematics as a peer: its errors and time, one thread, an environment of its own.

For benchmarks only. nimblephysics wants an older numpy than ours, so it lives in another environment,
whose interpreter ``SCALING_SERVICE_NIMBLE`` names (``pip install 'numpy<2'`` and
``pip install --no-deps nimblephysics`` are enough: what is used here needs no torch). Run as a script
it is the worker; :func:`run_nimble_ik` starts it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class NimbleIk:
    """What nimblephysics reaches: squared errors (n_frames, n_markers), m2, and CPU seconds by frame."""

    markers: tuple[str, ...]
    squared_errors: Array
    cpu_s: Array


def interpreter() -> Path | None:
    """The interpreter of nimblephysics' environment, if one is named and there."""
    named = os.environ.get("SCALING_SERVICE_NIMBLE")
    return Path(named) if named and Path(named).is_file() else None


def run_nimble_ik(
    python: Path,
    model: Path,
    labels: Sequence[str],
    markers: Array,
    weights: Mapping[str, float],
    *,
    time_limit_s: float = 600.0,
) -> NimbleIk:
    """Track markers (n_frames, n_labels, 3), m, frame by frame, each from the pose of the one before.

    The first frame starts from the default pose and from nine more, untimed.
    """
    chosen = [name for name in labels if name in weights]
    with tempfile.TemporaryDirectory() as scratch:
        measured = Path(scratch) / "markers.npy"
        np.save(measured, markers[:, [list(labels).index(name) for name in chosen]])
        request = {
            "model": str(model.resolve()),
            "measured": str(measured),
            "markers": chosen,
            "weights": [weights[name] for name in chosen],
        }
        done = subprocess.run(
            [str(python), str(Path(__file__).resolve())],
            input=json.dumps(request),
            capture_output=True,
            text=True,
            cwd=scratch,
            env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            timeout=time_limit_s,
            check=False,
        )
    if done.returncode:
        raise RuntimeError(f"nimblephysics failed: {done.stderr[-2000:]}")
    answer = json.loads(done.stdout)
    return NimbleIk(
        tuple(answer["markers"]), np.array(answer["squared_errors"], dtype=float), np.array(answer["cpu_s"])
    )


def _solve(request: dict[str, Any]) -> dict[str, Any]:
    import nimblephysics_libs._nimblephysics as nimble

    parsed = nimble.biomechanics.OpenSimParser.parseOsim(request["model"], ignoreGeometry=True)
    body, places = parsed.skeleton, parsed.markersMap
    measured = np.load(request["measured"])
    kept = [k for k, name in enumerate(request["markers"]) if name in places]
    names = [request["markers"][k] for k in kept]
    weights = np.array(request["weights"])[kept]
    weights /= weights.max()  # the same minimum, and its steps diverge with weights above one
    cpu, errors = [], []
    for frame, row in enumerate(measured[:, kept]):
        shown = np.flatnonzero(np.isfinite(row).all(axis=1))
        here = [places[names[k]] for k in shown]
        start = time.process_time()
        body.fitMarkersToWorldPositions(
            here, row[shown].ravel(), weights[shown], numIndependentStarts=1 if frame else 10
        )
        cpu.append(time.process_time() - start)
        reached = np.asarray(body.getMarkerWorldPositions(here)).reshape(-1, 3)
        squared = np.full(len(names), np.nan)
        squared[shown] = ((reached - row[shown]) ** 2).sum(axis=1)
        errors.append(squared.tolist())
    return {"markers": names, "squared_errors": errors, "cpu_s": cpu[1:]}


def _main() -> None:
    request = json.loads(sys.stdin.read())
    reply = os.dup(1)
    os.dup2(2, 1)  # nimblephysics prints; only the answer may reach standard output
    text = json.dumps(_solve(request))
    with os.fdopen(reply, "w") as out:
        out.write(text)


if __name__ == "__main__":
    _main()
