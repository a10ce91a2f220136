"""How persons' bones differ: sizes and angles drawn by sex, each from a stream of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from scaling_service.core.streams import stream
from scaling_service.virtual.cohort import Sex

Side = Literal["r", "l"]

LONGEST = 2.0
"""Standard deviations beyond which nothing is drawn; chosen, the persons are healthy adults."""

SIDES_ALIKE = 0.9
"""Correlation between a person's two sides, chosen: they differ by less than half of what persons do."""


@dataclass(frozen=True, slots=True)
class Spread:
    """Mean and SD of men and of women, and the correlation with the length of the bone."""

    men: tuple[float, float]
    women: tuple[float, float]
    with_length: float = 0.0


SIZES_MM: Mapping[str, Spread] = {
    # Femoral heads: facts of forensic anthropology (diameters 48 (2.5) and 42.5 (2.2)), halved.
    "head_radius": Spread((24.0, 1.25), (21.25, 1.1), 0.6),
    # Kapur et al., Folia Medica, 52 men and 48 women, dry bone.
    "epicondylar_breadth": Spread((82.65, 3.96), (72.47, 3.49), 0.6),
    # The mean of both condyles, 21.5 (1.8) mm (of the order of Iwaki et al. 2000); women a tenth less.
    "condyle_radius": Spread((21.5, 1.6), (19.4, 1.5), 0.6),
    # Medial over lateral: 22 against 21 mm (as above); SD chosen, no difference found by Li et al. 2012.
    "condyle_difference": Spread((1.0, 0.8), (0.9, 0.7)),
    # From the head's centre to the shaft's axis, square to it; chosen, usual in planning hip prostheses.
    "femoral_offset": Spread((42.0, 4.0), (38.0, 4.0), 0.4),
    # How far the shaft bows forward off the line between its ends; chosen.
    "femoral_bow": Spread((9.0, 2.0), (8.5, 2.0)),
    # Half the width in mid-shaft; chosen, the width is 26-29 mm.
    "shaft_radius": Spread((14.0, 0.9), (12.6, 0.8), 0.4),
}
"""Correlations with length are chosen: large bones are large all over, but not strictly."""

ANGLES_DEG: Mapping[str, Spread] = {
    # Computed tomography of 600 hips (Egypt J Radiol Nucl Med 2023, 54:96).
    "neck_shaft": Spread((129.65, 4.13), (129.28, 3.71)),
    # van der Linden 2015, 50 femora, both sexes.
    "anteversion": Spread((11.7, 8.2), (11.7, 8.2)),
}

SOCKET_GAP_M = 2.5e-3
"""Between the head's and the socket's radius: chosen within 1-3 mm of cartilage on both sides."""


@dataclass(frozen=True, slots=True)
class LegShape:
    """Sizes (m) and angles (rad) of one leg's bones, beside their lengths."""

    head_radius: float
    epicondylar_breadth: float
    condyle_radius: float
    condyle_difference: float
    femoral_offset: float
    femoral_bow: float
    shaft_radius: float
    neck_shaft: float
    anteversion: float

    @property
    def condyle_radii(self) -> tuple[float, float]:
        """Of the medial and the lateral condyle, m."""
        return (
            self.condyle_radius + 0.5 * self.condyle_difference,
            self.condyle_radius - 0.5 * self.condyle_difference,
        )


def leg_shape(seed: int, side: Side, sex: Sex, length: float) -> LegShape:
    """The bones of one leg of a person.

    Parameters
    ----------
    length : float
        Of the person's femurs and tibias, in standard deviations from the mean of the sex.

    Examples
    --------
    >>> leg_shape(1, "r", "M", 0.0) == leg_shape(1, "r", "M", 0.0)
    True
    """
    sizes = {name: 1e-3 * _drawn(seed, name, side, sex, length, s) for name, s in SIZES_MM.items()}
    angles = {
        name: float(np.radians(_drawn(seed, name, side, sex, length, s))) for name, s in ANGLES_DEG.items()
    }
    return LegShape(**sizes, **angles)


def _drawn(seed: int, name: str, side: Side, sex: Sex, length: float, spread: Spread) -> float:
    mean, sd = spread.men if sex == "M" else spread.women
    both, one = stream(seed, "bones", name).normal(), stream(seed, "bones", name, side).normal()
    own = np.sqrt(SIDES_ALIKE) * both + np.sqrt(1.0 - SIDES_ALIKE) * one
    rho = spread.with_length
    share = np.clip(rho * length + np.sqrt(1.0 - rho**2) * own, -LONGEST, LONGEST)
    return float(mean + sd * share)
