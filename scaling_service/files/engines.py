"""Scaled skeletons for other engines, with markers and inertia: MuJoCo's MJCF and biorbd's bioMod."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from scaling_service.core.errors import ModelRefused
from scaling_service.model.body import GROUND, BodyModel, Coordinate, Joint, Law, Segment, Term
from scaling_service.model.compile import evaluate_law
from scaling_service.model.trial import Array
from scaling_service.numerics.multibody.rigid import convert_vector_to_rotation, rotate_about
from scaling_service.numerics.wrench import GRAVITY

_QUARTIC = 4
_WORTH_SAYING = 1e-9  # rad or m; chosen: below it a fit is exact
_SMALLEST = 1e-6
"""kg and kg m2 of a moving body without mass, which MuJoCo refuses. Chosen: some micrograms move nothing."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DrivenAxis:
    """One turn about, or shift along, an axis."""

    name: str  # the coordinate's where the axis moves as it does, else made of segment, kind and number
    kind: str  # rotation or translation
    axis: Array  # (3,), unit vector in the frame reached so far
    term: Term  # its value, rad or m: a term of one coordinate
    leads: bool  # whether the value is the coordinate itself
    before: Array  # (4, 4): the fixed frame between the axis before, or the parent, and this one

    def value(self, coordinates: Mapping[str, Array]) -> Array:
        """What the axis moves by, rad or m, at values of the coordinates."""
        return np.asarray(evaluate_law(Law((self.term,)), coordinates))


@dataclass(frozen=True, slots=True, eq=False)
class Limb:
    """A segment with the axes that carry it from its parent."""

    segment: Segment
    axes: tuple[DrivenAxis, ...]
    last: Array  # (4, 4): from the last axis to the segment's frame

    @property
    def at_rest(self) -> Array:
        """The segment in its parent where all axes are at zero, (4, 4)."""
        frame = np.eye(4)
        for axis in self.axes:
            frame = frame @ axis.before
        return frame @ self.last


def list_limbs(model: BodyModel) -> tuple[Limb, ...]:
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
    return tuple(_make_limb(segment, fixed, leading) for segment in model.segments)


def _make_limb(segment: Segment, fixed: Mapping[str, float], leading: set[str]) -> Limb:
    axes: list[DrivenAxis] = []
    frame = np.eye(4)
    for joint in segment.joints:
        terms = [t for t in joint.law.terms if t.coordinate is not None and t.coordinate not in fixed]
        constant = sum(float(evaluate_law(Law((t,)), fixed)) for t in joint.law.terms if t not in terms)
        frame = frame @ displace(joint, constant)
        for term in terms:
            axes.append(_find_axis(segment, joint, term, frame, len(axes), leading))
            frame = np.eye(4)
    return Limb(segment, tuple(axes), frame)


def _find_axis(
    segment: Segment, joint: Joint, term: Term, frame: Array, number: int, leading: set[str]
) -> DrivenAxis:
    coordinate, axis = str(term.coordinate), np.asarray(joint.axis, dtype=float)
    if abs(term.gain) == 1.0 and term.shape is None and coordinate not in leading:
        leading.add(coordinate)
        plain = replace(term, gain=1.0)
        return DrivenAxis(
            name=coordinate, kind=joint.kind, axis=axis * term.gain, term=plain, leads=True, before=frame
        )
    name = f"{segment.name}_{joint.kind}_{number}"
    return DrivenAxis(name=name, kind=joint.kind, axis=axis, term=term, leads=False, before=frame)


def displace(joint: Joint, value: float) -> Array:
    """The move of a joint by a value, (4, 4)."""
    frame = np.eye(4)
    if joint.kind == "translation":
        frame[:3, 3] = value * np.asarray(joint.axis)
    else:
        frame[:3, :3] = rotate_about(joint.axis, value)
    return frame


