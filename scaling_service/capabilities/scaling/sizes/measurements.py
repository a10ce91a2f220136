"""Lengths that are measured alike on a person's markers and on a model's.

A measurement is a set of distances between *points*: a landmark, the middle of several, or a joint's centre.
On the person a centre is constructed from markers (``centres``); on the model it
is constructed likewise, or the joint's own. A distance is used where both sides have all its points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scaling_service.model.anatomy.centres import Points
from scaling_service.numerics.multibody.laws import Array

Pair = tuple[tuple[str, ...], tuple[str, ...]]
"""The two ends of a distance, each the mean of some points."""


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
    shape_m : float
        Standard deviation of such a distance between persons in whom the segment has one size, in the model.
    instead : tuple of pairs
        Taken where more of these than of ``pairs`` can be.
    besides : tuple of pairs
        What a weighted estimate takes in addition.
    """

    segments: tuple[str, ...]
    pairs: tuple[Pair, ...]
    source: str
    shape_m: float = 0.0
    instead: tuple[Pair, ...] = ()
    besides: tuple[Pair, ...] = ()


_PUCHAUD = "Puchaud 2019, section 2.2.2"
_CHOSEN = "chosen: the landmarks at the segment's ends"

_PELVIS_SHAPE, _TRUNK_SHAPE, _LIMB_SHAPE = 0.012, 0.020, 0.007
"""m, chosen from the spreads that are left at one size: inter-ASIS width 4.5 % and pelvic depth 8 % against
2.5 % of the distance between the hips; trunk 5 %, a limb's ends over skin against its joints' centres 3 %."""


def _side(side: str) -> tuple[SegmentMeasurement, ...]:
    s = side.upper()
    hip, knee = (f"hip_{side}",), (f"knee_{side}",)
    between, lateral_ankle = (f"ankle_{side}_middle",), (f"ankle_{side}_chord",)
    shoulder, elbow, wrist = (f"{s}SHO",), (f"{s}ELB", f"{s}MEL"), (f"{s}WRA", f"{s}WRB")
    lateral, heel = (f"{s}ELB",), (f"{s}HEE",)
    foot, forearm = ("talus", "calcn", "toes", "foot"), ("ulna", "radius", "hand")
    return (
        SegmentMeasurement((f"femur_{side}", f"patella_{side}"), ((hip, knee),), _PUCHAUD),
        SegmentMeasurement(
            (f"tibia_{side}",),
            ((knee, between),),
            _PUCHAUD,
            instead=((knee, lateral_ankle),),
            besides=((knee, lateral_ankle),),
        ),
        SegmentMeasurement(
            tuple(f"{name}_{side}" for name in foot),
            ((heel, (f"{s}MT5",)), (heel, (f"{s}MT1",))),
            _CHOSEN,
            _LIMB_SHAPE,
            ((heel, (f"{s}TOE",)),),
        ),
        SegmentMeasurement(
            (f"humerus_{side}",), ((shoulder, elbow),), _CHOSEN, _LIMB_SHAPE, ((shoulder, lateral),)
        ),
        SegmentMeasurement(
            tuple(f"{name}_{side}" for name in forearm),
            ((elbow, wrist),),
            _CHOSEN,
            _LIMB_SHAPE,
            ((lateral, wrist),),
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
        _PELVIS_SHAPE,
        ((("RASIS",), ("LASIS",)), (("RASIS", "LASIS"), ("SACR",))),
    ),
    SegmentMeasurement(
        ("torso", "lower_trunk", "upper_trunk", "abdomen", "thorax"),
        ((("RSHO",), ("LSHO",)), (("C7",), ("RASIS", "LASIS", "RPSIS", "LPSIS"))),
        _CHOSEN,
        _TRUNK_SHAPE,
        ((("RSHO",), ("LSHO",)), (("C7",), ("RASIS", "LASIS", "SACR", "SACR"))),
    ),
    *_side("r"),
    *_side("l"),
)


def available(
    measurement: SegmentMeasurement, person: Points, model: Points, *, besides: bool = False
) -> tuple[Pair, ...]:
    """The distances that both sides have: those of ``pairs``, unless more of ``instead`` can be taken.

    Parameters
    ----------
    besides : bool
        Whether to add those that only a weighted estimate takes.
    """
    usual, other, more = (
        tuple(pair for pair in pairs if _has(pair, person) and _has(pair, model))
        for pairs in (measurement.pairs, measurement.instead, measurement.besides)
    )
    chosen = other if len(other) > len(usual) else usual
    return tuple(dict.fromkeys((*chosen, *(more if besides else ()))))


def ratio(measurement: SegmentMeasurement, person: Points, model: Points) -> float | None:
    """Mean ratio of the distances that can be taken on both; None if there is none.

    A distance on the person is the mean over the frames that show both of its ends.
    """
    pairs = available(measurement, person, model)
    ratios = [np.nanmean(distances(p, person)) / distances(p, model)[0] for p in pairs]
    return float(np.mean(ratios)) if ratios else None


def distances(pair: Pair, points: Points) -> Array:
    """A distance in every frame, (n_frames,), m; NaN where one of its ends is missing."""
    one, other = (np.mean([points[name] for name in end], axis=0) for end in pair)
    return np.asarray(np.linalg.norm(one - other, axis=1))


def _has(pair: Pair, points: Points) -> bool:
    known = all(name in points for end in pair for name in end)
    return known and bool(np.isfinite(distances(pair, points)).any())
