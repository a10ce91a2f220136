"""Which sizes of a person can be given, and the range that each has among the living."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

SIZE_UNIT = "_mm"
"""How the name of a size ends in a subject file."""

SIDED: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "leg_length": (0.25, 1.4),
        "knee_width": (0.04, 0.20),
        "ankle_width": (0.03, 0.12),
        "asis_trochanter": (0.01, 0.12),
        "elbow_width": (0.03, 0.15),
        "wrist_width": (0.02, 0.10),
        "hand_thickness": (0.008, 0.06),
        "shoulder_offset": (0.01, 0.09),
    }
)
"""Sizes of either side, such as ``knee_width_r``, and the range of living persons, m. Chosen: from a small
child to the largest adult, and each less than a factor of ten wide, so that a unit shows itself.
Definitions as in the conventional gait model (Davis 1991; Vicon's Plug-in Gait): ``leg_length`` from the ASIS
over the knee to the medial malleolus, widths across epicondyles and malleoli without markers,
``asis_trochanter`` in the sagittal plane, ``shoulder_offset`` from the acromion's marker to the centre."""

WHOLE: Mapping[str, tuple[float, float]] = MappingProxyType(
    {"asis_width": (0.09, 0.40), "marker_diameter": (0.0035, 0.03)}
)
"""Sizes without a side: between the ASIS, and of the marker's ball."""

RANGES_M: Mapping[str, tuple[float, float]] = MappingProxyType(
    {f"{name}_{side}": limits for name, limits in SIDED.items() for side in "rl"} | dict(WHOLE)
)
"""Every size that is known, with its range, m."""
