"""Freeing numbers of a body model: scale factors, axis tilts, marker shifts; and more freedom in the knee.

Each function returns a new model in which a number became a named parameter, shared by all
frames; :func:`fold` turns the parameters back into plain numbers.
"""

from __future__ import annotations

import math
from collections import abc
from dataclasses import replace
from typing import Literal

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.errors import SubjectInvalid
from scaling_service.model import body
from scaling_service.numerics.multibody.rigid import rotate_about

_ALONG_X, _ALONG_Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
LETTERS = "xyz"
UNITS = (_ALONG_X, _ALONG_Y, (0.0, 0.0, 1.0))

_TURNS: abc.Mapping[KneeKind, tuple[str, ...]] = {
    "hinge": (),
    "universal": ("rotation",),
    "spherical": ("adduction", "rotation"),
}
"""What follows flexion, in the order of the ISB (Grood and Suntay 1983; Wu 2002): about the floating axis,
then about the shank's. A knee's second freedom is the turn of the shank: 10 to 20 deg against a few of varus
and valgus (Grood and Suntay 1983), so that is what a joint of two axes takes."""

_KNEE_AXES: abc.Mapping[str, body.Vector] = {"adduction": (1.0, 0.0, 0.0), "rotation": (0.0, 1.0, 0.0)}

_RANGE_DEG: abc.Mapping[str, float] = {"adduction": 20.0, "rotation": 40.0}
"""To either side. Chosen: about twice what knees reach, for skin movement is taken for knee movement. They
inform the first guess, they do not bind."""

_ALONG_Z = 1.0 - 1e-9  # of an axis' z part: rounding


def free_scale(
    model: body.BodyModel, segment: str, relative_bound: float, prior_sd: float | None = None
) -> body.BodyModel:
    """Free one factor for a segment's size: joint centres and markers in it move away alike.

    The parameter ``scale.<segment>`` starts at one and stays within ``1 +- relative_bound``.
    Marker shifts freed beside it are not multiplied (Puchaud 2019, eq. 2 bounds them apart).
    """
    share = {f"scale.{segment}": 1.0}

    def resize(item: body.Joint) -> tuple[body.Joint, ...]:
        return (replace(item, law=_multiply_law(item.law, share)),)

    return _resize_segment(model, segment, resize, dict.fromkeys(LETTERS, share), relative_bound, prior_sd)


def free_scale_axes(
    model: body.BodyModel, segment: str, axes: str, relative_bound: float, prior_sd: float | None = None
) -> body.BodyModel:
    """Free one factor for a segment's size along each of some of its axes.

    Parameters are ``scale.<segment>.<axis>``; the other axes take the mean of those freed. Otherwise
    as :func:`free_scale`. Translations along oblique axes become one for each axis of their frame.

    ``axes``: of ``xyz``, such as ``"yz"``.
    """
    names = {letter: f"scale.{segment}.{letter}" for letter in axes}
    mean = {name: 1.0 / len(names) for name in names.values()}
    shares = {letter: {names[letter]: 1.0} if letter in names else mean for letter in LETTERS}

    def resize(item: body.Joint) -> tuple[body.Joint, ...]:
        return tuple(
            replace(item, axis=item.axis if item.size_axis else unit, law=_multiply_law(law, shares[letter]))
            for letter, unit, part in zip(LETTERS, UNITS, item.size_axis or item.axis, strict=True)
            if part
            for law in (item.law if item.size_axis else item.law.scale(part),)
        )

    return _resize_segment(model, segment, resize, shares, relative_bound, prior_sd)


def _resize_segment(
    model: body.BodyModel,
    segment: str,
    resized: abc.Callable[[body.Joint], tuple[body.Joint, ...]],
    shares: abc.Mapping[str, abc.Mapping[str, float]],
    relative_bound: float,
    prior_sd: float | None,
) -> body.BodyModel:
    """A segment's joint centres and markers times sums of new parameters, by their shares along each axis."""

    def marker(item: body.Marker) -> body.Marker:
        if item.segment != segment or not item.follows_size:
            return item
        x, y, z = (
            _multiply_law(law, shares[letter], constant_only=True)
            for letter, law in zip(LETTERS, item.laws, strict=True)
        )
        return replace(item, laws=(x, y, z))

    segments = tuple(
        replace(
            s, joints=tuple(j for k in s.joints for j in (resized(k) if k.scales_with == segment else (k,)))
        )
        for s in model.segments
    )
    bounds = {name: relative_bound for share in shares.values() for name in share}
    resized_model = _map_markers(replace(model, segments=segments), marker)
    return add_parameters(resized_model, bounds, "length", segment, "1", value=1.0, prior_sd=prior_sd)


