"""Lengths that are measured alike on a person's markers and on a model's.

A measurement is a set of distances between *points*: a landmark, the middle of several, or a joint's centre.
On the person a centre is constructed from markers; on the model it is constructed likewise, or the joint's
own. A distance is used where both sides have all its points.

A segment's length alone says little of its breadth: one factor for a large bone such as the pelvis misplaces
the hips (Puchaud 2019, section 4.4). Where segments get a factor along each axis, the pelvis takes its depth
(x) from ASIS to PSIS, its breadth (z) from side to side, its height (y) from how far the hip centres lie
below; thigh and shank their length (y) as always, their breadth (z) from the epicondyles or malleoli, and as
thickness (x) the mean of both. Everything else keeps one factor.
"""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from functools import partial

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.names import say_name
from scaling_service.model.anatomy import frames
from scaling_service.model.anatomy.centres import Points
from scaling_service.model.body import Vector

Pair = tuple[tuple[str, ...], tuple[str, ...]]
"""The two ends of a distance, each the mean of some points."""

_PELVIS_SHAPE, _TRUNK_SHAPE, _LIMB_SHAPE = 0.012, 0.020, 0.007
"""m, chosen from the spreads that are left at one size: inter-ASIS width 4.5 % and pelvic depth 8 % against
2.5 % of the distance between the hips; trunk 5 %, a limb's ends over skin against its joints' centres 3 %."""

_TRUNK_HEIGHT_SHAPE = 0.008
"""m, chosen: from pelvis to C7, up to how the joints lie in the trunk. Its breadth says little of its height:
six children are broader than long against an adult, by 6 to 28 %."""

_TRUNK = ("torso", "lower_trunk", "upper_trunk", "abdomen", "thorax")
_BREADTH: Pair = (("RSHO",), ("LSHO",))
_HEIGHT: Pair = (("C7",), ("RASIS", "LASIS", "RPSIS", "LPSIS"))
_HEIGHT_FROM_SACRUM: Pair = (("C7",), ("RASIS", "LASIS", "SACR", "SACR"))

AXES: abc.Mapping[str, str] = {
    "pelvis": "xyz",
    "femur_r": "yz",
    "tibia_r": "yz",
    "femur_l": "yz",
    "tibia_l": "yz",
}
"""Segments that take factors of their own along these axes; where ``x`` is not one, it is the mean."""

_ASIS, _PSIS = ("RASIS", "LASIS"), ("RPSIS", "LPSIS")


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentMeasurement:
    """Distances of one kind of segment.

    Of pelvis, thighs and shanks as in Puchaud 2019, section 2.2.2; of others between the landmarks at their
    ends (chosen).

    ``segments``: segments that take this factor, those that the model has.
    ``pairs``: each point is a tuple of landmarks whose mean is meant.
    ``shape_m``: standard deviation of such a distance between persons in whom the segment has one size, in
        the model.
    ``instead``: taken where more of these than of ``pairs`` can be.
    ``besides``: what a weighted estimate takes in addition.
    """

    segments: tuple[str, ...]
    pairs: tuple[Pair, ...]
    shape_m: float = 0.0
    instead: tuple[Pair, ...] = ()
    besides: tuple[Pair, ...] = ()


