"""One pose of a body model, written out plainly: where its segments and markers are.

For a single pose (the neutral one, a drawing, a segment's length) and as an independent oracle
for the kernels that do the same for thousands of frames at once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from scaling_service.model.body import GROUND, BodyModel, Joint, Law, Marker, Shape, Term

Array = NDArray[np.float64]
Frame = tuple[Array, Array]
"""Rotation (3, 3) that maps the frame to ground, and its origin in ground (3,), m."""


def model_values(model: BodyModel, values: Mapping[str, float] | None = None) -> dict[str, float]:
    """Coordinates at their default and parameters at their value, unless ``values`` says otherwise.

    Parameters
    ----------
    values : mapping, optional
        Coordinate or parameter name to its value, rad or m.

    Raises
    ------
    KeyError
        A name that the model does not have.
    """
    known = {c.name: c.default for c in model.coordinates} | {p.name: p.value for p in model.parameters}
    for name, value in (values or {}).items():
        if name not in known:
            raise KeyError(name)
        known[name] = float(value)
    return known


def neutral_frames(model: BodyModel, values: Mapping[str, float] | None = None) -> dict[str, Frame]:
    """The frame of every segment in one pose, signals at zero.

    Parameters
    ----------
    values : mapping, optional
        Coordinates (or parameters) that differ from the default, rad or m.

    Returns
    -------
    dict
        Segment to ``(R_ground_segment, origin_ground)``, shapes (3, 3) and (3,), m; ground included.

    Examples
    --------
    >>> from scaling_service.model.body import BodyModel, Coordinate, Joint, Law, Segment
    >>> lift = Joint("translation", (0.0, 1.0, 0.0), Law.of("height"))
    >>> model = BodyModel("lift", (Segment("cage", "ground", "shaft", (lift,)),), (Coordinate("height"),))
    >>> neutral_frames(model, {"height": 2.0})["cage"][1].tolist()
    [0.0, 2.0, 0.0]
    """
    known = model_values(model, values)
    frames: dict[str, Frame] = {GROUND: (np.eye(3), np.zeros(3))}
    for segment in model.segments:
        frames[segment.name] = follow(segment.joints, known, frames[segment.parent])
    return frames


def follow(joints: Sequence[Joint], values: Mapping[str, float], start: Frame | None = None) -> Frame:
    """The frame that a chain of joints leads to from ``start`` (by default from its own parent's frame)."""
    rotation, origin = start if start is not None else (np.eye(3), np.zeros(3))
    for joint in joints:
        value = law_value(joint.law, values)
        if joint.kind == "translation":
            origin = origin + rotation @ (value * np.asarray(joint.axis))
        else:
            rotation = rotation @ _turn(np.asarray(joint.axis), value)
    return rotation, origin


def neutral_markers(model: BodyModel, values: Mapping[str, float] | None = None) -> dict[str, Array]:
    """Position of every marker in ground in one pose, each (3,), m; see :func:`neutral_frames`."""
    known, frames = model_values(model, values), neutral_frames(model, values)
    positions = {}
    for marker in model.markers:
        rotation, origin = frames[marker.segment]
        positions[marker.name] = origin + rotation @ marker_position(marker, known)
    return positions


def marker_position(marker: Marker, values: Mapping[str, float]) -> Array:
    """A marker's position in its segment's frame, (3,), m."""
    return np.array([law_value(law, values) for law in marker.laws])


def law_value(law: Law, values: Mapping[str, float]) -> float:
    """A law's value, signals at zero; ``values`` holds the coordinates and parameters by name."""
    return sum((_term_value(term, values) for term in law.terms), 0.0)


def _term_value(term: Term, values: Mapping[str, float]) -> float:
    if term.signal is not None:
        return 0.0
    factor = 1.0 if term.parameter is None else values[term.parameter]
    if term.coordinate is not None:
        x = values[term.coordinate]
        factor *= x if term.shape is None else shape_value(term.shape, x)
    return term.gain * factor


def shape_value(shape: Shape, x: float) -> float:
    """A piecewise polynomial at ``x``, continued with its end slopes outside its breaks."""
    inside = min(max(x, shape.breaks[0]), shape.breaks[-1])
    piece = int(np.searchsorted(shape.breaks[1:-1], inside, side="right"))
    local, polynomial = inside - shape.breaks[piece], np.asarray(shape.coefficients[piece], dtype=float)
    value = np.polyval(polynomial, local)
    if x != inside:
        value += np.polyval(np.polyder(polynomial), local) * (x - inside)
    return float(value)


def _turn(axis: Array, angle: float) -> Array:
    """Rotation matrix about a unit axis, by Rodrigues' formula written with outer products."""
    along = np.outer(axis, axis)
    across = np.cross(np.eye(3), axis)  # rows e_i x axis, so that across @ v = axis x v
    rotation: Array = along + np.cos(angle) * (np.eye(3) - along) + np.sin(angle) * across
    return rotation
