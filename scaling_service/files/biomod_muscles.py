"""Muscles in bioMod, as far as biorbd goes: points that a path passes in all poses.

biorbd has no points that move or are passed in part of a range. Its one surface, a half cylinder, bends no
path that has points, and where a path leaves it the length is wrong by tens of millimetres (biorbd 1.12). So
muscles have their points as they are in the default pose, those where they touch a surface there included;
how far that takes their lengths off elsewhere is said.
"""

from __future__ import annotations

from collections import abc, defaultdict
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.files import courses
from scaling_service.files.limbs import format_numbers
from scaling_service.files.tendons import order_surfaces
from scaling_service.model import body
from scaling_service.model.muscles import Contact, Muscle, Musculature, PathPoint, WrapSurface

_WORTH_SAYING = 1e-3  # m; chosen: below what attachments are known to
_LEAST = 1e-12  # of what is divided by

_Contacts: TypeAlias = abc.Sequence[abc.Sequence[Contact]]  # of one muscle, by pose


def write_muscles(model: body.BodyModel, muscles: Musculature) -> tuple[list[str], list[str]]:
    """All muscles of a model without parameters: lines that biorbd reads, and what is not as in OpenSim."""
    poses = courses.pose_model(replace(model, segments=(*model.segments, *muscles.movers)), muscles.q)
    default = np.array([c.default for c in model.coordinates])
    off = np.abs(muscles.q - default) / np.maximum(np.ptp(muscles.q, axis=0), _LEAST)
    nearest = int(np.argmin(off.sum(axis=1)))
    surfaces = {surface.name: surface for surface in muscles.surfaces}
    parents = {mover.name: mover.parent for mover in muscles.movers}
    lines: list[str] = []
    astray: dict[str, list[tuple[float, str]]] = defaultdict(list)
    for k, muscle in enumerate(muscles.muscles):
        contacts = [pose[k] for pose in muscles.contacts]
        points = list(_place_points(muscle, contacts, surfaces, poses, parents, nearest))
        lines += _write_muscle(muscle, points)
        simple = _measure_path(replace(muscle, points=tuple(points)), [], surfaces, poses)
        wrong = float(np.abs(simple - _measure_path(muscle, contacts, surfaces, poses)).max())
        if wrong > _WORTH_SAYING:
            moving = any(point.segment in parents for point in muscle.points)
            of_points = "points that move" if moving else "points that are passed in part of a range"
            astray["surfaces" if any(contacts) else of_points].append((wrong, muscle.name))
    said = [
        f"lengths are off in a part of the coordinates' ranges, where biorbd has no {why} as OpenSim has: "
        + ", ".join(f"{name} {1e3 * wrong:.0f} mm" for wrong, name in sorted(rows, reverse=True))
        for why, rows in astray.items()
    ]
    if muscles.muscles:
        said.append("muscles are biorbd's of type hillthelen, with its curves of force")
    return lines, said


def _place_points(
    muscle: Muscle,
    contacts: _Contacts,
    surfaces: abc.Mapping[str, WrapSurface],
    poses: courses.Poses,
    parents: abc.Mapping[str, str],
    pose: int,
) -> abc.Iterator[PathPoint]:
    """The points of a path as they are in one pose."""
    touched = {(c.after, c.surface): c for c in contacts[pose]} if contacts else {}
    for number, point in enumerate(muscle.points):
        if _find_passed(point, poses)[pose]:
            if point.segment in parents:
                parent = parents[point.segment]
                at = poses.to_segment(parent, poses.to_ground(point.segment, point.at))[pose]
                yield PathPoint(name=point.name, segment=parent, at=body.to_vector(at))
            else:
                yield replace(point, coordinate=None)
        for name in order_surfaces(contacts, number):
            if (number, name) in touched:
                at = touched[number, name].middle
                yield PathPoint(name=f"{muscle.name}-{name}", segment=surfaces[name].segment, at=at)


def _find_passed(point: PathPoint, poses: courses.Poses) -> NDArray[np.bool_]:
    """In which poses a path passes one of its points, (n_poses,)."""
    if point.coordinate is None:
        return np.ones(len(poses.q), dtype=bool)
    values = poses.q[:, poses.model.coordinate_names.index(point.coordinate)]
    return np.asarray((values >= point.lower) & (values <= point.upper))


def _measure_path(
    muscle: Muscle, contacts: _Contacts, surfaces: abc.Mapping[str, WrapSurface], poses: courses.Poses
) -> Array:
    """The length of a path in each pose, (n_poses,), m; on surfaces that of arcs through three points."""
    total = np.zeros(len(poses.q))
    here = poses.to_ground(muscle.points[0].segment, muscle.points[0].at)
    for number, point in enumerate(muscle.points):
        there, passed = poses.to_ground(point.segment, point.at), _find_passed(point, poses)
        total += np.where(passed, np.linalg.norm(there - here, axis=1), 0.0)
        here = np.where(passed[:, None], there, here)
        for name in order_surfaces(contacts, number):
            touches = courses.gather_touches(contacts, number, (name,))
            first, middle, last = (poses.to_ground(surfaces[name].segment, each) for each in touches)
            on = np.isfinite(first[:, 0])
            total += np.where(on, np.linalg.norm(first - here, axis=1) + _measure_arc(first, middle, last), 0)
            here = np.where(on[:, None], last, here)
    return total


def _measure_arc(first: Array, middle: Array, last: Array) -> Array:
    """The length of arcs of circles through three points, (n, 3) each, m: (n,)."""
    a, b = middle - first, last - middle
    sides = np.linalg.norm([a, b, last - first], axis=-1)
    area = np.linalg.norm(np.cross(a, b), axis=-1)  # twice the triangle's
    diameter = np.prod(sides, axis=0) / np.maximum(area, _LEAST)
    shares = np.minimum(sides[:2] / np.maximum(diameter, _LEAST), 1.0)
    return np.asarray(
        np.where(area > _LEAST, diameter * np.arcsin(shares).sum(axis=0), sides[:2].sum(axis=0))
    )


def _write_muscle(muscle: Muscle, points: abc.Sequence[PathPoint]) -> list[str]:
    """A muscle in a group of its own, as biorbd asks for groups between two segments."""
    name, (origin, *between, insertion) = _join(muscle.name), points
    lines = [
        f"musclegroup {name}",
        f"    originparent {_name_segment(origin.segment)}",
        f"    insertionparent {_name_segment(insertion.segment)}",
        "endmusclegroup",
        f"muscle {name}",
        "    type hillthelen",
        "    statetype degroote",
        f"    musclegroup {name}",
        f"    originposition {format_numbers(origin.at)}",
        f"    insertionposition {format_numbers(insertion.at)}",
        f"    optimallength {muscle.fibre:.17g}",
        f"    maximalforce {muscle.isometric_force:.17g}",
        f"    tendonslacklength {muscle.slack:.17g}",
        f"    pennationangle {muscle.pennation:.17g}",
        f"    maxshorteningspeed {muscle.speed:.17g}",
        "endmuscle",
        "",
    ]
    for point in between:
        lines += [
            f"viapoint {_join(point.name)}",
            f"    parent {_name_segment(point.segment)}",
            f"    musclegroup {name}",
            f"    muscle {name}",
            f"    position {format_numbers(point.at)}",
            "endviapoint",
            "",
        ]
    return lines


def _join(text: str) -> str:
    return text.replace(" ", "_")


def _name_segment(segment: str) -> str:
    return "root" if segment == body.GROUND else segment
