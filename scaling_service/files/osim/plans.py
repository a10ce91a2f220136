"""A body model as bodies and OpenSim custom joints: what can be written, and what cannot by name."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.errors import ModelRefused
from scaling_service.files.osim.shapes import EXACT, NotPolynomial, one_shape, values
from scaling_service.model.body import BodyModel, Coordinate, Joint, Law, Segment, Shape
from scaling_service.numerics.multibody.rigid import rotation_about

Array = NDArray[np.float64]
Json = dict[str, Any]

_PARALLEL = 1e-9
"""Sine below which two axes count as one (chosen: far below OpenSim's own limit for axes that differ)."""
_COLLINEAR = 1e-5
"""Sine below which OpenSim's CustomJoint refuses two axes (CustomJoint::extendFinalizeFromProperties)."""
_FORBIDDEN = "\\/*+ \t\n"
"""Characters that OpenSim refuses in names (Component::extendFinalizeFromProperties)."""
_REMEDY = "OpenSim's CustomJoint has up to three translations followed by up to three rotations"


def plan_joints(model: BodyModel) -> tuple[list[Json], list[Json]]:
    """All joints as custom (or, where nothing moves, weld) joints, and the couplers they need.

    A coordinate of OpenSim's belongs to one joint. Where a second joint follows it, that joint gets
    a coordinate of its own that a coupler keeps equal to the first.

    Raises ModelRefused: a chain of moves that a CustomJoint cannot hold; ``field`` names the joint.
    """
    known = {c.independent: c.dependent for c in model.couplers if c.law == Law.of(c.independent)}
    taken: set[str] = set()
    plans, couplers = [], []
    for segment in model.segments:
        plan = _planned(segment)
        for name in sorted({axis["coordinate"] for axis in plan["axes"]} - {None}):
            own = name
            if name in taken:
                own = known.pop(name, f"{name}_of_{segment.joint_name}")
                couplers.append({"name": f"{own}_coupler", "independent": name, "dependent": own})
            taken.add(own)
            for axis in plan["axes"]:
                axis["coordinate"] = own if axis["coordinate"] == name else axis["coordinate"]
        plans.append(plan)
    return plans, couplers


def _refused(segment: Segment, problem: str, remedy: str = _REMEDY) -> ModelRefused:
    return ModelRefused(f"joint '{segment.joint_name}' {problem}", field=segment.joint_name, remedy=remedy)


@dataclass
class _Form:
    """A chain in OpenSim's order: offset, translations, rotations, offset."""

    rotation: Array = field(default_factory=lambda: np.eye(3))
    shift: Array = field(default_factory=lambda: np.zeros(3))
    translations: list[tuple[Array, Law]] = field(default_factory=list)
    rotations: list[tuple[Array, Law]] = field(default_factory=list)
    after_rotation: Array = field(default_factory=lambda: np.eye(3))
    after_shift: Array = field(default_factory=lambda: np.zeros(3))


def _planned(segment: Segment) -> Json:
    form = _normal_form(segment)
    axes: list[Json] = []
    if form.translations or form.rotations:
        for chosen, what in ((form.rotations, "rotation"), (form.translations, "translation")):
            axes += _three_axes(segment, chosen, what)
    # The child's frame as seen from its body is the inverse of what follows the last move.
    back = form.after_rotation.T
    return {
        "name": segment.joint_name,
        "parent": segment.parent,
        "child": segment.name,
        "parent_offset": {"translation": form.shift.tolist(), "rotation": form.rotation.tolist()},
        "child_offset": {"translation": (-back @ form.after_shift).tolist(), "rotation": back.tolist()},
        "axes": axes,
    }


def _normal_form(segment: Segment) -> _Form:
    """Push constant rotations to the end of the chain and constant shifts to the front."""
    form = _Form()
    moving = [k for k, joint in enumerate(segment.joints) if not joint.law.is_constant]
    first = moving[0] if moving else len(segment.joints)
    last = moving[-1] if moving else len(segment.joints)
    for joint in segment.joints[:first]:
        form.rotation, form.shift = _after(form.rotation, form.shift, joint)
    for joint in segment.joints[first : last + 1]:
        _take(segment, form, joint)
    for joint in segment.joints[last + 1 :]:
        form.after_rotation, form.after_shift = _after(form.after_rotation, form.after_shift, joint)
    return form


def _after(rotation: Array, shift: Array, joint: Joint) -> tuple[Array, Array]:
    """A constant transform followed by a constant joint."""
    value, axis = joint.law.constant_part, np.array(joint.axis)
    if joint.kind == "translation":
        return rotation, shift + rotation @ (value * axis)
    return rotation @ rotation_about(axis, value), shift


def _take(segment: Segment, form: _Form, joint: Joint) -> None:
    """Add one joint between the first and the last moving one."""
    axis = form.after_rotation @ np.array(joint.axis)
    if joint.kind == "rotation":
        if joint.law.is_constant:
            form.after_rotation = form.after_rotation @ rotation_about(joint.axis, joint.law.constant_part)
        else:
            _append(form.rotations, axis, joint.law, only_last=True)
    elif form.rotations:
        raise _refused(segment, "translates between its rotations")
    elif joint.law.is_constant:
        form.shift = form.shift + form.rotation @ (joint.law.constant_part * axis)
    else:
        _append(form.translations, axis, joint.law, only_last=False)


def _append(axes: list[tuple[Array, Law]], axis: Array, law: Law, *, only_last: bool) -> None:
    """Add a move, joined with one about the same axis (of rotations only with the one just before)."""
    candidates = range(len(axes) - 1, max(-1, len(axes) - 2) if only_last else -1, -1)
    for k in candidates:
        if np.linalg.norm(np.cross(axes[k][0], axis)) < _PARALLEL:
            sign = float(np.sign(axes[k][0] @ axis))
            axes[k] = (axes[k][0], axes[k][1] + law.scaled(sign))
            return
    axes.append((axis, law))


def _three_axes(segment: Segment, chosen: Sequence[tuple[Array, Law]], what: str) -> list[Json]:
    if len(chosen) > 3:
        raise _refused(segment, f"has {len(chosen)} moving {what}s")
    directions = [axis for axis, _ in chosen]
    for k, a in enumerate(directions):
        if any(np.linalg.norm(np.cross(a, b)) < _COLLINEAR for b in directions[:k]):
            raise _refused(segment, f"has two {what} axes that are parallel")
    axes = [{"axis": axis.tolist(), **_driven(segment, law)} for axis, law in chosen]
    idle = {"coordinate": None, "function": {"kind": "Constant", "value": 0.0}}
    return axes + [{"axis": a.tolist(), **idle} for a in _completed(directions)]


def _completed(axes: Sequence[Array]) -> list[Array]:
    """Directions for the unused axes, well away from the used ones."""
    if not axes:
        return list(np.eye(3))
    if len(axes) == 3:
        return []
    second = axes[1] if len(axes) == 2 else np.eye(3)[int(np.argmin(np.abs(axes[0])))]
    third = np.cross(axes[0], second)
    third /= np.linalg.norm(third)
    return [third] if len(axes) == 2 else [np.cross(third, axes[0]), third]


def _driven(segment: Segment, law: Law) -> Json:
    """The coordinate and function of one axis."""
    if any(t.parameter is not None or t.signal is not None for t in law.terms):
        raise _refused(segment, "depends on a free parameter or signal", "Fold the parameters in first")
    names = {t.coordinate for t in law.terms if t.coordinate is not None}
    if len(names) > 1:
        raise _refused(
            segment, f"adds functions of {', '.join(sorted(names))} on one axis", "Use one per axis"
        )
    (name,) = names
    return {"coordinate": name, "function": _function(segment, law)}


def _function(segment: Segment, law: Law) -> Json:
    if all(t.shape is None for t in law.terms):
        slope = sum(t.gain for t in law.terms if t.coordinate is not None)
        return {"kind": "LinearFunction", "slope": slope, "intercept": law.constant_part}
    try:
        shape = one_shape(law)
    except NotPolynomial as error:
        raise _refused(segment, f"has a law that is {error}") from error
    single = _single_polynomial(shape)
    if single is not None:
        return {"kind": "PolynomialFunction", "coefficients": single}
    straight = all(not any(piece[:-2]) for piece in shape.coefficients)
    return {
        "kind": "PiecewiseLinearFunction" if straight else "SimmSpline",
        "x": list(shape.breaks),
        "y": values(shape, np.array(shape.breaks)).tolist(),
    }


def _single_polynomial(shape: Shape) -> list[float] | None:
    """Coefficients in the coordinate itself, if all pieces are one polynomial (highest power first)."""
    middle = len(shape.coefficients) // 2
    local = np.poly1d(shape.coefficients[middle])
    breaks = np.array(shape.breaks)
    between = np.concatenate([breaks[:-1] + f * np.diff(breaks) for f in (0.0, 0.37, 0.81)])
    there = values(shape, between)
    size = max(1e-3, float(np.abs(there).max()))
    if np.abs(local(between - breaks[middle]) - there).max() > EXACT * size:
        return None
    moved = local(np.poly1d([1.0, -breaks[middle]]))
    return [float(c) for c in np.atleast_1d(moved.coeffs)]


def plan_bodies(model: BodyModel) -> list[Json]:
    """Masses, centres of mass and inertias."""
    return [
        {"name": s.name, "mass": s.mass, "com": list(s.com), "inertia": list(s.inertia)}
        for s in model.segments
    ]


def plan_coordinates(model: BodyModel) -> list[Json]:
    """Coordinates that drive something, with finite ranges, for OpenSim has no open ones."""
    used = {t.coordinate for _, joint in model.joints() for t in joint.law.terms}
    return [
        {
            "name": c.name,
            "lower": c.lower if np.isfinite(c.lower) else -_open_end(c),
            "upper": c.upper if np.isfinite(c.upper) else _open_end(c),
            "default": c.default,
            "clamped": c.clamped,
            "locked": c.locked,
        }
        for c in model.coordinates
        if c.name in used
    ]


def _open_end(coordinate: Coordinate) -> float:
    """What stands for infinity (rad or m): OpenSim's own default where the range does not bind."""
    return 1000.0 if coordinate.clamped else 10.0  # chosen: 1000 is beyond any laboratory


def plan_markers(model: BodyModel) -> list[Json]:
    """Markers at fixed positions.

    Raises ModelRefused: a marker that moves on its segment, which OpenSim's markers cannot.
    """
    for marker in model.markers:
        if not all(law.is_constant for law in marker.laws):
            raise ModelRefused(
                f"marker '{marker.name}' moves on its segment, which OpenSim cannot represent",
                field=marker.name,
                remedy="Write it without its soft tissue law; the JSON model keeps the law",
            )
    return [
        {"name": m.name, "body": m.segment, "position": list(m.nominal), "fixed": m.anatomical}
        for m in model.markers
    ]


def model_name(model: BodyModel) -> str:
    """The model's name without the characters that OpenSim's names cannot have."""
    return re.sub(f"[{re.escape(_FORBIDDEN)}]", "_", model.name) or "model"


def check_names(model: BodyModel) -> None:
    """Refuse segments, joints, coordinates and markers whose names OpenSim does not accept."""
    joints = [s.joint_name for s in model.segments]
    for name in (*model.segment_names, *joints, *model.coordinate_names, *model.marker_names):
        if not name or set(name) & set(_FORBIDDEN):
            raise ModelRefused(
                f"OpenSim does not accept the name '{name}'",
                field=name,
                remedy="Rename it without spaces, slashes, '*' and '+'",
            )


def request_to_build(model: BodyModel) -> Mapping[str, Any]:
    """What the worker needs to build the model from nothing."""
    joints, couplers = plan_joints(model)
    return {
        "operation": "build",
        "name": model_name(model),
        "bodies": plan_bodies(model),
        "joints": joints,
        "couplers": couplers,
        "coordinates": plan_coordinates(model),
        "markers": plan_markers(model),
    }
