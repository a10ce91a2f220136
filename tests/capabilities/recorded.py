"""Recordings of built-in bodies whose motion is known, with noise on the markers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import compile_model, list_parameter_values, repeat_default_pose
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.tree import pose_markers


@dataclass(frozen=True)
class Recorded:
    """A body, its true motion (n_frames, n_coordinates), what was recorded, and each marker's noise (m)."""

    model: BodyModel
    q: Array
    trial: Trial
    noise: Array


def recorded(name: str, n_frames: int, seed: int, *, noise_m: float = 2e-3, uneven: bool = False) -> Recorded:
    """Every coordinate swings within its range; with ``uneven`` noise differs between markers by a factor."""
    rng = np.random.default_rng(seed)
    model = load_builtin(name)
    markers = [m.name for m in model.markers if m.weight > 0.0]
    times = np.arange(n_frames) / 100.0
    q = repeat_default_pose(model, n_frames)
    for k, coordinate in enumerate(model.coordinates):
        if not coordinate.locked:
            low, high = max(coordinate.lower, -0.6), min(coordinate.upper, 0.6)
            swing = np.sin(2.0 * np.pi * (0.4 + 0.05 * k) * times + rng.uniform(0.0, 6.0))
            q[:, k] = 0.5 * (low + high) + 0.3 * (high - low) * swing
    placed = pose_markers(compile_model(model, markers), q, list_parameter_values(model))
    noise = noise_m * (np.exp(rng.normal(0.0, 0.8, len(markers))) if uneven else np.ones(len(markers)))
    placed += rng.normal(size=placed.shape) * noise[:, None]
    return Recorded(
        model, q, Trial(name="walk", times=times, labels=tuple(markers), markers=placed, rate_hz=100.0), noise
    )
