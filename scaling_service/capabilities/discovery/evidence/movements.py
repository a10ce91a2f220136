"""Ordinary movements of any body whose coordinates have their usual names, to ask what each would show."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from scaling_service.model.body import BodyModel
from scaling_service.model.compile import default_coordinates
from scaling_service.numerics.multibody.laws import Array

N_FRAMES, RATE_HZ = 200, 50.0
_Course = Callable[[Array], Array]


def _wave(mean_deg: float, swing_deg: float, lead: float = 0.0, times: int = 1) -> _Course:
    """Degrees over a cycle 0 to 1."""
    return lambda phase: np.radians(mean_deg + swing_deg * np.cos(2.0 * np.pi * (times * phase + lead)))


MOVEMENTS: Mapping[str, Mapping[str, _Course]] = {
    "quiet standing": {"hip_flexion": _wave(0, 1), "knee": _wave(3, 1), "ankle": _wave(2, 1)},
    "a squat": {
        "hip_flexion": _wave(45, -45),
        "knee": _wave(50, -50),
        "ankle": _wave(12, -12),
        "lumbar_extension": _wave(-15, 15),
        "arm_flex": _wave(40, -40),
    },
    "gait": {
        "hip_flexion": _wave(10, 22),
        "hip_adduction": _wave(0, 5, 0.25),
        "hip_rotation": _wave(0, 5, 0.4),
        "knee": _wave(25, 22, 0.35),
        "ankle": _wave(0, 12, 0.6),
        "lumbar_extension": _wave(-3, 3),
        "arm_flex": _wave(5, 20, 0.5),
    },
    "hip circumduction": {
        "hip_flexion": _wave(15, 30),
        "hip_adduction": _wave(-10, 20, 0.25),
        "knee": _wave(5, 4),
    },
    "standing hip rotation with a straight knee": {"hip_rotation": _wave(0, 30), "knee": _wave(2, 1)},
    "bending the knee with a still hip": {"hip_flexion": _wave(10, 3), "knee": _wave(55, -50)},
    "a jump": {
        "hip_flexion": _wave(35, -35),
        "knee": _wave(45, -45),
        "ankle": _wave(-5, -25),
        "arm_flex": _wave(40, -60),
    },
    "leaning the trunk": {"lumbar_extension": _wave(-20, 20), "lumbar_bending": _wave(0, 15, 0.25)},
    "swinging the arms": {"arm_flex": _wave(40, 60), "elbow": _wave(40, 40), "arm_add": _wave(-30, 20, 0.25)},
}
"""Coordinate (the beginning of its name) to its course over one cycle of two seconds, degrees. Ranges are
those of healthy adults (gait: Winter 2009, appendix; the others chosen round)."""

_ALSO = {
    "knee": ("knee_angle", "knee_flexion"),
    "ankle": ("ankle_angle", "ankle_flexion"),
    "elbow": ("elbow_flex",),
}


def coordinates_of(model: BodyModel, movement: str) -> Array | None:
    """The model's coordinates through a movement, (N_FRAMES, n_coordinates); None if it has none of them."""
    phase = np.arange(N_FRAMES) / N_FRAMES * (N_FRAMES / RATE_HZ) / 2.0
    q = default_coordinates(model, N_FRAMES)
    found = False
    for start, course in MOVEMENTS[movement].items():
        for k, name in enumerate(model.coordinate_names):
            if name.startswith(_ALSO.get(start, (start,))) and not name.endswith("beta"):
                other = 0.5 if name.endswith("_l") and movement in ("gait", "swinging the arms") else 0.0
                q[:, k] = _within(model, k, course(phase + other))
                found = True
    return q if found else None


def _within(model: BodyModel, k: int, values: Array) -> Array:
    """Values in the range that the model declares; a knee that bends the other way is turned round."""
    c = model.coordinates[k]
    if c.lower < c.upper and np.isfinite([c.lower, c.upper]).all():
        if values.max() > c.upper and -values.min() <= c.upper and -values.max() >= c.lower - 0.1:
            values = -values
        return np.asarray(np.clip(values, c.lower, c.upper))
    return values