def _multiply_law(law: body.Law, shares: abc.Mapping[str, float], *, constant_only: bool = False) -> body.Law:
    """The law times a weighted sum of parameters: each term once for each of them."""
    terms: list[body.Term] = []
    for term in law.terms:
        if constant_only and not term.is_constant:
            terms.append(term)
        elif term.parameter is not None:
            raise ValueError(f"a term holds one parameter, and '{term.parameter}' is there already")
        else:
            terms += [replace(term, parameter=name, gain=share * term.gain) for name, share in shares.items()]
    return body.Law(tuple(terms))


def free_axis(
    model: body.BodyModel, joint_name: str, bound_x: float, bound_y: float, prior_sd: float | None = None
) -> body.BodyModel:
    """Free the direction of a joint's axis: turns about x, then y, of the parent (Puchaud 2019, 2.2.4).

    A shared rotation goes before the joint's moving rotations and back after them, so the neutral
    pose stays as it is: the axis becomes ``Ry(y) Rx(x) axis``. Parameters are ``axis.<joint>.x``
    and ``.y`` (rad), within the bounds given.
    """
    names = (f"axis.{joint_name}.x", f"axis.{joint_name}.y")

    def segment(item: body.Segment) -> body.Segment:
        return (
            replace(item, joints=_tilt_axis(item.joints, *names)) if item.joint_name == joint_name else item
        )

    turned = replace(model, segments=tuple(map(segment, model.segments)))
    bounds = dict(zip(names, (bound_x, bound_y), strict=True))
    return add_parameters(turned, bounds, "axis", joint_name, "rad", prior_sd=prior_sd)


def _tilt_axis(joints: tuple[body.Joint, ...], x: str, y: str) -> tuple[body.Joint, ...]:
    moving = [k for k, j in enumerate(joints) if j.turns]
    if not moving:
        raise ValueError("the joint has no rotation whose axis could be turned")
    first, last = moving[0], moving[-1] + 1

    def turn(axis: tuple[float, float, float], name: str, sign: float) -> body.Joint:
        return body.Joint("rotation", axis, body.Law((body.Term(sign, parameter=name),)))

    there = (turn(_ALONG_Y, y, 1.0), turn(_ALONG_X, x, 1.0))
    back = (turn(_ALONG_X, x, -1.0), turn(_ALONG_Y, y, -1.0))
    return (*joints[:first], *there, *joints[first:last], *back, *joints[last:])


def free_marker(
    model: body.BodyModel, name: str, axes: str, bound: float, prior_sd: float | None = None
) -> body.BodyModel:
    """Free local coordinates of a marker (``axes`` such as ``"xz"``) within ``+- bound`` (m).

    Parameters are ``marker.<name>.x`` and so on.
    """
    chosen = {letter: f"marker.{name}.{letter}" for letter in axes}

    def marker(item: body.Marker) -> body.Marker:
        if item.name != name:
            return item
        x, y, z = (
            law + body.Law((body.Term(1.0, parameter=chosen[letter]),)) if letter in chosen else law
            for letter, law in zip(LETTERS, item.laws, strict=True)
        )
        return replace(item, laws=(x, y, z))

    bounds = dict.fromkeys(chosen.values(), bound)
    return add_parameters(_map_markers(model, marker), bounds, "marker", name, prior_sd=prior_sd)


def fold(model: body.BodyModel, values: abc.Mapping[str, float] | None = None) -> body.BodyModel:
    """The model with its parameters turned into plain numbers.

    ``values``: parameter to value; those not named keep the model's.
    """
    known = {p.name: p.value for p in model.parameters} | dict(values or {})

    def law(item: body.Law) -> body.Law:
        terms = [
            t if t.parameter is None else replace(t, gain=t.gain * known[t.parameter], parameter=None)
            for t in item.terms
        ]
        varying = tuple(t for t in terms if not t.is_constant and t.gain != 0.0)
        return body.Law((*varying, *body.Law.constant(sum(t.gain for t in terms if t.is_constant)).terms))

    def marker(item: body.Marker) -> body.Marker:
        x, y, z = map(law, item.laws)
        return replace(item, laws=(x, y, z))

    segments = tuple(
        replace(s, joints=tuple(replace(j, law=law(j.law)) for j in s.joints)) for s in model.segments
    )
    return _map_markers(replace(model, segments=segments, parameters=()), marker)


def _map_markers(model: body.BodyModel, marker: abc.Callable[[body.Marker], body.Marker]) -> body.BodyModel:
    """Markers, and ends of constraints, changed alike."""
    ends = (replace(c, ends=tuple(map(marker, c.ends))) for c in model.constraints)
    return replace(model, markers=tuple(map(marker, model.markers)), constraints=tuple(ends))