def list_axes_at_rest(limb: Limb) -> Iterator[tuple[DrivenAxis, Array, Array]]:
    """Each axis with its direction and a point on it, (3,) each, in the segment's frame at rest."""
    onwards: Array = limb.last
    for axis in reversed(limb.axes):
        back: Array = np.asarray(np.linalg.inv(onwards), dtype=float)
        yield axis, back[:3, :3] @ axis.axis, back[:3, 3]
        onwards = axis.before @ onwards


def list_uncarried(model: BodyModel) -> tuple[str, ...]:
    """What a skeleton of axes driven by one number each does not say of the model, in plain sentences."""
    found = list_limbs(model)
    following = [a for limb in found for a in limb.axes if not a.leads]
    said = []
    if following:
        names = sorted({str(a.term.coordinate) for a in following})
        said.append(
            f"{len(following)} axes follow {', '.join(names)}: {', '.join(a.name for a in following)}"
        )
    if model.constraints:
        said.append(f"constraints are not carried: {', '.join(c.name for c in model.constraints)}")
    skin = [m.name for m in model.markers if not all(law.is_constant for law in m.laws)]
    if skin:
        said.append(f"markers that move with joints are fixed where they are nominally: {', '.join(skin)}")
    locked = [c.name for c in model.coordinates if c.locked]
    if locked:
        said.append(f"locked coordinates are fixed at their default: {', '.join(locked)}")
    said.append("muscles, wrapping surfaces and meshes are not carried")
    return tuple(said)


@dataclass(frozen=True, slots=True)
class Skeleton:
    """The text of a file, and what it does not carry of the model, in plain sentences."""

    text: str
    left_out: tuple[str, ...]


def write_mjcf(model: BodyModel) -> Skeleton:
    """An MJCF file, angles in rad, Y up; what it does not carry stands in a comment at its head, too.

    ValueError: the model's parameters are not folded into its laws.
    """
    found = list_limbs(model)
    root = ET.Element("mujoco", model=model.name)
    odd = [s.name for s in model.segments if _violates_triangle(s)]
    compiler = {
        "angle": "radian",
        "autolimits": "true",
        "boundmass": f"{_SMALLEST}",
        "boundinertia": f"{_SMALLEST}",
        "inertiafromgeom": "false",
        "balanceinertia": "true" if odd else "false",
    }
    ET.SubElement(root, "compiler", compiler)
    ET.SubElement(root, "option", gravity=_format_numbers(GRAVITY))
    bodies = {GROUND: ET.SubElement(root, "worldbody")}
    coordinates = {c.name: c for c in model.coordinates}
    for limb in found:
        bodies[limb.segment.name] = _write_body(bodies[limb.segment.parent], limb, coordinates)
    for marker in model.markers:
        given = {"name": marker.name, "pos": _format_numbers(marker.nominal), "size": "0.005"}
        ET.SubElement(bodies[marker.segment], "site", given)
    _add_unmoving(bodies[GROUND], found, coordinates)
    in_all, each = _tie(root, found, coordinates)
    said = [*list_uncarried(model), *in_all]
    if odd:
        said.append(f"inertias that no body has, which MuJoCo replaces by a sphere's: {', '.join(odd)}")
    ET.indent(root)
    head = "\n".join(f"  {line}" for line in (*said, *each)).replace("--", "- -")
    return Skeleton(f"<!--\n{head}\n-->\n{ET.tostring(root, encoding='unicode')}\n", tuple(said))


def _violates_triangle(segment: Segment) -> bool:
    """Whether two principal moments of inertia add up to less than the third, which no body's do."""
    xx, yy, zz, xy, xz, yz = segment.inertia
    moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return bool(moments[0] + moments[1] < moments[2])


