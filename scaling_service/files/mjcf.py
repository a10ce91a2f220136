"""Scaled models for MuJoCo: segments, markers, inertia and, of an OpenSim model, muscles, as MJCF."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from scaling_service.core.arrays import Array
from scaling_service.files import limbs, polynomials
from scaling_service.files.mjcf_muscles import add_muscles
from scaling_service.files.tendons import plan_tendons
from scaling_service.model.body import GROUND, BodyModel, Coordinate, Segment
from scaling_service.model.muscles import Musculature
from scaling_service.numerics.wrench import GRAVITY

_WORTH_SAYING = 1e-9  # rad or m; chosen: below it a fit is exact
_OPTION = {"timestep": "0.001", "integrator": "implicitfast", "jacobian": "dense"}
"""MuJoCo 4.0's sparse solver does not converge on chains of light joints; the dense one does, in one step."""
_DEFAULTS = {
    "joint": {"damping": "0.1", "armature": "0.005"},
    "equality": {"solref": "0.002 1", "solimp": "0.9999 0.9999 0.001 0.5 2"},
}
_CLASSES = {
    "root": {"damping": "0", "armature": "0"},
    "following hinge": {"damping": "0", "armature": "0.001"},
    "following slide": {"damping": "0", "armature": "0.05"},
}
"""N m s/rad or N s/m, kg m2 or kg; constraints as stiff as 1 ms allows. Chosen: Rajagopal's and gait2354 hang
and fall for 10 s with joints within 0.2 mm (hanging) of what they follow."""
_ADDED = (
    "added for simulation, as OpenSim's models have none: in joints but the root's, damping of 0.1 N m s/rad"
    " and armature of 0.005 kg m2; of joints that follow others, armature of 0.001 kg m2 or 0.05 kg. All but"
    " the root's joints stay in their coordinate's range, clamped or not"
)
_MOST_AXES = 6  # that MuJoCo lets a body have
_SMALLEST = 1e-6
"""kg and kg m2 of a moving body without mass, which MuJoCo refuses. Chosen: some micrograms move nothing."""
_LEAST = {"pos": "0 0 0", "mass": f"{_SMALLEST}", "diaginertia": limbs.format_numbers([_SMALLEST] * 3)}


def write_mjcf(model: BodyModel, muscles: Musculature | None = None) -> limbs.Skeleton:
    """An MJCF file, angles in rad, Y up; what it does not carry stands in a comment at its head, too.

    ``muscles``: of the ``.osim`` file that holds the model, with the surfaces that they touch in poses all
    over its coordinates' ranges.
    ValueError: the model's parameters are not folded into its laws.
    """
    tendons = None if muscles is None else plan_tendons(model, muscles)
    if tendons is not None:
        model = replace(model, segments=(*model.segments, *tendons.movers))
    eased = polynomials.ease_laws(model)
    model, found = eased.model, limbs.list_limbs(eased.model)
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
    ET.SubElement(root, "option", {"gravity": limbs.format_numbers(GRAVITY), **_OPTION})
    defaults = ET.SubElement(root, "default")
    for kind, given in _DEFAULTS.items():
        ET.SubElement(defaults, kind, given)
    for name, given in _CLASSES.items():
        ET.SubElement(ET.SubElement(defaults, "default", {"class": name}), "joint", given)
    bodies = {GROUND: ET.SubElement(root, "worldbody")}
    coordinates = {c.name: c for c in model.coordinates}
    for limb in found:
        bodies[limb.segment.name] = _write_body(bodies[limb.segment.parent], limb, coordinates)
    for marker in model.markers:
        given = {"name": marker.name, "pos": limbs.format_numbers(marker.nominal), "size": "0.005"}
        ET.SubElement(bodies[marker.segment], "site", given)
    _add_unmoving(bodies[GROUND], found, coordinates)
    # Joints that follow another one, to that and the polynomial, lowest power first; leaders come first.
    axes = [axis for limb in found for axis in limb.axes if not axis.leads]
    followers = {a.name: (name := str(a.term.coordinate), _fit(a, coordinates[name])) for a in axes}
    ties = {**eased.helpers, **followers}
    element = ET.SubElement(root, "equality")
    for follower, (leader, polynomial) in ties.items():
        tie = ET.SubElement(element, "joint", joint1=follower, joint2=leader)
        tie.set("polycoef", limbs.format_numbers(polynomial))
    # Give joints that follow, and those that join the body to the ground, their classes
    ground = bodies[GROUND]
    grounded = {axis.name for limb in found if limb.segment.parent == GROUND for axis in limb.axes}
    for joint in ground.iter("joint"):
        name = str(joint.get("name"))
        if name in ties:
            joint.set("class", f"following {joint.get('type')}")
        elif name in grounded:
            joint.set("class", "root")
    in_all, each = _describe_fits(eased.followed)
    each = [*limbs.list_following(model), *each]
    said = [*limbs.list_uncarried(model, muscles=tendons is None), *in_all, _ADDED]
    if tendons is not None:
        of_all, of_muscles = add_muscles(root, bodies, tendons)
        said, each = [*said, *of_all], [*each, *of_muscles]
    # A key frame with all coordinates at their default and what follows in its place
    values = {name: own.default for name, own in coordinates.items()}
    for follower, (leader, polynomial) in ties.items():
        values[follower] = float(np.polynomial.polynomial.polyval(values[leader], polynomial))
    world = root.find("worldbody")
    assert world is not None
    place = [values[str(joint.get("name"))] for joint in world.iter("joint")]
    ET.SubElement(ET.SubElement(root, "keyframe"), "key", name="default", qpos=limbs.format_numbers(place))
    if odd:
        said.append(f"inertias that no body has, which MuJoCo replaces by a sphere's: {', '.join(odd)}")
    ET.indent(root)
    head = "\n".join(f"  {line}" for line in (*said, *each)).replace("--", "- -")
    text = f"<!--\n{head}\n-->\n{ET.tostring(root, encoding='unicode')}\n"
    changed = {t.muscle.name: t.changed for t in tendons.tendons} if tendons is not None else {}
    return limbs.Skeleton(text, tuple(said), changed)