def add_parameters(
    model: body.BodyModel,
    bounds: abc.Mapping[str, float],
    group: str,
    target: str,
    unit: Literal["m", "rad", "1"] = "m",
    *,
    value: float = 0.0,
    prior_sd: float | None = None,
) -> body.BodyModel:
    """The model with parameters by their names, each with how far it may go to either side of its value."""
    added = (
        body.Parameter(
            name=name,
            value=value,
            unit=unit,
            lower=value - bound,
            upper=value + bound,
            group=group,
            target=target,
            prior_sd=prior_sd,
        )
        for name, bound in bounds.items()
    )
    return replace(model, parameters=(*model.parameters, *added))


KneeKind = Literal["hinge", "universal", "spherical"]


def with_knee(model: body.BodyModel, kind: KneeKind) -> body.BodyModel:
    """The model with turns added after the hinge of each knee.

    New coordinates are ``knee_adduction_r`` (varus positive) and ``knee_rotation_r`` (inward positive)
    and the left ones, each after its knee's flexion. At zero the model is as it was.

    ``kind``: flexion alone; with inward rotation; with varus and valgus as well. SubjectInvalid: the model
    has no knee, or one that is not a plain hinge about z.

    Examples
    --------
    >>> from scaling_service.model.builtin import load_builtin
    >>> with_knee(load_builtin("lower_limb_14dof"), "spherical").coordinate_names[9:12]
    ('knee_angle_r', 'knee_adduction_r', 'knee_rotation_r')
    """
    turns = _TURNS[kind]
    if not turns:
        return model
    knees = {s.name: _find_hinge(s) for s in model.segments if s.name in ("tibia_r", "tibia_l")}
    if not knees:
        raise SubjectInvalid(
            f"model '{model.name}' has no knee that could be made {kind}",
            field="knee",
            remedy="Choose a built-in leg model, or leave the knee as it is",
        )
    segments = []
    for segment in model.segments:
        joints = list(segment.joints)
        for turn in turns if segment.name in knees else ():
            # Axes x and y are reversed on the left, so that both sides carry the same clinical signs.
            side, (x, y, z) = segment.name[-1], _KNEE_AXES[turn]
            axis = (x, y, z) if side == "r" else (-x + 0.0, -y + 0.0, z)
            joints.append(body.Joint("rotation", axis, body.Law.of(f"knee_{turn}_{side}")))
        segments.append(replace(segment, joints=tuple(joints)))
    sides = {flexion: name[-1] for name, flexion in knees.items()}
    coordinates = []
    for coordinate in model.coordinates:
        coordinates.append(coordinate)
        for turn in turns if coordinate.name in sides else ():
            reach = math.radians(_RANGE_DEG[turn])
            name = f"knee_{turn}_{sides[coordinate.name]}"
            coordinates.append(body.Coordinate(name=name, lower=-reach, upper=reach))
    return replace(model, segments=tuple(segments), coordinates=tuple(coordinates))


def _find_hinge(segment: body.Segment) -> str:
    """The coordinate of a plain hinge about z, the last joint of its chain."""
    moving = [j for j in segment.joints if not j.law.is_constant]
    last = segment.joints[-1] if segment.joints else None
    if len(moving) == 1 and moving[0] is last and last.kind == "rotation" and abs(last.axis[2]) > _ALONG_Z:
        (term,) = last.law.terms or (None,)
        if term is not None and term.coordinate is not None and term.shape is None:
            return term.coordinate
    raise SubjectInvalid(
        f"'{segment.joint_name}' is not a plain hinge",
        field="knee",
        remedy="Choose a built-in leg model, or leave the knee as it is",
    )


Tilt = tuple[float, float]


def compute_axis(tilt: Tilt) -> Array:
    """The axis, (3,), that the turns make of z: ``Ry(y) Rx(x) z`` (Puchaud 2019, section 2.2.4)."""
    return tilt_rotation(tilt)[:, 2]


def tilt_rotation(tilt: Tilt) -> Array:
    """``Ry(y) Rx(x)``, (3, 3)."""
    x, y = tilt
    return rotate_about((0.0, 1.0, 0.0), y) @ rotate_about((1.0, 0.0, 0.0), x)


def tilt_of(axis: Array) -> Tilt:
    """The turns about x and y that make z point along an axis, (3,), of which z is positive.

    Examples
    --------
    >>> x, y = tilt_of(compute_axis((0.1, -0.2)))
    >>> round(x, 12), round(y, 12)
    (0.1, -0.2)
    """
    unit = axis / np.linalg.norm(axis)
    return float(-np.arcsin(unit[1])), float(np.arctan2(unit[0], unit[2]))


def compose_tilts(first: Tilt, second: Tilt) -> Tilt:
    """The tilt of an axis that was turned once and is turned again in its own turned frame."""
    return tilt_of(tilt_rotation(first) @ compute_axis(second))