def _list_side(side: str) -> tuple[SegmentMeasurement, ...]:
    s = side.upper()
    hip, knee = (f"hip_{side}",), (f"knee_{side}",)
    between, lateral_ankle = (f"ankle_{side}_middle",), (f"ankle_{side}_chord",)
    shoulder, elbow, wrist = (f"{s}SHO",), (f"{s}ELB", f"{s}MEL"), (f"{s}WRA", f"{s}WRB")
    lateral, heel = (f"{s}ELB",), (f"{s}HEE",)
    foot, forearm = ("talus", "calcn", "toes", "foot"), ("ulna", "radius", "hand")
    return (
        SegmentMeasurement(segments=(f"femur_{side}", f"patella_{side}"), pairs=((hip, knee),)),
        SegmentMeasurement(
            segments=(f"tibia_{side}",),
            pairs=((knee, between),),
            instead=((knee, lateral_ankle),),
            besides=((knee, lateral_ankle),),
        ),
        SegmentMeasurement(
            segments=tuple(f"{name}_{side}" for name in foot),
            pairs=((heel, (f"{s}MT5",)), (heel, (f"{s}MT1",))),
            shape_m=_LIMB_SHAPE,
            instead=((heel, (f"{s}TOE",)),),
        ),
        SegmentMeasurement(
            segments=(f"humerus_{side}",),
            pairs=((shoulder, elbow),),
            shape_m=_LIMB_SHAPE,
            instead=((shoulder, lateral),),
        ),
        SegmentMeasurement(
            segments=tuple(f"{name}_{side}" for name in forearm),
            pairs=((elbow, wrist),),
            shape_m=_LIMB_SHAPE,
            instead=((lateral, wrist),),
        ),
    )


def list_measurements(segments: abc.Sequence[str]) -> tuple[SegmentMeasurement, ...]:
    """What can be measured of a model with these segments."""
    pelvis = SegmentMeasurement(
        segments=("pelvis",),
        pairs=(
            (("RASIS",), ("LASIS",)),
            (("RPSIS",), ("LPSIS",)),
            (("RASIS",), ("RPSIS",)),
            (("LASIS",), ("LPSIS",)),
        ),
        shape_m=_PELVIS_SHAPE,
        instead=((("RASIS",), ("LASIS",)), (("RASIS", "LASIS"), ("SACR",))),
    )
    # With a joint in its middle, where a trunk that is too long folds, its breadth is not taken.
    jointed = "abdomen" in segments
    trunk = SegmentMeasurement(
        segments=_TRUNK,
        pairs=(_HEIGHT,) if jointed else (_BREADTH, _HEIGHT),
        shape_m=_TRUNK_HEIGHT_SHAPE if jointed else _TRUNK_SHAPE,
        instead=(_HEIGHT_FROM_SACRUM,) if jointed else (_BREADTH, _HEIGHT_FROM_SACRUM),
    )
    every = (pelvis, trunk, *_list_side("r"), *_list_side("l"))
    return tuple(m for m in every if set(m.segments) & set(segments))


def list_available(
    measurement: SegmentMeasurement, person: Points, model: Points, *, besides: bool = False
) -> tuple[Pair, ...]:
    """The distances that both sides have: those of ``pairs``, unless more of ``instead`` can be taken.

    ``besides``: whether to add those that only a weighted estimate takes.
    """
    usual, other, more = (
        tuple(pair for pair in pairs if _has(pair, person) and _has(pair, model))
        for pairs in (measurement.pairs, measurement.instead, measurement.besides)
    )
    chosen = other if len(other) > len(usual) else usual
    return tuple(dict.fromkeys((*chosen, *(more if besides else ()))))


def compute_ratio(measurement: SegmentMeasurement, person: Points, model: Points) -> float | None:
    """Mean ratio of the distances that can be taken on both; None if there is none.

    A distance on the person is the mean over the frames that show both of its ends.
    """
    pairs = list_available(measurement, person, model)
    ratios = [np.nanmean(measure_distances(p, person)) / measure_distances(p, model)[0] for p in pairs]
    return float(np.mean(ratios)) if ratios else None


def measure_distances(pair: Pair, points: Points) -> Array:
    """A distance in every frame, (n_frames,), m; NaN where one of its ends is missing."""
    one, other = (np.mean([points[name] for name in end], axis=0) for end in pair)
    return np.asarray(np.linalg.norm(one - other, axis=1))


def _has(pair: Pair, points: Points) -> bool:
    known = all(name in points for end in pair for name in end)
    return known and bool(np.isfinite(measure_distances(pair, points)).any())


