"""A model as limbs: axes that move by one number each, as other engines have them."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass, field, replace

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.errors import ModelRefused
from scaling_service.model import body
from scaling_service.model.compile import evaluate_law
from scaling_service.numerics.multibody.rigid import rotate_about


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DrivenAxis:
    """One turn about, or shift along, an axis."""

    name: str  # the coordinate's where the axis moves as it does, else made of segment, kind and number
    kind: str  # rotation or translation
    axis: Array  # (3,), unit vector in the frame reached so far
    term: body.Term  # its value, rad or m: a term of one coordinate
    leads: bool  # whether the value is the coordinate itself
    before: Array  # (4, 4): the fixed frame between the axis before, or the parent, and this one

    def value(self, coordinates: abc.Mapping[str, Array]) -> Array:
        """What the axis moves by, rad or m, at values of the coordinates."""
        return np.asarray(evaluate_law(body.Law((self.term,)), coordinates))


@dataclass(frozen=True, slots=True, eq=False)
class Limb:
    """A segment with the axes that carry it from its parent."""

    segment: body.Segment
    axes: tuple[DrivenAxis, ...]
    last: Array  # (4, 4): from the last axis to the segment's frame

    @property
    def at_rest(self) -> Array:
        """The segment in its parent where all axes are at zero, (4, 4)."""
        frame = np.eye(4)
        for axis in self.axes:
            frame = frame @ axis.before
        return frame @ self.last


def list_limbs(model: body.BodyModel) -> tuple[Limb, ...]:
    """The model's segments, parents first; locked coordinates stand at their default.

    ValueError: parameters are not folded into the laws.
    ModelRefused: a joint moves by a function of several coordinates.
    """
    if model.parameters:
        raise ValueError("fold the parameters into the laws first")
    for segment, joint in model.joints():
        if any(t.surface is not None for t in joint.law.terms):
            raise ModelRefused(
                f"joint '{segment.joint_name}' moves by a function of several coordinates, and the format's"
                " axes by one each",
                field=segment.joint_name,
                remedy="Leave out the export; the .osim and the JSON model hold the joint",
            )
    fixed = {c.name: c.default for c in model.coordinates if c.locked}
    leading: set[str] = set()
    limbs = []
    for segment in model.segments:
        axes: list[DrivenAxis] = []
        frame = np.eye(4)
        for joint in segment.joints:
            terms = [t for t in joint.law.terms if t.coordinate is not None and t.coordinate not in fixed]
            constant = sum(
                float(evaluate_law(body.Law((t,)), fixed)) for t in joint.law.terms if t not in terms
            )
            frame = frame @ displace(joint, constant)
            for term in terms:
                coordinate, axis = str(term.coordinate), np.asarray(joint.axis, dtype=float)
                leads = abs(term.gain) == 1.0 and term.shape is None and coordinate not in leading
                if leads:
                    leading.add(coordinate)
                driven = DrivenAxis(
                    name=coordinate if leads else f"{segment.name}_{joint.kind}_{len(axes)}",
                    kind=joint.kind,
                    axis=axis * term.gain if leads else axis,
                    term=replace(term, gain=1.0) if leads else term,
                    leads=leads,
                    before=frame,
                )
                axes.append(driven)
                frame = np.eye(4)
        limbs.append(Limb(segment, tuple(axes), frame))
    return tuple(limbs)


def displace(joint: body.Joint, value: float) -> Array:
    """The move of a joint by a value, (4, 4)."""
    frame = np.eye(4)
    if joint.kind == "translation":
        frame[:3, 3] = value * np.asarray(joint.axis)
    else:
        frame[:3, :3] = rotate_about(joint.axis, value)
    return frame


def list_axes_at_rest(limb: Limb) -> abc.Iterator[tuple[DrivenAxis, Array, Array]]:
    """Each axis with its direction and a point on it, (3,) each, in the segment's frame at rest."""
    onwards: Array = limb.last
    for axis in reversed(limb.axes):
        back: Array = np.asarray(np.linalg.inv(onwards), dtype=float)
        yield axis, back[:3, :3] @ axis.axis, back[:3, 3]
        onwards = axis.before @ onwards


def list_following(model: body.BodyModel) -> list[str]:
    """The axes that follow coordinates by functions, as one sentence or none."""
    following = [a for limb in list_limbs(model) for a in limb.axes if not a.leads]
    names = sorted({str(a.term.coordinate) for a in following})
    said = f"{len(following)} axes follow {', '.join(names)}: {', '.join(a.name for a in following)}"
    return [said] if following else []


def list_uncarried(model: body.BodyModel, *, muscles: bool = True) -> tuple[str, ...]:
    """What axes do not say of the model, in plain sentences; ``muscles``: whether these are not carried."""
    said: list[str] = []
    if model.constraints:
        said.append(f"constraints are not carried: {', '.join(c.name for c in model.constraints)}")
    skin = [m.name for m in model.markers if not all(law.is_constant for law in m.laws)]
    if skin:
        said.append(f"markers that move with joints are fixed where they are nominally: {', '.join(skin)}")
    locked = [c.name for c in model.coordinates if c.locked]
    if locked:
        said.append(f"locked coordinates are fixed at their default: {', '.join(locked)}")
    said.append(f"{'muscles, wrapping surfaces and ' if muscles else ''}meshes are not carried")
    return tuple(said)


@dataclass(frozen=True, slots=True)
class Skeleton:
    """The text of a file, and what it does not carry of the model, in plain sentences."""

    text: str
    left_out: tuple[str, ...]
    changed: abc.Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # of muscles, one by one


def format_numbers(values: object) -> str:
    """Numbers in a row, exactly."""
    return " ".join(f"{value:.17g}" for value in np.asarray(values, dtype=float))
