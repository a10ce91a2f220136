"""Scaled skeletons for other engines, with markers and inertia: MuJoCo's MJCF and biorbd's bioMod.

MJCF has one body a segment, one joint an axis, one site a marker. Axes of a body turn and shift one after
the other in the frame reached so far, as ours do. An axis that follows a coordinate is a joint of its own,
tied to it by an equality: exact where it is linear, else the quartic polynomial that is nearest over the
coordinate's range, for MuJoCo knows no others (https://mujoco.readthedocs.io/en/stable/XMLreference.html,
``equality/joint``).

bioMod has one segment an axis, and one for each of ours with mass and markers. Its segments turn and shift
along their own axes only, so each axis has a segment whose z lies along it (https://github.com/pyomeca/biorbd,
"Model files"). It knows no coordinates that follow others: such an axis is a degree of freedom, whose value
the caller gives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from scaling_service.model.axes import DrivenAxis, Limb, list_axes_at_rest, list_limbs, list_uncarried
from scaling_service.model.body import GROUND, BodyModel, Coordinate, Segment
from scaling_service.model.trial import Array
from scaling_service.numerics.multibody.rigid import rotation_from_vector
from scaling_service.numerics.wrench import GRAVITY


@dataclass(frozen=True, slots=True)
class Skeleton:
    """The text of a file, and what it does not carry of the model, in plain sentences."""

    text: str
    left_out: tuple[str, ...]


_QUARTIC = 4
_WORTH_SAYING = 1e-9  # rad or m; chosen: below it a fit is exact
_SMALLEST = 1e-6
"""kg and kg m2 of a moving body without mass, which MuJoCo refuses. Chosen: some micrograms move nothing."""


def write_mjcf(model: BodyModel) -> Skeleton:
    """An MJCF file, angles in rad, Y up; what it does not carry stands in a comment at its head, too.

    ValueError: the model's parameters are not folded into its laws.
    """
    found = list_limbs(model)
    root = ET.Element("mujoco", model=model.name)
    odd = [s.name for s in model.segments if _breaks_triangle(s)]
    compiler = {
        "angle": "radian",
        "autolimits": "true",
        "boundmass": f"{_SMALLEST}",
        "boundinertia": f"{_SMALLEST}",
        "inertiafromgeom": "false",
        "balanceinertia": "true" if odd else "false",
    }
    ET.SubElement(root, "compiler", compiler)
    ET.SubElement(root, "option", gravity=_numbers(GRAVITY))
    bodies = {GROUND: ET.SubElement(root, "worldbody")}
    coordinates = {c.name: c for c in model.coordinates}
    for limb in found:
        bodies[limb.segment.name] = _body(bodies[limb.segment.parent], limb, coordinates)
    for marker in model.markers:
        given = {"name": marker.name, "pos": _numbers(marker.nominal), "size": "0.005"}
        ET.SubElement(bodies[marker.segment], "site", given)
    said = [*list_uncarried(model), *_tie(root, found, coordinates)]
    if odd:
        said.append(f"inertias that no body has, which MuJoCo replaces by a sphere's: {', '.join(odd)}")
    ET.indent(root)
    head = "\n".join(f"  {line}" for line in said).replace("--", "- -")
    return Skeleton(f"<!--\n{head}\n-->\n{ET.tostring(root, encoding='unicode')}\n", tuple(said))


def _breaks_triangle(segment: Segment) -> bool:
    """Whether two principal moments of inertia add up to less than the third, which no body's do."""
    xx, yy, zz, xy, xz, yz = segment.inertia
    moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return bool(moments[0] + moments[1] < moments[2])


def _body(parent: ET.Element, limb: Limb, coordinates: dict[str, Coordinate]) -> ET.Element:
    segment, rest = limb.segment, limb.at_rest
    x, y, z, w = Rotation.from_matrix(rest[:3, :3]).as_quat()
    body = ET.SubElement(
        parent, "body", name=segment.name, pos=_numbers(rest[:3, 3]), quat=_numbers([w, x, y, z])
    )
    if segment.mass > 0.0:
        ET.SubElement(
            body,
            "inertial",
            pos=_numbers(segment.com),
            mass=_numbers([segment.mass]),
            fullinertia=_numbers(segment.inertia),
        )
    else:
        least = {"pos": "0 0 0", "mass": f"{_SMALLEST}", "diaginertia": _numbers([_SMALLEST] * 3)}
        ET.SubElement(body, "inertial", least)
    for axis, direction, point in reversed(list(list_axes_at_rest(limb))):
        kind = "hinge" if axis.kind == "rotation" else "slide"
        given = {"name": axis.name, "type": kind, "axis": _numbers(direction), "pos": _numbers(point)}
        own = coordinates[str(axis.term.coordinate)]
        if axis.leads and own.clamped and np.isfinite([own.lower, own.upper]).all():
            given["range"] = _numbers([own.lower, own.upper])
        ET.SubElement(body, "joint", given)
    return body


