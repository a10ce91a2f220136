"""Chains as OpenSim's custom joints, and their functions as piecewise polynomials, fitted exactly."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.errors import ModelRefused
from scaling_service.model import body
from scaling_service.model import compile as compiling
from scaling_service.numerics.multibody.rigid import rotate_about

Function = abc.Callable[[float], float]

EXACT = 1e-9
"""How far a fit may miss the function, relative to its size (chosen: far above rounding, far below 1 µm)."""

REACH = 2.0 * float(np.pi)
"""How far beyond the last break a function that does not continue linearly is followed (chosen: a turn)."""

MAX_DEGREE = 12  # the highest degree of a composition (chosen: above it, fitted powers lose their digits)

_PARALLEL = 1e-9
"""Sine below which two axes count as one (chosen: far below OpenSim's own limit for axes that differ)."""
_COLLINEAR = 1e-5
"""Sine below which OpenSim's CustomJoint refuses two axes (CustomJoint::extendFinalizeFromProperties)."""
_REMEDY = "OpenSim's CustomJoint has up to three translations followed by up to three rotations"


class NotPolynomial(ValueError):
    """A function is not a polynomial of the supposed degree between its breaks."""


def fit_piecewise(
    function: Function, breaks: abc.Sequence[float], degree: int, *, follow_ends: bool = True
) -> body.Shape:
    """The piecewise polynomial that equals a function between breaks, and beyond them.

    ``function``: value of the function at one coordinate (rad or m). ``degree``: at least the degree of
    every piece. ``follow_ends``: whether to add a piece of length REACH at an end where the function does
    not continue linearly. Raises NotPolynomial if the function differs from the fit between the points that
    were fitted.
    """
    inner = list(breaks)
    shape = _fit(function, inner, degree)
    extended = list(inner)
    if follow_ends and not _is_equal(shape, function, [inner[0] - 0.5 * REACH, inner[0] - REACH]):
        extended.insert(0, inner[0] - REACH)
    if follow_ends and not _is_equal(shape, function, [inner[-1] + 0.5 * REACH, inner[-1] + REACH]):
        extended.append(inner[-1] + REACH)
    if len(extended) > len(inner):
        shape = _fit(function, extended, degree)
    between = [a + f * (b - a) for a, b in pairwise(extended) for f in (0.13, 0.59)]
    if not _is_equal(shape, function, between):
        raise NotPolynomial(f"not a polynomial of degree {degree} between its breaks")
    return shape


def _fit(function: Function, breaks: abc.Sequence[float], degree: int) -> body.Shape:
    # Chebyshev points keep the small linear system well conditioned.
    nodes = 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree) if degree else np.array([0.5])
    powers = np.vander(nodes, degree + 1)
    pieces = []
    for start, end in pairwise(breaks):
        width = end - start
        values = np.array([function(float(start + width * u)) for u in nodes])
        unit = np.linalg.solve(powers, values)
        pieces.append(tuple(float(c) for c in unit / width ** np.arange(degree, -1, -1)))
    return body.Shape(tuple(float(b) for b in breaks), tuple(pieces))


def _is_equal(shape: body.Shape, function: Function, points: abc.Sequence[float]) -> bool:
    wanted = np.array([function(float(x)) for x in points])
    size = max(1e-3, float(np.abs(wanted).max()))
    return bool(np.abs(compiling.evaluate_shape(shape, points) - wanted).max() <= EXACT * size)


def evaluate_at(law: body.Law, x: float) -> float:
    """Value of a law of one coordinate and no parameter at one coordinate value."""
    return float(compiling.evaluate_law(law, dict.fromkeys(law.coordinates, x)))


def list_breaks(law: body.Law) -> list[float]:
    """All breaks of a law's shapes, increasing."""
    return sorted({b for term in law.terms if term.shape is not None for b in term.shape.breaks})


def find_degree(law: body.Law) -> int:
    """The highest degree among a law's terms."""
    degrees = [0]
    for term in law.terms:
        if term.shape is not None:
            degrees.append(max(len(piece) for piece in term.shape.coefficients) - 1)
        elif term.coordinate is not None:
            degrees.append(1)
    return max(degrees)


def merge_shapes(law: body.Law) -> body.Shape:
    """A law of one coordinate, with at least one shape in it, as a single shape.

    Raises NotPolynomial: cannot happen for laws of shapes, lines and constants; kept as the check of the
    fit.
    """
    return fit_piecewise(lambda x: evaluate_at(law, x), list_breaks(law), find_degree(law), follow_ends=False)


def substitute(law: body.Law, coordinate: str, follows: body.Law) -> body.Law:
    """A law with one coordinate replaced by the law of another coordinate that it follows.

    ``coordinate``: the dependent coordinate. ``follows``: its value; of at most one coordinate. Raises
    NotPolynomial if the composition's degree is above MAX_DEGREE, or the coordinate enters a surface.
    """
    terms: list[body.Term] = []
    for term in law.terms:
        if term.surface is not None and coordinate in term.surface.coordinates:
            raise NotPolynomial(f"'{coordinate}' enters a function of several coordinates")
        if term.coordinate != coordinate:
            terms.append(term)
        elif term.shape is None:
            terms.extend(follows.scale(term.gain).terms)
        else:
            terms.extend(_compose_laws(term.shape, follows).scale(term.gain).terms)
    return body.Law(tuple(terms))


