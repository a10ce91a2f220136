"""Factors along each axis of a segment, where markers determine them.

A segment's length alone says little of its breadth: one factor for a large bone such as the pelvis misplaces
the hips (Puchaud 2019, section 4.4). Here the pelvis takes its depth (x) from ASIS to PSIS, its breadth (z)
from side to side, its height (y) from how far the hip centres lie below; thigh and shank their length (y)
as always, their breadth (z) from the epicondyles or malleoli, and as thickness (x) the mean of both.
Everything else keeps one factor.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from scaling_service.capabilities.scaling.sizes.measurements import SegmentMeasurement, ratio
from scaling_service.model.anatomy.centres import Points
from scaling_service.model.anatomy.frames import Frames, pelvis_frame
from scaling_service.model.body import Vector
from scaling_service.numerics.multibody.laws import Array

AXES: Mapping[str, str] = {
    "pelvis": "xyz",
    "femur_r": "yz",
    "tibia_r": "yz",
    "femur_l": "yz",
    "tibia_l": "yz",
}
"""Segments that take factors of their own along these axes; where ``x`` is not one, it is the mean."""

_ASIS, _PSIS = ("RASIS", "LASIS"), ("RPSIS", "LPSIS")
_WIDTH = SegmentMeasurement(
    ("pelvis",),
    (((_ASIS[0],), (_ASIS[1],)), ((_PSIS[0],), (_PSIS[1],))),
    "side to side, as Puchaud 2019, 2.2.2",
)
_DEPTH = SegmentMeasurement(("pelvis",), ((_ASIS, _PSIS),), "chosen: Harrington 2007's pelvic depth")


def per_axis(
    factors: Mapping[str, Vector], people: Sequence[Points], ours: Points
) -> tuple[dict[str, Vector], tuple[str, ...]]:
    """Uniform factors opened along the axes that can be measured.

    Parameters
    ----------
    factors : mapping
        Segment to its uniform factor thrice; of thigh and shank it is that of the length.
    people : sequence of Points
        The recordings, the best first.
    ours : Points
        The model's.

    Returns
    -------
    factors : dict
    notes : tuple of str
        What could not be measured and follows the uniform factor.
    """
    opened, notes = dict(factors), list[str]()
    if "pelvis" in factors:
        opened["pelvis"] = _pelvis(factors["pelvis"], people, ours, notes)
    for side in "rl":
        for segment, ends in ((f"femur_{side}", "LFE MFE"), (f"tibia_{side}", "LM MM")):
            if segment in factors:
                opened[segment] = _long_bone(
                    segment, factors[segment], side, ends.split(), people, ours, notes
                )
    return opened, tuple(notes)


def _pelvis(uniform: Vector, people: Sequence[Points], ours: Points, notes: list[str]) -> Vector:
    k = uniform[0]
    depth = _measured(_DEPTH, people, ours)
    width = _measured(_WIDTH, people, ours)
    height = _first(_hip_depth_ratio, people, ours)
    missing = [
        name for name, value in (("depth", depth), ("width", width), ("height", height)) if value is None
    ]
    if missing:
        notes.append(f"MB: pelvis: {' and '.join(missing)} not measured: as its mean factor")
    return (k if depth is None else depth, k if height is None else height, k if width is None else width)


def _long_bone(
    segment: str,
    uniform: Vector,
    side: str,
    ends: Sequence[str],
    people: Sequence[Points],
    ours: Points,
    notes: list[str],
) -> Vector:
    lateral, medial = (f"{side.upper()}{name}" for name in ends)
    breadth = _measured(SegmentMeasurement((segment,), (((lateral,), (medial,)),), "breadth"), people, ours)
    length = uniform[1]
    if breadth is None:
        notes.append(f"MB: {segment}: breadth not measured ({lateral}, {medial}): as its length")
        return uniform
    return (0.5 * (length + breadth), length, breadth)


def _measured(measurement: SegmentMeasurement, people: Sequence[Points], ours: Points) -> float | None:
    return _first(partial(ratio, measurement), people, ours)


def _first(
    measure: Callable[[Points, Points], float | None], people: Sequence[Points], ours: Points
) -> float | None:
    """Of the first recording on which it can be measured."""
    return next((value for p in people if (value := measure(p, ours)) is not None), None)


def _hip_depth_ratio(person: Points, model: Points) -> float | None:
    """How far the hip centres lie below the plane of ASIS and PSIS, over the model's."""
    theirs, own = _hip_depth(person), _hip_depth(model)
    return None if theirs is None or own is None else theirs / own


def _hip_depth(points: Points) -> float | None:
    """Mean over both sides, m; the sacrum stands for both PSIS where these were not marked."""
    psis = [name if name in points else "SACR" for name in _PSIS]
    if any(name not in points for name in (*_ASIS, *psis, "hip_r", "hip_l")):
        return None
    frame: Frames = pelvis_frame(*(points[name] for name in (*_ASIS, *psis)))
    depths: Array = -np.concatenate([frame.to_local(points[f"hip_{side}"])[:, 1] for side in "rl"])
    known = depths[np.isfinite(depths)]
    return float(known.mean()) if known.size and known.mean() > 0.0 else None


def fitted_factor(values: Mapping[str, float], segment: str) -> Vector:
    """What a fit multiplied a segment's size by, along x, y and z; ones where it was not free.

    Parameters
    ----------
    values : mapping
        Parameter name to value.
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