def _write_body(parent: ET.Element, limb: Limb, coordinates: dict[str, Coordinate]) -> ET.Element:
    segment, rest = limb.segment, limb.at_rest
    x, y, z, w = Rotation.from_matrix(rest[:3, :3]).as_quat()
    body = ET.SubElement(
        parent,
        "body",
        name=segment.name,
        pos=_format_numbers(rest[:3, 3]),
        quat=_format_numbers([w, x, y, z]),
    )
    if segment.mass > 0.0:
        ET.SubElement(
            body,
            "inertial",
            pos=_format_numbers(segment.com),
            mass=_format_numbers([segment.mass]),
            fullinertia=_format_numbers(segment.inertia),
        )
    else:
        least = {"pos": "0 0 0", "mass": f"{_SMALLEST}", "diaginertia": _format_numbers([_SMALLEST] * 3)}
        ET.SubElement(body, "inertial", least)
    for axis, direction, point in reversed(list(list_axes_at_rest(limb))):
        kind = "hinge" if axis.kind == "rotation" else "slide"
        given = {
            "name": axis.name,
            "type": kind,
            "axis": _format_numbers(direction),
            "pos": _format_numbers(point),
        }
        own = coordinates[str(axis.term.coordinate)]
        if axis.leads and own.clamped and np.isfinite([own.lower, own.upper]).all():
            given["range"] = _format_numbers([own.lower, own.upper])
        ET.SubElement(body, "joint", given)
    return body


def _list_unmoving(found: tuple[Limb, ...]) -> list[str]:
    """Coordinates that move axes by functions alone, and none by their own value."""
    axes = [axis for limb in found for axis in limb.axes]
    leading = {axis.name for axis in axes if axis.leads}
    return list(dict.fromkeys(str(a.term.coordinate) for a in axes if a.term.coordinate not in leading))


def _add_unmoving(ground: ET.Element, found: tuple[Limb, ...], coordinates: dict[str, Coordinate]) -> None:
    """A body without mass for each coordinate that is no axis: its joint has the value that others follow."""
    for name in _list_unmoving(found):
        own = coordinates[name]
        body = ET.SubElement(ground, "body", name=f"value of {name}")
        least = {"pos": "0 0 0", "mass": f"{_SMALLEST}", "diaginertia": _format_numbers([_SMALLEST] * 3)}
        ET.SubElement(body, "inertial", least)
        given = {"name": name, "type": "hinge" if own.kind == "rotation" else "slide", "axis": "0 0 1"}
        if own.clamped and np.isfinite([own.lower, own.upper]).all():
            given["range"] = _format_numbers([own.lower, own.upper])
        ET.SubElement(body, "joint", given)


def _tie(
    root: ET.Element, found: tuple[Limb, ...], coordinates: dict[str, Coordinate]
) -> tuple[list[str], list[str]]:
    """Tie axes that follow to those that lead; where a polynomial is not the law, in all and axis by axis."""
    axes = [axis for limb in found for axis in limb.axes]
    ties, said = ET.SubElement(root, "equality"), []
    worst: dict[str, float] = {}
    for axis in axes:
        if axis.leads:
            continue
        name = str(axis.term.coordinate)
        coefficients, off = _fit_polynomial(axis, coordinates[name])
        ET.SubElement(ties, "joint", joint1=axis.name, joint2=name, polycoef=_format_numbers(coefficients))
        if off > _WORTH_SAYING:
            unit = "mm" if axis.kind == "translation" else "mrad"
            worst[unit] = max(worst.get(unit, 0.0), 1e3 * off)
            said.append(
                f"{axis.name} follows {name} by a quartic, off its law by up to {1e3 * off:.3g} {unit}"
            )
    most = " and ".join(f"{off:.3g} {unit}" for unit, off in sorted(worst.items()))
    in_all = (
        f"{len(said)} of these axes follow by a quartic, off their laws by up to {most}; the file lists each"
    )
    return [in_all] if said else [], said


