"""Joint angles of real walking, where the recordings are at hand (never part of the repository)."""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path

import numpy as np

from tests.blind.body import Array
from tests.blind.motions.motion import Motion, clock, finished, wander

_FILES = tuple(f"jia_mri/Walking0{k}_kinematics.mot" for k in (1, 2, 4))
"""Right leg and pelvis of one young patient, by the authors of the recordings (Montefiori et al. 2019)."""

HARMONICS = 6
"""Of the stride (chosen: up to about 6 Hz)."""

_PELVIS = ("pelvis_rotation", "pelvis_list", "pelvis_tilt")
_RIGHT = ("hip_flexion", "hip_adduction", "hip_rotation", "knee_angle")


def data_folder() -> Path | None:
    """Folder of the real recordings: ``SCALING_SERVICE_DATA``, else ``../shared/data``; None without it."""
    named = os.environ.get("SCALING_SERVICE_DATA")
    folder = Path(named) if named else Path(__file__).resolve().parents[4] / "shared" / "data"
    return folder if folder.is_dir() else None


def real_motion(k: int, name: str, rng: np.random.Generator, duration_s: float) -> Motion:
    """Five seconds with the angles of one of three real strides.

    Notes
    -----
    One stride was recorded, of the right leg (start and end differ by up to 5 degrees). It is continued as a
    Fourier series; the left leg does the same half a stride later. Knee flexion, negative in the file, is
    positive here.
    """
    folder = data_folder()
    if folder is None:
        raise FileNotFoundError("the real recordings are not here: set SCALING_SERVICE_DATA")
    period, curves = _series(folder / _FILES[k % len(_FILES)])
    times = clock(duration_s)
    phase = times / period + rng.uniform()
    columns = {
        "pelvis_tx": 1.1 * (times - times.mean()),
        "pelvis_ty": 0.85 + 0.015 * np.cos(4 * np.pi * phase),
        "pelvis_tz": wander(rng, times, 0.01),
    }
    columns |= {c: _value(curves[c], phase) for c in _PELVIS}
    for side, shift in (("r", 0.0), ("l", 0.5)):
        columns |= {f"{c}_{side}": _value(curves[c], phase + shift) for c in _RIGHT}
    return finished(name, times, columns)


@lru_cache
def _series(path: Path) -> tuple[float, dict[str, Array]]:
    """The stride's time and each angle's coefficients, rad."""
    _, rows = path.read_text(encoding="utf-8").split("endheader", 1)
    names, *lines = rows.strip().split("\n")
    table = np.array([line.split() for line in lines], dtype=float)
    columns = dict(zip(names.split(), table.T, strict=True))
    radians = {c: np.deg2rad(columns[c if c in _PELVIS else f"{c}_r"]) for c in (*_PELVIS, *_RIGHT)}
    radians["knee_angle"] = -radians["knee_angle"]
    times = columns["time"] - columns["time"][0]
    period = float(times[-1] + times[1])
    basis = _basis(times / period)
    return period, {c: np.linalg.lstsq(basis, curve, rcond=None)[0] for c, curve in radians.items()}


def _basis(phase: Array) -> Array:
    angle = 2 * np.pi * np.outer(phase, np.arange(1, HARMONICS + 1))
    pairs = np.stack([np.cos(angle), np.sin(angle)], axis=2).reshape(len(phase), -1)
    return np.hstack([np.ones((len(phase), 1)), pairs])


def _value(coefficients: Array, phase: Array) -> Array:
    value: Array = _basis(phase) @ coefficients
    return value
