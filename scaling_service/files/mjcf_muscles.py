"""Muscles in MJCF: sites, geometries to wrap, spatial tendons and muscle actuators."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from scaling_service.core.arrays import Array
from scaling_service.files import courses as files_courses
from scaling_service.files.limbs import format_numbers
from scaling_service.model.muscles import Muscle

_RANGE = (0.5, 1.5)
"""Optimal lengths between which MuJoCo is told the muscle's length. Any two say the same."""

_LEAST, _MOST_FORCE = 0.44, 1.4
"""Normalised length below which the active fibre has no force (Millard et al. 2013, ActiveForceLengthCurve:
0.4441), and force of a fibre that is drawn out fast (the same, ForceVelocityCurve; Thelen 2003's Flen)."""


def add_muscles(
    root: ET.Element, bodies: Mapping[str, ET.Element], tendons: files_courses.Tendons
) -> tuple[list[str], list[str]]:
    """Write all muscles; what MuJoCo's are not of OpenSim's, in all and muscle by muscle, in plain sentences.

    ``bodies``: segment to its element; segments for moving sites are among them.
    """
    courses, motors = ET.SubElement(root, "tendon"), ET.SubElement(root, "actuator")
    drawn: set[str] = set()
    for tendon in tendons.tendons:
        name = tendon.muscle.name
        course = ET.SubElement(courses, "spatial", name=name)
        if tendon.muscle.damping:
            muscle = tendon.muscle
            # Of the tendon, N s/m: that of Millard's fibre.
            damping = muscle.damping * muscle.isometric_force / (muscle.fibre * muscle.speed)
            course.set("damping", format_numbers([damping]))
        for part in tendon.course:
            if isinstance(part, files_courses.Site):
                _add_site(bodies[part.segment], part)
                ET.SubElement(course, "site", site=part.name)
                continue
            if part.surface.name not in drawn:
                surface = part.surface
                x, y, z, w = Rotation.from_matrix(surface.axes).as_quat()
                sizes = [surface.sizes[0], *(0.5 * size for size in surface.sizes[1:])]
                given = {
                    "name": surface.name,
                    "type": surface.kind,
                    "pos": format_numbers(surface.origin),
                    "quat": format_numbers([w, x, y, z]),
                    "size": format_numbers(sizes),
                    "contype": "0",
                    "conaffinity": "0",
                    "group": "4",
                }
                ET.SubElement(bodies[surface.segment], "geom", given)
                drawn.add(part.surface.name)
            wrapped = ET.SubElement(course, "geom", geom=part.surface.name)
            if part.side is not None:
                _add_site(bodies[part.side.segment], part.side)
                wrapped.set("sidesite", part.side.name)
        _add_motor(motors, tendon.muscle)
    said, each = [], [f"{t.muscle.name}: {change}" for t in tendons.tendons for change in t.changed]
    if each:
        names = [t.muscle.name for t in tendons.tendons if t.changed]
        said.append(f"paths are near to OpenSim's, not the same, of {', '.join(names)}; the file says how")
    ends = sorted(
        {
            part.surface.name
            for tendon in tendons.tendons
            for part in tendon.course
            if isinstance(part, files_courses.Bend) and part.surface.kind == "cylinder"
        }
    )
    if ends:
        said.append(f"cylinders have no ends: {', '.join(ends)}")
    if tendons.untouched:
        said.append(f"surfaces that are not touched are left out: {', '.join(tendons.untouched)}")
    if tendons.tendons:
        said.append(
            "muscles are MuJoCo's: tendons do not stretch, fibres keep their pennation at optimal length, and"
            " force follows MuJoCo's curves of length and velocity; the passive one is off by up to"
            f" {max(map(_judge_passive, (t.muscle for t in tendons.tendons))):.2f} of the isometric force"
        )
    return said, each


def _add_site(body: ET.Element, site: files_courses.Site) -> None:
    ET.SubElement(body, "site", name=site.name, pos=format_numbers(site.at), size="0.003", group="3")


def _add_motor(motors: ET.Element, muscle: Muscle) -> None:
    """The muscle's force: with a rigid tendon and constant pennation, lengths and forces along the tendon."""
    along = cos(muscle.pennation)
    fibre = muscle.fibre * along
    lengths = [muscle.slack + share * fibre for share in _RANGE]
    given = {
        "name": muscle.name,
        "tendon": muscle.name,
        "timeconst": format_numbers([muscle.rise, muscle.fall]),
        "lengthrange": format_numbers(lengths),
        "range": format_numbers(_RANGE),
        "force": format_numbers([muscle.isometric_force * along]),
        "lmin": format_numbers([_LEAST]),
        "lmax": format_numbers([1.0 + muscle.strain]),
        "vmax": format_numbers([muscle.speed]),
        "fpmax": format_numbers([_fit_passive(muscle)]),
        "fvmax": format_numbers([_MOST_FORCE]),
    }
    ET.SubElement(motors, "muscle", given)


def _draw_passive(steps: int) -> Array:
    """MuJoCo's passive curve from 1 to lmax (``mju_muscleBias``: a parabola to the middle, then a line)."""
    x = np.linspace(0.0, 2.0, steps)
    return np.asarray(np.where(x < 1.0, 0.5 * x**2, x - 0.5))


def _fit_passive(muscle: Muscle) -> float:
    """What brings MuJoCo's passive curve nearest to the muscle's, up to one isometric force."""
    curve = _draw_passive(len(muscle.passive))
    return float(curve @ muscle.passive / (curve @ curve))


def _judge_passive(muscle: Muscle) -> float:
    """How far the two are apart at most, isometric forces."""
    curve = _fit_passive(muscle) * _draw_passive(len(muscle.passive))
    return float(np.abs(curve - muscle.passive).max())
