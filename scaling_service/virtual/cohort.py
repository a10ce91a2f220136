"""Who the virtual persons are: stature, mass, bone lengths and knee axes, drawn as in Puchaud 2019."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from scaling_service.core.streams import stream
from scaling_service.model.body import BodyModel
from scaling_service.numerics.multibody.laws import Array

Sex = Literal["F", "M"]

STATURE_M = (1.762, 0.076)
"""Mean and SD of the cohort of Puchaud 2019 (section 2.1)."""
MALE_SHARE = 22.0 / 26.0
"""Puchaud 2019, section 2.1."""
SEX_GAP_M = 0.127
"""Men over women: 1.756 - 1.629 m (ANSUR II 2012)."""
BMI = (21.6, 2.14)
"""kg/m2, mean and SD: Puchaud 2019, section 2.1."""

FEMUR, SHANK, INTER_HIP = (0.2454, 0.012), (0.2356, 0.011), (0.0985, 0.008)
"""Mean as a share of stature (EOS, Puchaud 2019, table 2) and SD about it in m (facts section 10, from the
table's SDs)."""
FEMUR_SHANK_CORRELATION = 0.8
"""Proposed (facts section 10)."""
SIDE_SD_M = 0.00325
"""Of one bone's length about the mean of both sides: legs differ by 5.2 mm on average (Knutson 2005,
Chiropr Osteopat 13:11, from radiographs), so by 6.5 mm SD, half of the variance in each bone."""

KNEE_AXIS_DEG: Mapping[str, tuple[tuple[float, float], tuple[float, float]]] = {
    "r": ((1.94, 1.83), (-2.02, 2.10)),
    "l": ((-0.81, 1.84), (0.81, 2.16)),
}
"""Mean and SD of the turns about x and y of the thigh (Puchaud 2019, table 3, EB_a,m*)."""


def stature_of(sex: Sex) -> tuple[float, float]:
    """Mean and SD of the stature (m) of one sex in the cohort."""
    mean, sd = STATURE_M
    mean += SEX_GAP_M * ((1.0 - MALE_SHARE) if sex == "M" else -MALE_SHARE)
    return mean, float(np.sqrt(sd**2 - MALE_SHARE * (1.0 - MALE_SHARE) * SEX_GAP_M**2))


def person_of(seed: int) -> tuple[Sex, float, float]:
    """Sex, stature (m) and mass (kg); both sexes together have the cohort's mean and SD of stature."""
    rng = stream(seed, "person")
    sex: Sex = "M" if rng.random() < MALE_SHARE else "F"
    height = float(rng.normal(*stature_of(sex)))
    return sex, height, float(max(rng.normal(*BMI), 16.0) * height**2)


def factors_of(seed: int, generic: BodyModel, height: float) -> dict[str, float]:
    """Each segment's size against the generic model, for a person of a stature (m)."""
    rng = stream(seed, "lengths")
    common = rng.normal()
    across = np.sqrt(1.0 - FEMUR_SHANK_CORRELATION**2) * rng.normal()
    femur = FEMUR[0] * height + FEMUR[1] * common
    shank = SHANK[0] * height + SHANK[1] * (FEMUR_SHANK_CORRELATION * common + across)
    inter_hip = INTER_HIP[0] * height + INTER_HIP[1] * rng.normal()
    factors = {"pelvis": float(inter_hip / (2.0 * _offset(generic, "femur_r")[2]))}
    for side in ("r", "l"):
        for bone, length, reach in (
            ("femur", femur, _offset(generic, f"tibia_{side}")),
            ("tibia", shank, np.array(generic.marker(f"{side.upper()}AJC").nominal)),
        ):
            own = length + SIDE_SD_M * stream(seed, "lengths", bone, side).normal()
            factors[f"{bone}_{side}"] = float(own / np.linalg.norm(reach))
    return factors


def _offset(model: BodyModel, segment: str) -> Array:
    """Where a segment's joint sits in its parent, m."""
    shifts = [j for j in model.segment(segment).joints if j.kind == "translation"]
    total: Array = sum((np.array(j.axis) * j.law.constant_part for j in shifts), np.zeros(3))
    return total


def tilt_of_knee(seed: int, side: str) -> tuple[float, float]:
    """The turns of a knee's axis about x and y of the thigh, rad."""
    rng = stream(seed, "knee_axis", side)
    x, y = (float(np.radians(rng.normal(*spread))) for spread in KNEE_AXIS_DEG[side])
    return (x, y)