def _compose_laws(outer: body.Shape, inner: body.Law) -> body.Law:
    names = inner.coordinates
    if not names:
        at = np.array(inner.constant_part)
        return body.Law.constant(float(compiling.evaluate_shape(outer, at)))
    (name,) = names
    if inner == body.Law.of(name):
        return body.Law((body.Term(1.0, coordinate=name, shape=outer),))
    degree = max(len(piece) for piece in outer.coefficients) - 1
    degree *= find_degree(inner)
    if degree > MAX_DEGREE:
        raise NotPolynomial(f"the composition has degree {degree}, above {MAX_DEGREE}")
    shape = fit_piecewise(
        lambda x: float(compiling.evaluate_shape(outer, evaluate_at(inner, x))),
        _find_crossings(outer, inner),
        degree,
        follow_ends=False,
    )
    return body.Law((body.Term(1.0, coordinate=name, shape=shape),))


def _find_crossings(outer: body.Shape, inner: body.Law) -> list[float]:
    """Where the inner law has a break or its value crosses a break of the outer shape.

    A curved inner law is followed by REACH beyond its breaks, and not further.
    """
    known = list_breaks(inner)
    if not known:
        slope = evaluate_at(inner, 1.0) - evaluate_at(inner, 0.0)
        offset = evaluate_at(inner, 0.0)
        return sorted((b - offset) / slope for b in outer.breaks)
    known = [known[0] - REACH, *known, known[-1] + REACH]
    pieces = _fit(lambda x: evaluate_at(inner, x), known, find_degree(inner))
    found = set(known)
    for start, end, piece in zip(known, known[1:], pieces.coefficients, strict=False):
        for level in outer.breaks:
            moved = np.array(piece)
            moved[-1] -= level
            nothing = np.abs(moved) < 1e-14 * np.abs(moved).max(initial=1e-300)
            roots = [float(r.real) for r in np.roots(np.where(nothing, 0.0, moved)) if abs(r.imag) < 1e-9]
            found.update(start + root for root in roots if 0.0 < root < end - start)
    # Sorted, with points closer than rounding merged.
    kept: list[float] = []
    for point in sorted(found):
        if not kept or point - kept[-1] > 1e-9:
            kept.append(point)
    return kept


@dataclass(frozen=True, slots=True)
class Offset:
    """Where a joint's frame lies in a body."""

    shift: Array  # (3,), m
    rotation: Array  # (3, 3)


@dataclass(frozen=True, slots=True)
class Axis:
    """One of a custom joint's six axes, with its coordinate and law; idle without."""

    direction: Array
    coordinate: str | None = None
    law: body.Law = field(default_factory=body.Law)


@dataclass(frozen=True, slots=True, kw_only=True)
class CustomJoint:
    """Three rotations and three translations; a weld where there are no axes."""

    name: str
    parent: str
    child: str
    parent_offset: Offset
    child_offset: Offset
    axes: tuple[Axis, ...]


@dataclass(frozen=True, slots=True)
class EqualCoordinates:
    """A constraint that keeps one coordinate equal to another."""

    independent: str
    dependent: str


def plan_joints(model: body.BodyModel) -> tuple[list[CustomJoint], list[EqualCoordinates]]:
    """All joints as custom (or, where nothing moves, weld) joints, and the couplers they need.

    A coordinate of OpenSim's belongs to one joint. Where a second joint follows it, that joint gets
    a coordinate of its own that a coupler keeps equal to the first.

    Raises ModelRefused: a chain of moves that a CustomJoint cannot hold; ``field`` names the joint.
    """
    known = {c.independent: c.dependent for c in model.couplers if c.law == body.Law.of(c.independent)}
    taken: set[str] = set()
    plans: list[CustomJoint] = []
    couplers: list[EqualCoordinates] = []
    for segment in model.segments:
        plan, own = _plan(segment), {}
        for name in sorted({axis.coordinate for axis in plan.axes if axis.coordinate is not None}):
            own[name] = name
            if name in taken:
                own[name] = known.pop(name, f"{name}_of_{segment.joint_name}")
                couplers.append(EqualCoordinates(name, own[name]))
            taken.add(own[name])
        axes = tuple(replace(axis, coordinate=own.get(axis.coordinate or "")) for axis in plan.axes)
        plans.append(replace(plan, axes=axes))
    return plans, couplers


def _refuse_joint(segment: body.Segment, problem: str, remedy: str = _REMEDY) -> ModelRefused:
    return ModelRefused(f"joint '{segment.joint_name}' {problem}", field=segment.joint_name, remedy=remedy)


