"""The legs of CusToM, the toolbox of Puchaud et al. 2019, as another generic model to start from.

The paper does not print its generic model; the built-in one has its subjects' mean proportions. Joint
centres and markers below are those of CusToM's leg (files PelvisNoTrunk, Thigh, Shank), at its stature of
1.80 m, brought to this cohort's. Its pelvis is wide and its hip centres narrow for its markers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

from scaling_service.capabilities.scaling.methods.placement import moved, with_centre
from scaling_service.model.body import BodyModel, Vector
from scaling_service.model.builtin import generic_person

Generic = Literal["custom", "mean"]
"""The legs of CusToM, or the built-in ones, which have the mean proportions of the paper's subjects."""

_STATURE_M = 1.80

_MARKERS: Mapping[str, Vector] = {
    "ASIS": (0.0, 0.0, 0.140),
    "PSIS": (-0.1703, 0.0, 0.040),
    "LFE": (-0.0206, -0.467, 0.073),
    # On the shank in CusToM, on the thigh in table 1: its place at full extension.
    "MFE": (-0.025, -0.4842, -0.046),
    # In none of its leg files: TLEM's bone point, 12 mm of skin and marker beside it.
    "FH": (-0.020, -0.055, 0.055),
    "LM": (0.0, -0.4692, 0.0415),
    "MM": (0.020, -0.4481, -0.040),
    "AJC": (0.0, -0.460, 0.0),
}
"""Right side in the segment's frame, m: mid-ASIS, hip centre, knee centre."""

_CENTRES: Mapping[str, Vector] = {"femur": (-0.0843, -0.0651, 0.080), "tibia": (-0.025, -0.455, 0.010)}
"""Of the right hip in the pelvis and the right knee in the thigh, m."""


def custom_legs(mean: BodyModel) -> BodyModel:
    """The built-in legs with joint centres and markers where CusToM's have them.

    Parameters
    ----------
    mean : BodyModel
        The built-in ``lower_limb_14dof``, whose names, axes and inertia stay.
    """
    k = generic_person(mean.name).height_m / _STATURE_M
    local = {
        f"{letter}{name}": _sided(place, k, side)
        for name, place in _MARKERS.items()
        for letter, side in (("R", 1.0), ("L", -1.0))
    }
    model = moved(mean, local)
    for segment, place in _CENTRES.items():
        for letter, side in (("r", 1.0), ("l", -1.0)):
            model = with_centre(model, f"{segment}_{letter}", _sided(place, k, side))
    return replace(model, name=f"{mean.name}, as CusToM")


def _sided(place: Vector, k: float, side: float) -> Vector:
    x, y, z = place
    return (k * x, k * y, k * side * z)
