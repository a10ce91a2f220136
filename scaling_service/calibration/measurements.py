"""Lengths that are measured alike on a person's markers and on a model's.

A measurement is a set of distances between *points*: a landmark, the middle of several, or a hip
centre. On the person a hip centre comes from a regression on the pelvis markers; on the model it is
the joint's own centre. A measurement is used where both sides have all its points.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scaling_service.kernels.laws import Array

Points = Mapping[str, Array]
"""Canonical landmark or hip centre (``hip_r``) to its trajectory, (n_frames, 3), m."""


@dataclass(frozen=True, slots=True)
class SegmentMeasurement:
    """Distances of one kind of segment.

    Parameters
    ----------
    segments : tuple of str
        Segments that take this factor, those that the model has.
    pairs : tuple of pairs of points
        Each point is a tuple of landmarks whose mean is meant.
    source : str
    """

    segments: tuple[str, ...]
    pairs: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]
    source: str


_PUCHAUD = "Puchaud 2019, section 2.2.2"
_CHOSEN = "chosen: the landmarks at the segment's ends"


def _side(side: str) -> tuple[SegmentMeasurement, ...]:
    s = side.upper()
    knee, ankle = (f"{s}LFE", f"{s}MFE"), (f"{s}LM", f"{s}MM")
    elbow, wrist = (f"{s}ELB", f"{s}MEL"), (f"{s}WRA", f"{s}WRB")
    foot = ("talus", "calcn", "toes", "foot")
    return (
        SegmentMeasurement((f"femur_{side}", f"patella_{side}"), (((f"hip_{side}",), knee),), _PUCHAUD),
        SegmentMeasurement((f"tibia_{side}",), ((knee, ankle),), _PUCHAUD),
        SegmentMeasurement(
            tuple(f"{name}_{side}" for name in foot),
            (((f"{s}HEE",), (f"{s}MT5",)), ((f"{s}HEE",), (f"{s}MT1",))),
            _CHOSEN,
        ),
        SegmentMeasurement((f"humerus_{side}",), (((f"{s}SHO",), elbow),), _CHOSEN),
        SegmentMeasurement(
            tuple(f"{name}_{side}" for name in ("ulna", "radius", "hand")), ((elbow, wrist),), _CHOSEN
        ),
    )


MEASUREMENTS: tuple[SegmentMeasurement, ...] = (
    SegmentMeasurement(
        ("pelvis",),
        (
            (("RASIS",), ("LASIS",)),
            (("RPSIS",), ("LPSIS",)),
            (("RASIS",), ("RPSIS",)),
            (("LASIS",), ("LPSIS",)),
        ),
        _PUCHAUD,
    ),
    SegmentMeasurement(
        ("torso", "lower_trunk", "upper_trunk", "abdomen", "thorax"),
        ((("RSHO",), ("LSHO",)), (("C7",), ("RASIS", "LASIS", "RPSIS", "LPSIS"))),
        _CHOSEN,
    ),
    *_side("r"),
    *_side("l"),
)


@dataclass(frozen=True, slots=True)
class Ratio:
    """A person's size over the model's, and how many of the measurement's distances it rests on."""

    factor: float
    pairs: int


def ratio(measurement: SegmentMeasurement, person: Points, model: Points) -> Ratio | None:
    """Mean ratio of the distances that can be taken on both; None if there is none.

    A distance on the person is the mean over the frames that show both of its ends.
    """
    found = []
    for pair in measurement.pairs:
        theirs, ours = (_length(pair, points) for points in (person, model))
        if theirs is not None and ours is not None:
            found.append(theirs / ours)
    return Ratio(float(np.mean(found)), len(found)) if found else None


def _length(pair: tuple[tuple[str, ...], tuple[str, ...]], points: Points) -> float | None:
    if any(name not in points for end in pair for name in end):
        return None
    one, other = (np.mean([points[name] for name in end], axis=0) for end in pair)
    distance = np.linalg.norm(one - other, axis=1)
    seen = distance[np.isfinite(distance)]
    return float(seen.mean()) if len(seen) else None