def _violates_triangle(segment: Segment) -> bool:
    """Whether two principal moments of inertia add up to less than the third, which no body's do."""
    xx, yy, zz, xy, xz, yz = segment.inertia
    moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return bool(moments[0] + moments[1] < moments[2])


def _write_body(parent: ET.Element, limb: limbs.Limb, coordinates: dict[str, Coordinate]) -> ET.Element:
    segment = limb.segment
    if len(limb.axes) > _MOST_AXES:
        carrier = Segment(
            name=f"carrier of {segment.name}", parent=segment.parent, joint_name=segment.joint_name, joints=()
        )
        parent = _write_body(parent, limbs.Limb(carrier, limb.axes[:-_MOST_AXES], np.eye(4)), coordinates)
        limb = replace(limb, axes=limb.axes[-_MOST_AXES:])
    rest = limb.at_rest
    x, y, z, w = Rotation.from_matrix(rest[:3, :3]).as_quat()
    body = ET.SubElement(
        parent,
        "body",
        name=segment.name,
        pos=limbs.format_numbers(rest[:3, 3]),
        quat=limbs.format_numbers([w, x, y, z]),
    )
    if segment.mass > 0.0:
        ET.SubElement(
            body,
            "inertial",
            pos=limbs.format_numbers(segment.com),
            mass=limbs.format_numbers([segment.mass]),
            fullinertia=limbs.format_numbers(segment.inertia),
        )
    else:
        ET.SubElement(body, "inertial", _LEAST)
    for axis, direction, point in reversed(list(limbs.list_axes_at_rest(limb))):
        kind = "hinge" if axis.kind == "rotation" else "slide"
        given = {
            "name": axis.name,
            "type": kind,
            "axis": limbs.format_numbers(direction),
            "pos": limbs.format_numbers(point),
        }
        own = coordinates[str(axis.term.coordinate)]
        # Polynomials hold only in a coordinate's range: MuJoCo keeps it there, clamped or not.
        ends = bool(np.isfinite([own.lower, own.upper]).all())
        if axis.leads and ends and (own.clamped or limb.segment.parent != GROUND):
            given["range"] = limbs.format_numbers([own.lower, own.upper])
        ET.SubElement(body, "joint", given)
    return body


def _add_unmoving(
    ground: ET.Element, found: tuple[limbs.Limb, ...], coordinates: dict[str, Coordinate]
) -> None:
    """A body without mass for each coordinate that is no axis: its joint has the value that others follow."""
    # Coordinates that move axes by functions alone, and none by their own value
    axes = [axis for limb in found for axis in limb.axes]
    leading = {axis.name for axis in axes if axis.leads}
    for name in dict.fromkeys(str(a.term.coordinate) for a in axes if a.term.coordinate not in leading):
        own = coordinates[name]
        body = ET.SubElement(ground, "body", name=f"value of {name}")
        ET.SubElement(body, "inertial", _LEAST)
        given = {"name": name, "type": "hinge" if own.kind == "rotation" else "slide", "axis": "0 0 1"}
        if own.clamped and np.isfinite([own.lower, own.upper]).all():
            given["range"] = limbs.format_numbers([own.lower, own.upper])
        ET.SubElement(body, "joint", given)


def _fit(axis: limbs.DrivenAxis, coordinate: Coordinate) -> Array:
    """The quartic that an axis follows, lowest power first, (5,)."""
    if axis.term.shape is None:
        return np.array([0.0, axis.term.gain, 0.0, 0.0, 0.0])
    x = np.linspace(*polynomials.find_span(axis.term.shape, coordinate), 200)
    fit = np.polynomial.Polynomial.fit(x, axis.value({coordinate.name: x}), polynomials.QUARTIC).convert()
    return np.pad(np.asarray(fit.coef, dtype=float), (0, polynomials.QUARTIC + 1 - len(fit.coef)))


def _describe_fits(followed: tuple[polynomials.Followed, ...]) -> tuple[list[str], list[str]]:
    """How near polynomials are to laws, in all and one by one; nothing where they are exact."""
    units = {"translation": "mm", "rotation": "mrad"}
    far = [f for f in followed if f.off > _WORTH_SAYING]
    each = [
        f"{f.joint} follows {f.coordinate} by a polynomial of degree {f.degree}, off its law by up to"
        f" {1e3 * f.off:.3g} {units[f.kind]}"
        for f in far
    ]
    worst = {units[f.kind]: f.off for f in sorted(far, key=lambda f: f.off)}
    most = " and ".join(f"{1e3 * off:.3g} {unit}" for unit, off in sorted(worst.items()))
    in_all = f"{len(far)} laws are followed by polynomials, off by up to {most}; the file lists each"
    return [in_all] if far else [], each