def _tie(root: ET.Element, found: tuple[Limb, ...], coordinates: dict[str, Coordinate]) -> list[str]:
    """Tie axes that follow to those that lead; says where a polynomial is not the law."""
    axes = [axis for limb in found for axis in limb.axes]
    leading = {axis.name for axis in axes if axis.leads}
    ties, said = ET.SubElement(root, "equality"), []
    for axis in axes:
        if axis.leads:
            continue
        name = str(axis.term.coordinate)
        if name not in leading:
            said.append(f"{axis.name} is {axis.term.gain:g} times {name}, which no axis of its own moves")
            continue
        coefficients, off = _fit_polynomial(axis, coordinates[name])
        ET.SubElement(ties, "joint", joint1=axis.name, joint2=name, polycoef=_numbers(coefficients))
        if off > _WORTH_SAYING:
            size = f"{1e3 * off:.3g} {'mm' if axis.kind == 'translation' else 'mrad'}"
            said.append(f"{axis.name} follows {name} by a quartic, off its law by up to {size}")
    return said


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

    Its degrees of freedom come in the order of :func:`scaling_service.model.axes.list_limbs`' axes.
    ValueError: the model's parameters are not folded into its laws.
    """
    said = list_uncarried(model)
    lines = ["version 4", *(f"// {line}" for line in said), ""]
    lines += [f"gravity {_numbers(GRAVITY)}", ""]
    for limb in list_limbs(model):
        parent, back = "root" if limb.segment.parent == GROUND else limb.segment.parent, np.asarray(np.eye(4))
        for axis in limb.axes:
            along = _along_z(axis.axis)
            lines += _segment(axis.name, parent, back @ axis.before @ along, _motion(axis))
            parent, back = axis.name, np.asarray(np.linalg.inv(along), dtype=float)
        lines += _segment(limb.segment.name, parent, back @ limb.last, _mass(limb.segment))
    for marker in model.markers:
        lines += [
            f"marker {marker.name.replace(' ', '_')}",
            f"    parent {'root' if marker.segment == GROUND else marker.segment}",
            f"    position {_numbers(marker.nominal)}",
            f"    anatomical {int(marker.anatomical)}",
            f"    technical {int(not marker.anatomical)}",
            "endmarker",
            "",
        ]
    return Skeleton("\n".join(lines), said)


def _segment(name: str, parent: str, frame: Array, more: Iterator[str]) -> list[str]:
    rows = [f"        {_numbers(row)}" for row in frame]
    head = [f"segment {name}", f"    parent {parent}", "    RTinMatrix 1", "    RT", *rows]
    return [*head, *more, "endsegment", ""]


def _motion(axis: DrivenAxis) -> Iterator[str]:
    yield f"    {'rotations' if axis.kind == 'rotation' else 'translations'} z"


def _mass(segment: Segment) -> Iterator[str]:
    if segment.mass <= 0.0:
        return
    xx, yy, zz, xy, xz, yz = segment.inertia
    yield f"    mass {segment.mass:.17g}"
    yield f"    CenterOfMass {_numbers(segment.com)}"
    yield "    inertia"
    for row in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)):
        yield f"        {_numbers(row)}"


def _along_z(axis: Array) -> Array:
    """The frame, (4, 4), whose z lies along an axis."""
    frame, cross = np.eye(4), np.cross((0.0, 0.0, 1.0), axis)
    sine = float(np.linalg.norm(cross))
    if sine > 0.0:
        frame[:3, :3] = rotation_from_vector(cross / sine * np.arctan2(sine, axis[2]))
    elif axis[2] < 0.0:
        frame[:3, :3] = np.diag([1.0, -1.0, -1.0])
    return frame


def _numbers(values: object) -> str:
    return " ".join(f"{value:.17g}" for value in np.asarray(values, dtype=float))


ENGINES: Mapping[str, tuple[str, Callable[[BodyModel], Skeleton]]] = MappingProxyType(
    {"mjcf": ("model.xml", write_mjcf), "biomod": ("model.bioMod", write_biomod)}
)
"""Format to the file's name and what makes its content."""
