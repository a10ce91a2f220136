"""Measured sizes that a C3D file states: Vicon's PROCESSING group, and others that use its names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from scaling_service.documents.sizes import RANGES_M
from scaling_service.model.trial import MeasuredSizes

GROUPS = ("PROCESSING", "SUBJECTS", "SUBJECT", "ANTHROPOMETRY")
"""Groups that may hold sizes; the first that states one counts."""

_HEIGHT_M, _MASS_KG = (0.4, 2.5), (2.0, 400.0)  # chosen: infants to the tallest and heaviest
_UNITS = (1e-3, 1e-2, 1.0)  # mm, as Vicon writes; cm; m

_SIDED = {
    "leglength": "leg_length",
    "kneewidth": "knee_width",
    "anklewidth": "ankle_width",
    "asistrocanterdistance": "asis_trochanter",  # Vicon's own spelling
    "asistrochanterdistance": "asis_trochanter",
    "elbowwidth": "elbow_width",
    "wristwidth": "wrist_width",
    "handthickness": "hand_thickness",
    "shoulderoffset": "shoulder_offset",
}
_WHOLE = {
    "interasisdistance": "asis_width",
    "asisdistance": "asis_width",
    "markerdiameter": "marker_diameter",
}
_NAMES = (
    _WHOLE
    | {f"r{name}": f"{size}_r" for name, size in _SIDED.items()}
    | {f"l{name}": f"{size}_l" for name, size in _SIDED.items()}
)
_HEIGHTS, _MASSES = ("height", "bodyheight"), ("bodymass", "mass", "weight", "bodyweight")


def stated_sizes(parameters: Mapping[str, Mapping[str, Any]]) -> MeasuredSizes:
    """The sizes that a file's parameters state.

    A length's unit is the one of mm, cm and m in which a person can have it; zeros, which stand for what
    was not entered, and values that no person has are left out.

    Parameters
    ----------
    parameters : mapping
        Group to name to value, as ``C3dFile`` holds them.

    Examples
    --------
    >>> stated_sizes({"PROCESSING": {"Height": [1480.0], "RKneeWidth": [104.0], "LKneeWidth": [0.0]}})
    MeasuredSizes(height_m=1.48, mass_kg=None, lengths_m={'knee_width_r': 0.104})
    """
    stated: dict[str, float] = {}
    for group in reversed(GROUPS):
        for name, value in parameters.get(group, {}).items():
            number = _number(value)
            if number is not None:
                stated[name.replace("_", "").replace(" ", "").casefold()] = number
    heights = [_length(stated[name], _HEIGHT_M) for name in _HEIGHTS if name in stated]
    masses = [stated[n] for n in _MASSES if n in stated and _MASS_KG[0] <= stated[n] <= _MASS_KG[1]]
    lengths = {
        size: length
        for name, size in _NAMES.items()
        if name in stated and (length := _length(stated[name], RANGES_M[size])) is not None
    }
    return MeasuredSizes(next((h for h in heights if h is not None), None), next(iter(masses), None), lengths)


def _number(value: Any) -> float | None:
    while isinstance(value, list):
        value = value[0] if value else None
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value)


def _length(value: float, limits: tuple[float, float]) -> float | None:
    fitting = [round(value * unit, 6) for unit in _UNITS if limits[0] <= value * unit <= limits[1]]
    return fitting[0] if len(fitting) == 1 else None
