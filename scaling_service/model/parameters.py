"""Freeing numbers of a body model: scale factors, axis tilts, marker shifts.

Each function returns a new model in which a number became a named parameter, shared by all
frames; :func:`fold` turns the parameters back into plain numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from scaling_service.model.body import BodyModel, Joint, Law, Marker, Parameter, Segment, Term

_X, _Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
_LETTERS = "xyz"
_UNITS = (_X, _Y, (0.0, 0.0, 1.0))


def free_scale(
    model: BodyModel, segment: str, relative_bound: float, prior_sd: float | None = None
) -> BodyModel:
    """Free one factor for a segment's size: joint centres and markers in it move away alike.

    The parameter ``scale.<segment>`` starts at one and stays within ``1 +- relative_bound``.
    Marker shifts freed beside it are not multiplied (Puchaud 2019, eq. 2 bounds them apart).
    """
    name = f"scale.{segment}"

    def sized(law: Law) -> Law:
        return Law(tuple(_multiplied(term, name) for term in law.terms))

    def joint(item: Joint) -> Joint:
        return replace(item, law=sized(item.law)) if item.scales_with == segment else item

    def marker(item: Marker) -> Marker:
        if item.segment != segment or not item.follows_size:
            return item
        x, y, z = (
            Law(tuple(_multiplied(t, name) if _plain(t) else t for t in law.terms)) for law in item.laws
        )
        return replace(item, laws=(x, y, z))

    bounds = (1.0 - relative_bound, 1.0 + relative_bound)
    added = Parameter(name, 1.0, "1", *bounds, group="length", target=segment, prior_sd=prior_sd)
    return _with(_mapped(model, joint, marker), added)


def free_scale_axes(
    model: BodyModel, segment: str, axes: str, relative_bound: float, prior_sd: float | None = None
) -> BodyModel:
    """Free one factor for a segment's size along each of some of its axes.

    Parameters are ``scale.<segment>.<axis>``; the other axes take the mean of those freed. Otherwise
    as :func:`free_scale`. Translations along oblique axes become one for each axis of their frame.

    Parameters
    ----------
    axes : str
        Of ``xyz``, such as ``"yz"``.
    """
    names = {letter: f"scale.{segment}.{letter}" for letter in axes}
    mean = {name: 1.0 / len(names) for name in names.values()}
    shares = {letter: {names[letter]: 1.0} if letter in names else mean for letter in _LETTERS}

    def joints(item: Joint) -> tuple[Joint, ...]:
        if item.scales_with != segment:
            return (item,)
        return tuple(
            replace(item, axis=unit, law=_shared(item.law.scaled(part), shares[letter], plain_only=False))
            for letter, unit, part in zip(_LETTERS, _UNITS, item.axis, strict=True)
            if part
        )

    def marker(item: Marker) -> Marker:
        if item.segment != segment or not item.follows_size:
            return item
        x, y, z = (
            _shared(law, shares[letter], plain_only=True)
            for letter, law in zip(_LETTERS, item.laws, strict=True)
        )
        return replace(item, laws=(x, y, z))

    bounds = (1.0 - relative_bound, 1.0 + relative_bound)
    added = tuple(
        Parameter(name, 1.0, "1", *bounds, group="length", target=segment, prior_sd=prior_sd)
        for name in names.values()
    )
    segments = tuple(replace(s, joints=tuple(j for k in s.joints for j in joints(k))) for s in model.segments)
    return _with(replace(model, segments=segments, markers=tuple(map(marker, model.markers))), *added)


def _shared(law: Law, shares: Mapping[str, float], *, plain_only: bool) -> Law:
    """The law times a weighted sum of parameters: each term once for each of them."""
    terms: list[Term] = []
    for term in law.terms:
        if plain_only and not _plain(term):
            terms.append(term)
        else:
            terms += [
                replace(_multiplied(term, name), gain=share * term.gain) for name, share in shares.items()
            ]
    return Law(tuple(terms))


def _plain(term: Term) -> bool:
    return term.parameter is None and term.coordinate is None and term.signal is None


def _multiplied(term: Term, parameter: str) -> Term:
    if term.parameter is not None:
        raise ValueError(f"a term holds one parameter, and '{term.parameter}' is there already")
    return replace(term, parameter=parameter)


def free_axis(
    model: BodyModel, joint_name: str, bound_x: float, bound_y: float, prior_sd: float | None = None
) -> BodyModel:
    """Free the direction of a joint's axis: turns about x, then y, of the parent (Puchaud 2019, 2.2.4).

    A shared rotation goes before the joint's moving rotations and back after them, so the neutral
    pose stays as it is: the axis becomes ``Ry(y) Rx(x) axis``. Parameters are ``axis.<joint>.x``
    and ``.y`` (rad), within the bounds given.
    """
    names = (f"axis.{joint_name}.x", f"axis.{joint_name}.y")

    def segment(item: Segment) -> Segment:
        return replace(item, joints=_tilted(item.joints, *names)) if item.joint_name == joint_name else item

    added = tuple(
        Parameter(name, 0.0, "rad", -bound, bound, group="axis", target=joint_name, prior_sd=prior_sd)
        for name, bound in zip(names, (bound_x, bound_y), strict=True)
    )
    return _with(replace(model, segments=tuple(map(segment, model.segments))), *added)


def _tilted(joints: tuple[Joint, ...], x: str, y: str) -> tuple[Joint, ...]:
    moving = [k for k, j in enumerate(joints) if j.kind == "rotation" and not j.law.is_constant]
    if not moving:
        raise ValueError("the joint has no rotation whose axis could be turned")
    first, last = moving[0], moving[-1] + 1

    def turn(axis: tuple[float, float, float], name: str, sign: float) -> Joint:
        return Joint("rotation", axis, Law((Term(sign, parameter=name),)))

    there = (turn(_Y, y, 1.0), turn(_X, x, 1.0))
    back = (turn(_X, x, -1.0), turn(_Y, y, -1.0))
    return (*joints[:first], *there, *joints[first:last], *back, *joints[last:])


def free_marker(
    model: BodyModel, name: str, axes: str, bound: float, prior_sd: float | None = None
) -> BodyModel:
    """Free local coordinates of a marker (``axes`` such as ``"xz"``) within ``+- bound`` (m).

    Parameters are ``marker.<name>.x`` and so on.
    """
    chosen = {letter: f"marker.{name}.{letter}" for letter in axes}

    def marker(item: Marker) -> Marker:
        if item.name != name:
            return item
        x, y, z = (
            law + Law((Term(1.0, parameter=chosen[letter]),)) if letter in chosen else law
            for letter, law in zip(_LETTERS, item.laws, strict=True)
        )
        return replace(item, laws=(x, y, z))

    added = tuple(
        Parameter(parameter, 0.0, "m", -bound, bound, group="marker", target=name, prior_sd=prior_sd)
        for parameter in chosen.values()
    )
    return _with(_mapped(model, lambda joint: joint, marker), *added)


def fold(model: BodyModel, values: Mapping[str, float] | None = None) -> BodyModel:
    """The model with its parameters turned into plain numbers.

    Parameters
    ----------
    values : mapping, optional
        Parameter to value; those not named keep the model's.
    """
    known = {p.name: p.value for p in model.parameters} | dict(values or {})

    def law(item: Law) -> Law:
        terms = [
            t if t.parameter is None else replace(t, gain=t.gain * known[t.parameter], parameter=None)
            for t in item.terms
        ]
        varying = tuple(t for t in terms if not _plain(t) and t.gain != 0.0)
        return Law((*varying, *Law.constant(sum(t.gain for t in terms if _plain(t))).terms))

    def marker(item: Marker) -> Marker:
        x, y, z = map(law, item.laws)
        return replace(item, laws=(x, y, z))

    folded = _mapped(model, lambda joint: replace(joint, law=law(joint.law)), marker)
    return replace(folded, parameters=())


def _mapped(
    model: BodyModel, joint: Callable[[Joint], Joint], marker: Callable[[Marker], Marker]
) -> BodyModel:
    segments = tuple(replace(s, joints=tuple(map(joint, s.joints))) for s in model.segments)
    return replace(model, segments=segments, markers=tuple(map(marker, model.markers)))


def _with(model: BodyModel, *added: Parameter) -> BodyModel:
    return replace(model, parameters=(*model.parameters, *added))
