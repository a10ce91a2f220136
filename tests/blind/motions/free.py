"""Movements of the legs in the air or anywhere: joint angles as smooth curves of real amplitude.

They carry no forces: nothing here asks where the ground is.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import yaml

from tests.blind.body import Array
from tests.blind.motions.motion import Motion, clock, finished, wander

_GAIT = Path(__file__).resolve().parents[3] / "reference_models" / "gait_schwartz2008.yaml"
Columns = dict[str, Array]


def free(kind: str, name: str, rng: np.random.Generator, duration_s: float) -> Motion:
    """A movement of one of the kinds of MOVEMENTS."""
    times = clock(duration_s)
    columns = _standing(rng, times)
    for coordinate, angle in MOVEMENTS[kind](rng, times).items():
        columns[coordinate] = columns[coordinate] + angle
    return finished(name, times, columns)


def _standing(rng: np.random.Generator, times: Array) -> Columns:
    """Upright with the little sway that everything has."""
    columns = {
        "pelvis_tx": wander(rng, times, 0.004),
        "pelvis_ty": 0.95 + wander(rng, times, 0.002),
        "pelvis_tz": wander(rng, times, 0.004),
    }
    angles = ["pelvis_rotation", "pelvis_list", "pelvis_tilt"]
    for side in ("r", "l"):
        angles += [f"{c}_{side}" for c in ("hip_flexion", "hip_adduction", "hip_rotation", "knee_angle")]
    for angle in angles:
        columns[angle] = np.deg2rad(wander(rng, times, 0.7))
        if angle.startswith("knee"):
            columns[angle] = columns[angle] + np.deg2rad(6.0)
    return columns


def _gait(rng: np.random.Generator, times: Array) -> Columns:
    """Schwartz et al. 2008 on a treadmill at a free speed; adult stride times (1.0-1.2 s)."""
    stride = rng.uniform(1.0, 1.2)
    phase = times / stride + rng.uniform()
    scale = rng.normal(1.0, 0.08)
    curves = {name: _curve(name, phase) for name in ("pelvis_obliquity_up", "pelvis_internal_rotation")}
    columns: Columns = {
        "pelvis_tx": 0.01 * np.cos(4 * np.pi * phase) + wander(rng, times, 0.02, 0.1, 0.4),
        "pelvis_ty": 0.02 * np.cos(4 * np.pi * (phase - 0.3)),
        "pelvis_tz": 0.02 * np.cos(2 * np.pi * (phase - 0.3)),
        "pelvis_list": -curves["pelvis_obliquity_up"],
        "pelvis_rotation": curves["pelvis_internal_rotation"],
    }
    for side, shift in (("r", 0.0), ("l", 0.5)):
        for theirs, ours in (
            ("hip_flexion", "hip_flexion"),
            ("hip_adduction", "hip_adduction"),
            ("hip_internal_rotation", "hip_rotation"),
            ("knee_flexion", "knee_angle"),
        ):
            columns[f"{ours}_{side}"] = scale * _curve(theirs, phase + shift)
    return columns


@lru_cache
def _harmonics(name: str) -> tuple[float, Array, Array]:
    curve = yaml.safe_load(_GAIT.read_text(encoding="utf-8"))["curves"][name]
    return curve["mean"], np.array(curve["cos"]), np.array(curve["sin"])


def _curve(name: str, phase: Array) -> Array:
    mean, cosines, sines = _harmonics(name)
    angle = 2 * np.pi * np.outer(phase, np.arange(1, len(cosines) + 1))
    radians: Array = np.deg2rad(mean + np.cos(angle) @ cosines + np.sin(angle) @ sines)
    return radians


def _hips(rng: np.random.Generator, times: Array) -> Columns:
    """Circumduction of one hip, then of the other, with turns (freely after Camomilla 2006's star-arc)."""
    columns: Columns = {}
    half = times[len(times) // 2]
    for side, first in (("r", True), ("l", False)):
        active = _fade((half - times) if first else (times - half))
        rate = 2 * np.pi * rng.uniform(0.5, 0.7)
        columns[f"hip_flexion_{side}"] = active * np.deg2rad(18 + 30 * np.cos(rate * times))
        columns[f"hip_adduction_{side}"] = active * np.deg2rad(-10 + 20 * np.sin(rate * times))
        columns[f"hip_rotation_{side}"] = active * np.deg2rad(
            18 * np.sin(0.6 * rate * times + rng.uniform(0, 6))
        )
        columns[f"knee_angle_{side}"] = active * np.deg2rad(20 - 20 * np.cos(0.8 * rate * times))
    return columns


def _squat(rng: np.random.Generator, times: Array) -> Columns:
    """Two-legged squats to about 90 degrees of knee flexion."""
    depth = 0.5 - 0.5 * np.cos(2 * np.pi * times / rng.uniform(2.0, 2.8) + rng.uniform(0, 6))
    knee, hip = rng.normal(90, 8), rng.normal(75, 8)
    columns: Columns = {"pelvis_ty": -0.30 * depth, "pelvis_tx": -0.15 * depth, "pelvis_tilt": -0.35 * depth}
    for side in ("r", "l"):
        columns[f"hip_flexion_{side}"] = np.deg2rad(hip) * depth
        columns[f"hip_adduction_{side}"] = np.deg2rad(-8) * depth
        columns[f"hip_rotation_{side}"] = np.deg2rad(8) * depth
        columns[f"knee_angle_{side}"] = np.deg2rad(knee) * depth
    return columns


def _jump(rng: np.random.Generator, times: Array) -> Columns:
    """Countermovement jumps: crouch, flight of about 0.2 m, crouch."""
    phase = 2 * np.pi * (times / rng.uniform(1.5, 1.8) + rng.uniform())
    crouch = np.clip(np.cos(phase), 0, None) ** 3
    flight = np.clip(-np.cos(phase), 0, None) ** 3
    columns: Columns = {"pelvis_ty": 0.2 * flight - 0.2 * crouch, "pelvis_tilt": -0.3 * crouch}
    for side in ("r", "l"):
        columns[f"hip_flexion_{side}"] = np.deg2rad(60) * crouch
        columns[f"knee_angle_{side}"] = np.deg2rad(70) * crouch
    return columns


def _still(rng: np.random.Generator, times: Array) -> Columns:
    return {}


def _fade(seconds: Array) -> Array:
    """0 before, 1 after, within a quarter of a second."""
    u = np.clip(seconds / 0.25 + 0.5, 0, 1)
    smooth: Array = u**3 * (10 - 15 * u + 6 * u**2)
    return smooth


MOVEMENTS = {"gait": _gait, "hips": _hips, "squat": _squat, "jump": _jump, "standing": _still}