def _fit_polynomial(axis: DrivenAxis, coordinate: Coordinate) -> tuple[Array, float]:
    """The nearest quartic over the coordinate's range, lowest power first, and how far it is off."""
    name = coordinate.name
    if axis.term.shape is None:
        return np.array([0.0, axis.term.gain, 0.0, 0.0, 0.0]), 0.0
    breaks = axis.term.shape.breaks
    x = np.linspace(max(coordinate.lower, breaks[0]), min(coordinate.upper, breaks[-1]), 200)
    y = axis.value({name: x})
    fit = np.polynomial.Polynomial.fit(x, y, _QUARTIC).convert()
    coefficients = np.pad(fit.coef, (0, _QUARTIC + 1 - len(fit.coef)))
    return np.asarray(coefficients, dtype=float), float(np.abs(fit(x) - y).max())


def write_biomod(model: BodyModel) -> Skeleton:
    """A ``.bioMod`` file, SI and rad, Y up; what it does not carry stands in comments at its head, too.

    Its degrees of freedom come in the order of :func:`list_limbs`' axes.
    ValueError: the model's parameters are not folded into its laws.
    """
    said = list_uncarried(model)
    lines = ["version 4", *(f"// {line}" for line in said), ""]
    lines += [f"gravity {_format_numbers(GRAVITY)}", ""]
    for limb in list_limbs(model):
        parent, back = "root" if limb.segment.parent == GROUND else limb.segment.parent, np.asarray(np.eye(4))
        for axis in limb.axes:
            along = _orient_along_z(axis.axis)
            lines += _write_segment(axis.name, parent, back @ axis.before @ along, _write_motion(axis))
            parent, back = axis.name, np.asarray(np.linalg.inv(along), dtype=float)
        lines += _write_segment(limb.segment.name, parent, back @ limb.last, _write_mass(limb.segment))
    for marker in model.markers:
        lines += [
            f"marker {marker.name.replace(' ', '_')}",
            f"    parent {'root' if marker.segment == GROUND else marker.segment}",
            f"    position {_format_numbers(marker.nominal)}",
            f"    anatomical {int(marker.anatomical)}",
            f"    technical {int(not marker.anatomical)}",
            "endmarker",
            "",
        ]
    return Skeleton("\n".join(lines), said)


def _write_segment(name: str, parent: str, frame: Array, more: Iterator[str]) -> list[str]:
    rows = [f"        {_format_numbers(row)}" for row in frame]
    head = [f"segment {name}", f"    parent {parent}", "    RTinMatrix 1", "    RT", *rows]
    return [*head, *more, "endsegment", ""]


def _write_motion(axis: DrivenAxis) -> Iterator[str]:
    yield f"    {'rotations' if axis.kind == 'rotation' else 'translations'} z"


def _write_mass(segment: Segment) -> Iterator[str]:
    if segment.mass <= 0.0:
        return
    xx, yy, zz, xy, xz, yz = segment.inertia
    yield f"    mass {segment.mass:.17g}"
    yield f"    CenterOfMass {_format_numbers(segment.com)}"
    yield "    inertia"
    for row in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)):
        yield f"        {_format_numbers(row)}"


def _orient_along_z(axis: Array) -> Array:
    """The frame, (4, 4), whose z lies along an axis."""
    frame, cross = np.eye(4), np.cross((0.0, 0.0, 1.0), axis)
    sine = float(np.linalg.norm(cross))
    if sine > 0.0:
        frame[:3, :3] = convert_vector_to_rotation(cross / sine * np.arctan2(sine, axis[2]))
    elif axis[2] < 0.0:
        frame[:3, :3] = np.diag([1.0, -1.0, -1.0])
    return frame


def _format_numbers(values: object) -> str:
    return " ".join(f"{value:.17g}" for value in np.asarray(values, dtype=float))


ENGINES: Mapping[str, tuple[str, Callable[[BodyModel], Skeleton]]] = MappingProxyType(
    {"mjcf": ("model.xml", write_mjcf), "biomod": ("model.bioMod", write_biomod)}
)
"""Format to the file's name and what makes its content."""
