"""Our inverse kinematics of one recording: the least CPU time of several calls, and the error reached."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.capabilities.motion.task import Task
from scaling_service.files.osim.models import read_osim
from scaling_service.files.trc import read_trc
from tests.peers.worker import serve


def _solve(request: dict[str, Any]) -> dict[str, Any]:
    model, trial = read_osim(Path(request["model"])), read_trc(Path(request["trc"]))
    spent = []
    for _ in range(request["repeats"]):
        start = time.process_time()
        motion = inverse_kinematics(model, trial, weights=request["weights"])
        spent.append(time.process_time() - start)
    squared = motion.distances**2
    task = Task.of(model, trial, weights=request["weights"])
    held = dict(zip(task.model.coordinate_names, task.ranges.weight.max(axis=0).tolist(), strict=True))
    weights = np.array([request["weights"][name] for name in motion.markers])
    return {
        "s_per_frame": min(spent) / trial.n_frames,
        "markers": motion.markers,
        "coordinates": len(motion.estimated),
        "rms": float(np.sqrt(np.nanmean(squared))),
        "weighted": float(np.nansum(weights * squared)),
        "held": {name: weight for name, weight in held.items() if weight > 0.0},
    }


if __name__ == "__main__":
    serve(_solve)
