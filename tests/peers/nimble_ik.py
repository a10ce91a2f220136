"""nimblephysics' inverse kinematics as a peer: its errors and time, one thread, an environment of its own.

For benchmarks only. nimblephysics wants an older numpy than ours, so it lives in another environment,
whose interpreter ``SCALING_SERVICE_NIMBLE`` names (``pip install 'numpy<2'`` and
``pip install --no-deps nimblephysics`` are enough: what is used here needs no torch). Run as a module
it is the worker; :func:`run_nimble_ik` asks it.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.peers.worker import ask, serve

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
    request = {
        "model": str(model.resolve()),
        "measured": markers[:, [list(labels).index(name) for name in chosen]].tolist(),
        "markers": chosen,
        "weights": [weights[name] for name in chosen],
    }
    answer = ask("tests.peers.nimble_ik", request, python=python, time_limit_s=time_limit_s)
    return NimbleIk(
        tuple(answer["markers"]), np.array(answer["squared_errors"], dtype=float), np.array(answer["cpu_s"])
    )


def _solve(request: dict[str, Any]) -> dict[str, Any]:
    import nimblephysics_libs._nimblephysics as nimble

    parsed = nimble.biomechanics.OpenSimParser.parseOsim(request["model"], ignoreGeometry=True)
    body, places = parsed.skeleton, parsed.markersMap
    measured = np.array(request["measured"])
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


if __name__ == "__main__":
    serve(_solve)
