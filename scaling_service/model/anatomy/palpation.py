"""How far a marker lies from the landmark that it stands for, and how well sizes are measured by hand."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

Vector = tuple[float, float, float]

LANDMARK_SD_M: Mapping[str, Vector] = MappingProxyType(
    {
        "ASIS": (0.007, 0.007, 0.007),
        "PSIS": (0.006, 0.008, 0.006),
        "SACR": (0.006, 0.008, 0.006),
        "LFE": (0.005, 0.005, 0.004),
        "MFE": (0.005, 0.005, 0.004),
        "FH": (0.004, 0.005, 0.004),
        "LM": (0.003, 0.003, 0.003),
        "MM": (0.003, 0.003, 0.003),
    }
)
"""Standard deviation of a marker's place about its landmark, x, y, z of the segment, of adults. Proposed from
the overall errors of Della Croce et al. 1999, 2005 (6-21 mm within, 13-25 mm between examiners); the sacrum's
is a PSIS'."""

ADULT_STATURE_M = 1.70
"""Of the adults on whom palpation was studied (chosen); errors are taken to grow with stature."""

OTHER_SD_M: Vector = (0.006, 0.006, 0.006)
"""Chosen: of landmarks that those studies did not have (foot, trunk, arm), the middle of theirs."""

CALIPER_SD_M = 0.003
"""Chosen: of a width measured over skin with a caliper; makers of calipers state 1 mm, skin yields more."""

CALIPER_ASIS_SD_M = 0.005
"""Chosen: between the ASIS, which are palpated each time; half of what two markers leave (7 mm each)."""

TAPE_SD = 0.03
"""Chosen, relative: a tape from ASIS over the knee to the malleolus against the straight line."""

_SIZE_SD_M: Mapping[str, float] = MappingProxyType({"asis_width": CALIPER_ASIS_SD_M})


def size_sd(name: str, value: float) -> float:
    """Standard deviation (m) of a size measured by hand, by its name in ``sizes``.

    Examples
    --------
    >>> size_sd("knee_width_r", 0.104), size_sd("leg_length_r", 0.8)
    (0.003, 0.024)
    """
    return TAPE_SD * value if name.startswith("leg_length") else _SIZE_SD_M.get(name, CALIPER_SD_M)


def landmark_sd(landmark: str) -> Vector:
    """Standard deviation (m) of a marker about its landmark, by canonical name.

    Examples
    --------
    >>> landmark_sd("RASIS"), landmark_sd("C7")
    ((0.007, 0.007, 0.007), (0.006, 0.006, 0.006))
    """
    return LANDMARK_SD_M.get(landmark) or LANDMARK_SD_M.get(landmark[1:], OTHER_SD_M)