@dataclass(kw_only=True)
class _Form:
    """A chain in OpenSim's order: offset, translations, rotations, offset."""

    rotation: Array = field(default_factory=lambda: np.eye(3))
    shift: Array = field(default_factory=lambda: np.zeros(3))
    translations: list[tuple[Array, body.Law]] = field(default_factory=list)
    rotations: list[tuple[Array, body.Law]] = field(default_factory=list)
    after_rotation: Array = field(default_factory=lambda: np.eye(3))
    after_shift: Array = field(default_factory=lambda: np.zeros(3))


def _plan(segment: body.Segment) -> CustomJoint:
    # Push constant rotations to the end of the chain and constant shifts to the front.
    form = _Form()
    moving = [k for k, joint in enumerate(segment.joints) if not joint.law.is_constant]
    first = moving[0] if moving else len(segment.joints)
    last = moving[-1] if moving else len(segment.joints)
    for joint in segment.joints[:first]:
        form.rotation, form.shift = _append_joint(form.rotation, form.shift, joint)
    for joint in segment.joints[first : last + 1]:
        # Add one joint between the first and the last moving one.
        axis = form.after_rotation @ np.array(joint.axis)
        if joint.kind == "rotation":
            if joint.law.is_constant:
                form.after_rotation = form.after_rotation @ rotate_about(joint.axis, joint.law.constant_part)
            else:
                _append(form.rotations, axis, joint.law, only_last=True)
        elif form.rotations:
            raise _refuse_joint(segment, "translates between its rotations")
        elif joint.law.is_constant:
            form.shift = form.shift + form.rotation @ (joint.law.constant_part * axis)
        else:
            _append(form.translations, axis, joint.law, only_last=False)
    for joint in segment.joints[last + 1 :]:
        form.after_rotation, form.after_shift = _append_joint(form.after_rotation, form.after_shift, joint)
    axes: tuple[Axis, ...] = ()
    if form.translations or form.rotations:
        axes = (
            *_list_three_axes(segment, form.rotations, "rotation"),
            *_list_three_axes(segment, form.translations, "translation"),
        )
    # The child's frame as seen from its body is the inverse of what follows the last move.
    back = form.after_rotation.T
    return CustomJoint(
        name=segment.joint_name,
        parent=segment.parent,
        child=segment.name,
        parent_offset=Offset(form.shift, form.rotation),
        child_offset=Offset(-back @ form.after_shift, back),
        axes=axes,
    )


def _append_joint(rotation: Array, shift: Array, joint: body.Joint) -> tuple[Array, Array]:
    """A constant transform followed by a constant joint."""
    value, axis = joint.law.constant_part, np.array(joint.axis)
    if joint.kind == "translation":
        return rotation, shift + rotation @ (value * axis)
    return rotation @ rotate_about(axis, value), shift


def _append(axes: list[tuple[Array, body.Law]], axis: Array, law: body.Law, *, only_last: bool) -> None:
    """Add a move, joined with one about the same axis (of rotations only with the one just before)."""
    candidates = range(len(axes) - 1, max(-1, len(axes) - 2) if only_last else -1, -1)
    for k in candidates:
        if np.linalg.norm(np.cross(axes[k][0], axis)) < _PARALLEL:
            sign = float(np.sign(axes[k][0] @ axis))
            axes[k] = (axes[k][0], axes[k][1] + law.scale(sign))
            return
    axes.append((axis, law))


def _list_three_axes(
    segment: body.Segment, chosen: abc.Sequence[tuple[Array, body.Law]], what: str
) -> list[Axis]:
    if len(chosen) > 3:
        raise _refuse_joint(segment, f"has {len(chosen)} moving {what}s")
    directions = [axis for axis, _ in chosen]
    for k, a in enumerate(directions):
        if any(np.linalg.norm(np.cross(a, b)) < _COLLINEAR for b in directions[:k]):
            raise _refuse_joint(segment, f"has two {what} axes that are parallel")
    driven = []
    for axis, law in chosen:
        # The only coordinate that drives an axis
        if any(t.parameter is not None for t in law.terms):
            raise _refuse_joint(segment, "depends on a free parameter", "Fold the parameters in first")
        if any(t.surface is not None for t in law.terms):
            raise _refuse_joint(
                segment,
                "glides on a surface",
                "Write it with the file that the model was made from as its source",
            )
        names = sorted(law.coordinates)
        if len(names) > 1:
            raise _refuse_joint(
                segment, f"adds functions of {', '.join(names)} on one axis", "Use one per axis"
            )
        driven.append(Axis(axis, names[0], law))
    return driven + [Axis(direction) for direction in _complete_directions(directions)]


def _complete_directions(axes: abc.Sequence[Array]) -> list[Array]:
    """Directions for the unused axes, well away from the used ones."""
    if not axes:
        return list(np.eye(3))
    if len(axes) == 3:
        return []
    second = axes[1] if len(axes) == 2 else np.eye(3)[int(np.argmin(np.abs(axes[0])))]
    third = np.cross(axes[0], second)
    third /= np.linalg.norm(third)
    return [third] if len(axes) == 2 else [np.cross(third, axes[0]), third]