def open_axes(
    factors: abc.Mapping[str, Vector], people: abc.Sequence[Points], ours: Points
) -> tuple[dict[str, Vector], tuple[str, ...]]:
    """Uniform factors opened along the axes that can be measured.

    ``factors``: segment to its uniform factor thrice; of thigh and shank it is that of the length.
    ``people``: the recordings, the best first.
    ``ours``: the model's.
    Returns ``notes``: what could not be measured and follows the uniform factor.
    """
    opened, notes = dict(factors), list[str]()

    def measure_first(measure: abc.Callable[[Points, Points], float | None]) -> float | None:
        """On the first recording on which it can be."""
        return next((value for p in people if (value := measure(p, ours)) is not None), None)

    if "pelvis" in factors:
        # Side to side as Puchaud 2019, 2.2.2; Harrington 2007's pelvic depth (chosen)
        sides = (((_ASIS[0],), (_ASIS[1],)), ((_PSIS[0],), (_PSIS[1],)))
        across = SegmentMeasurement(segments=("pelvis",), pairs=sides)
        ahead = SegmentMeasurement(segments=("pelvis",), pairs=((_ASIS, _PSIS),))
        found = {
            "depth": measure_first(partial(compute_ratio, ahead)),
            "width": measure_first(partial(compute_ratio, across)),
            "height": measure_first(_compute_hip_depth_ratio),
        }
        missing = [name for name, value in found.items() if value is None]
        if missing:
            notes.append(f"MB: pelvis: {' and '.join(missing)} not measured: as its mean factor")
        depth, width, height = (factors["pelvis"][0] if v is None else v for v in found.values())
        opened["pelvis"] = (depth, height, width)
    for side in "rl":
        for segment, ends in ((f"femur_{side}", ("LFE", "MFE")), (f"tibia_{side}", ("LM", "MM"))):
            if segment in factors:
                lateral, medial = (f"{side.upper()}{name}" for name in ends)
                across = SegmentMeasurement(segments=(segment,), pairs=(((lateral,), (medial,)),))
                length, breadth = factors[segment][1], measure_first(partial(compute_ratio, across))
                if breadth is None:
                    notes.append(
                        f"MB: {say_name(segment)}: breadth not measured ({lateral}, {medial}): as its length"
                    )
                else:
                    opened[segment] = (0.5 * (length + breadth), length, breadth)
    return opened, tuple(notes)


def _compute_hip_depth_ratio(person: Points, model: Points) -> float | None:
    """How far the hip centres lie below the plane of ASIS and PSIS, over the model's."""
    theirs, own = _measure_hip_depth(person), _measure_hip_depth(model)
    return None if theirs is None or own is None else theirs / own


def _measure_hip_depth(points: Points) -> float | None:
    """Mean over both sides, m; the sacrum stands for both PSIS where these were not marked."""
    psis = [name if name in points else "SACR" for name in _PSIS]
    if any(name not in points for name in (*_ASIS, *psis, "hip_r", "hip_l")):
        return None
    frame: frames.Frames = frames.build_pelvis_frame(*(points[name] for name in (*_ASIS, *psis)))
    depths: Array = -np.concatenate([frame.to_local(points[f"hip_{side}"])[:, 1] for side in "rl"])
    known = depths[np.isfinite(depths)]
    return float(known.mean()) if known.size and known.mean() > 0.0 else None


def read_fitted_factor(values: abc.Mapping[str, float], segment: str) -> Vector:
    """What a fit multiplied a segment's size by, along x, y and z; ones where it was not free.

    ``values``: parameter name to value.
    """
    if f"scale.{segment}" in values:
        return (values[f"scale.{segment}"],) * 3
    freed = {
        letter: values[f"scale.{segment}.{letter}"]
        for letter in "xyz"
        if f"scale.{segment}.{letter}" in values
    }
    rest = float(np.mean(list(freed.values()))) if freed else 1.0
    x, y, z = (freed.get(letter, rest) for letter in "xyz")
    return (x, y, z)
