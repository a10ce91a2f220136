"""Scaled models for MuJoCo: segments, markers, inertia and, of an OpenSim model, muscles, as MJCF."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from scaling_service.files.limbs import (
    DrivenAxis,
    Limb,
    Skeleton,
    format_numbers,
    list_axes_at_rest,
    list_limbs,
    list_uncarried,
)
from scaling_service.model.body import GROUND, BodyModel, Coordinate, Segment
from scaling_service.model.trial import Array
from scaling_service.numerics.wrench import GRAVITY

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
    ET.SubElement(root, "option", gravity=format_numbers(GRAVITY))
    bodies = {GROUND: ET.SubElement(root, "worldbody")}
    coordinates = {c.name: c for c in model.coordinates}
    for limb in found:
        bodies[limb.segment.name] = _write_body(bodies[limb.segment.parent], limb, coordinates)
    for marker in model.markers:
        given = {"name": marker.name, "pos": format_numbers(marker.nominal), "size": "0.005"}
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
        pos=format_numbers(rest[:3, 3]),
        quat=format_numbers([w, x, y, z]),
    )
    if segment.mass > 0.0:
        ET.SubElement(
            body,
            "inertial",
            pos=format_numbers(segment.com),
            mass=format_numbers([segment.mass]),
            fullinertia=format_numbers(segment.inertia),
        )
    else:
        least = {"pos": "0 0 0", "mass": f"{_SMALLEST}", "diaginertia": format_numbers([_SMALLEST] * 3)}
        ET.SubElement(body, "inertial", least)
    for axis, direction, point in reversed(list(list_axes_at_rest(limb))):
        kind = "hinge" if axis.kind == "rotation" else "slide"
        given = {
            "name": axis.name,
            "type": kind,
            "axis": format_numbers(direction),
            "pos": format_numbers(point),
        }
        own = coordinates[str(axis.term.coordinate)]
        if axis.leads and own.clamped and np.isfinite([own.lower, own.upper]).all():
            given["range"] = format_numbers([own.lower, own.upper])
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
        least = {"pos": "0 0 0", "mass": f"{_SMALLEST}", "diaginertia": format_numbers([_SMALLEST] * 3)}
        ET.SubElement(body, "inertial", least)
        given = {"name": name, "type": "hinge" if own.kind == "rotation" else "slide", "axis": "0 0 1"}
        if own.clamped and np.isfinite([own.lower, own.upper]).all():
            given["range"] = format_numbers([own.lower, own.upper])
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
        ET.SubElement(ties, "joint", joint1=axis.name, joint2=name, polycoef=format_numbers(coefficients))
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
