"""Constraints of OpenSim's: coordinates that follow others, and equations that poses obey."""

from __future__ import annotations

from collections import abc
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.errors import ModelRefused
from scaling_service.files.osim import functions
from scaling_service.files.osim.chains import read_frame
from scaling_service.files.osim.joints import NotPolynomial, substitute
from scaling_service.files.osim.library import (
    import_opensim,
    list_items,
    list_numbers,
    place_frame,
    place_in_body,
)
from scaling_service.model.body import Constraint, Coupler, Law, Marker, Segment, to_vector
from scaling_service.numerics.multibody.rigid import convert_rotation_to_vector

_BODIES = (("body_1", "location_body_1"), ("body_2", "location_body_2"))

POINTS: abc.Mapping[str, tuple[Literal["point", "distance", "line"], abc.Sequence[tuple[str, str]]]] = {
    "PointConstraint": ("point", _BODIES),
    "ConstantDistanceConstraint": ("distance", _BODIES),
    "PointOnLineConstraint": (
        "line",
        (("line_body", "point_on_line"), ("follower_body", "point_on_follower")),
    ),
}
"""Constraints between points: what they say; for both ends, the frame's socket and the name of the place."""


class NotSubstituted(Exception):
    """A coordinate enters something in which the law that it follows cannot be put in its place."""

    def __init__(self, coordinate: str) -> None:
        super().__init__(coordinate)
        self.coordinate = coordinate


def _read_coupler(constraint: Any, ranges: abc.Mapping[str, functions.Range]) -> Coupler | Constraint:
    """A coordinate that follows one other, or an equation between several."""
    name = constraint.getName()
    coupler = import_opensim().CoordinateCouplerConstraint.safeDownCast(constraint)
    names = functions.list_strings(coupler.getIndependentCoordinateNames())
    dependent = coupler.getDependentCoordinateName()
    law = functions.read_law(coupler.getFunction(), names, ranges, name)
    law = law.scale(functions.read_number(coupler, "scale_factor"))
    if names and len(law.coordinates) <= 1:
        return Coupler(dependent, next(iter(law.coordinates), names[0]), law)
    return to_equation(name, dependent, law)


def to_equation(name: str, dependent: str, law: Law) -> Constraint:
    """The constraint that a coordinate equals a law of others."""
    return Constraint(name=name, kind="law", law=Law.of(dependent) + law.scale(-1.0))


def read_constraint(constraint: Any, ranges: abc.Mapping[str, functions.Range]) -> Coupler | Constraint:
    """A coupling of coordinates, or a constraint between bodies.

    ModelRefused: of a kind that no equation between points says.
    """
    name, kind = constraint.getName(), constraint.getConcreteClassName()
    if kind == "CoordinateCouplerConstraint":
        return _read_coupler(constraint, ranges)
    library = import_opensim()
    if kind == "WeldConstraint":
        weld = library.WeldConstraint.safeDownCast(constraint)
        places = []
        for frame in (weld.getFrame1(), weld.getFrame2()):
            # The body under a frame, where the frame is in it and how it is turned (a rotation vector)
            body, _ = read_frame(frame, name)
            turn, origin = place_frame(frame)
            places.append((body, to_vector(origin), to_vector(convert_rotation_to_vector(turn))))
        ends = tuple(Marker.at(name, body, shift) for body, shift, _ in places)
        return Constraint(name=name, kind="weld", ends=ends, turns=(places[0][2], places[1][2]))
    if kind not in POINTS:
        raise ModelRefused(
            f"constraint '{name}' is a {kind}, which is not supported",
            field=name,
            remedy="Set its isEnforced to false: motions then need not obey it",
        )
    own = getattr(library, kind).safeDownCast(constraint)
    frames = list_end_frames(constraint)
    points = []
    for frame, where in frames:
        body, at = place_in_body(frame, getattr(own, f"get_{where}")())
        points.append(Marker.at(name, body, to_vector(at)))
    found = Constraint(name=name, kind=POINTS[kind][0], ends=tuple(points))
    if kind == "ConstantDistanceConstraint":
        return replace(found, distance=own.get_constant_distance())
    if kind == "PointOnLineConstraint":
        line = frames[0][0].findTransformInBaseFrame()
        along = line.xformFrameVecToBase(own.get_line_direction_vec())
        return replace(found, direction=to_vector(list_numbers(along)))
    return found


def list_end_frames(constraint: Any) -> list[tuple[Any, str]]:
    """The frames of a constraint between points, each with the name of the point's place in it."""
    cast = import_opensim().PhysicalFrame.safeDownCast
    _, ends = POINTS[constraint.getConcreteClassName()]
    return [(cast(constraint.getConnectee(socket)), place) for socket, place in ends]


def resolve_coupler(dependent: str, direct: abc.Mapping[str, tuple[str, Coupler]]) -> Coupler:
    """A coordinate's coupling to one that itself follows none (NotSubstituted: there is none)."""
    coupler = direct[dependent][1]
    passed = {dependent}
    while (independent := coupler.independent) in direct:
        if independent in passed:
            raise NotSubstituted(independent)
        passed.add(independent)
        inner = direct[independent][1]
        law = _substitute(coupler.law, independent, inner.law)
        coupler = Coupler(dependent, inner.independent, law, coupler.kind)
    return coupler


def substitute_coupler(segment: Segment, follows: abc.Mapping[str, Coupler]) -> Segment:
    """The segment with its dependent coordinates replaced by what they follow."""
    joints = (replace(joint, law=substitute_all(joint.law, follows)) for joint in segment.joints)
    return replace(segment, joints=tuple(joints))


def substitute_all(law: Law, follows: abc.Mapping[str, Coupler]) -> Law:
    """The law with all its dependent coordinates replaced (NotSubstituted: one cannot be)."""
    for coordinate in sorted(law.coordinates & follows.keys()):
        law = _substitute(law, coordinate, follows[coordinate].law)
    return law


def _substitute(law: Law, coordinate: str, follows: Law) -> Law:
    try:
        return substitute(law, coordinate, follows)
    except NotPolynomial as error:
        raise NotSubstituted(coordinate) from error


def list_ends(model: Any) -> list[tuple[Any, Array, abc.Callable[[Any], None]]]:
    """Ends of constraints that OpenSim does not scale: frame, place in the body, and how to write another."""
    found = []
    for constraint in list_items(model.getConstraintSet()):
        if constraint.getConcreteClassName() in POINTS:
            own = getattr(import_opensim(), constraint.getConcreteClassName()).safeDownCast(constraint)
            for frame, name in list_end_frames(constraint):
                _, place = place_in_body(frame, getattr(own, f"get_{name}")())
                found.append((frame, np.array(place), getattr(own, f"set_{name}")))
    return found
