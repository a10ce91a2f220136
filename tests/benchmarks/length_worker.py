"""Inverse kinematics of a made-up recording of a given length: wall time, memory, distance from the truth."""

from __future__ import annotations

import resource
import time
from pathlib import Path
from typing import Any

import numpy as np

from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import compile_model, list_parameter_values, repeat_default_pose
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.tree import pose_markers
from tests.peers.worker import serve


def _peak() -> int:
    """The most memory that was ever held, bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _resident() -> int:
    """The memory held now, bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def _recording(model: BodyModel, n: int) -> tuple[Trial, np.ndarray]:
    """Smooth motion seen with 1 mm of noise, and the coordinates (n, n_coordinates) behind it."""
    t = np.arange(n)[:, None] / 100.0
    q = repeat_default_pose(model, n)
    rng = np.random.default_rng(0)
    q += 0.3 * np.sin(2 * np.pi * rng.uniform(0.2, 0.9, q.shape[1]) * t + rng.uniform(0, 6.28, q.shape[1]))
    q[:, [model.coordinate_names.index(f"knee_angle_{s}") for s in "rl"]] += 0.5
    markers = pose_markers(compile_model(model), q, list_parameter_values(model))
    markers += rng.normal(0.0, 0.001, markers.shape)
    return Trial(name="long", times=t[:, 0], labels=model.marker_names, markers=markers, rate_hz=100.0), q


def _measure(request: dict[str, Any]) -> dict[str, float]:
    n = request["frames"]
    model = load_builtin("lower_limb_14dof")
    model = model.with_markers(tuple(m for m in model.markers if m.weight > 0.0))
    trial, q = _recording(model, n)
    inverse_kinematics(model, trial.frames(slice(0, 100)))
    before, start = _resident(), time.perf_counter()
    found = inverse_kinematics(model, trial)
    wall = time.perf_counter() - start
    angles = [k for k, c in enumerate(model.coordinates) if c.kind == "rotation"]
    return {
        "frames": n,
        "us_per_frame": 1e6 * wall / n,
        "bytes": max(_peak() - before, 0),
        "rms_deg": float(np.degrees(np.sqrt(((found.q - q)[:, angles] ** 2).mean()))),
    }


if __name__ == "__main__":
    serve(_measure)
