"""Muscles' paths as MuJoCo can hold them: sites, and between two sites at most one cylinder or sphere.

What MuJoCo does not have is put as near as it goes, and said of each muscle:

- a point that the path passes in a part of a coordinate's range only is a bend (``via_points``);
- between two surfaces that touch one after the other stands a site, at the middle of the free stretch, which
  follows the coordinate that moves it most;
- an ellipsoid or torus is the cylinder that lies best along where the muscle touches it.

Cylinders have no ends in MuJoCo; tendons are as stiff as their paths.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from scaling_service.core.arrays import Array
from scaling_service.files import courses
from scaling_service.files.polynomials import QUARTIC
from scaling_service.files.via_points import make_via
from scaling_service.model import body
from scaling_service.model.muscles import Contact, Muscle, Musculature, WrapSurface

_AWAY = 2.0
"""Side sites stand at this multiple of a surface's radius from its middle: MuJoCo takes a site within the
surface for a path inside. Chosen; only the direction counts."""
_STILL_M = 1e-3  # chosen: a site that moves less stays; the path's length changes by less than that squared
_TURNS = 37  # of half a turn to each side; chosen: steps of 5 degrees
_LEAST_CONTACTS = 3  # poses from which a surface's course is taken


def plan_tendons(model: body.BodyModel, muscles: Musculature) -> courses.Tendons:
    """The courses of all muscles.

    ``model``: what the muscles belong to, without parameters.
    """
    poses = courses.pose_model(replace(model, segments=(*model.segments, *muscles.movers)), muscles.q)
    surfaces = {surface.name: surface for surface in muscles.surfaces}
    tendons, movers, untouched = [], list(muscles.movers), []
    for k, muscle in enumerate(muscles.muscles):
        contacts = [pose[k] for pose in muscles.contacts]
        course, added, changed = _plan(muscle, contacts, surfaces, poses)
        tendons.append(courses.Tendon(muscle, course, changed))
        movers += added
        touched = {contact.surface for pose in contacts for contact in pose}
        untouched += [f"{muscle.name} on {name}" for name in muscle.surfaces if name not in touched]
    return courses.Tendons(tuple(tendons), tuple(movers), tuple(untouched))


def _plan(
    muscle: Muscle,
    contacts: Sequence[Sequence[Contact]],
    surfaces: Mapping[str, WrapSurface],
    poses: courses.Poses,
) -> tuple[tuple[courses.Site | courses.Bend, ...], list[body.Segment], tuple[str, ...]]:
    course: list[courses.Site | courses.Bend] = []
    movers: list[body.Segment] = []
    changed: list[str] = []
    for number, point in enumerate(muscle.points):
        gap = order_surfaces(contacts, number)
        free = course and isinstance(course[-1], courses.Site) and number + 1 < len(muscle.points) and not gap
        via = make_via(muscle, number, poses.model) if point.coordinate is not None and free else None
        if via is not None:
            course.append(via[0])
            movers.append(via[1])
            changed.append(
                f"{point.name} is passed as {point.coordinate} says, unless others together take the straight"
                " line to its other side"
            )
        else:
            course.append(courses.Site(point.name, point.segment, point.at))
            if point.coordinate is not None:
                changed.append(f"{point.name} is passed whatever {point.coordinate}")
        for k, name in enumerate(gap):
            if k:
                site, own = _place_between(muscle, number, (gap[k - 1], name), contacts, surfaces, poses)
                course.append(site)
                movers += own
                changed.append(f"{site.name} stands between {gap[k - 1]} and {name}")
            surface, said = _simplify(muscle, surfaces[name], contacts)
            course.append(courses.Bend(surface, _make_side(muscle, number, surface, contacts, poses)))
            changed += said
    return tuple(course), movers, tuple(changed)


def _make_side(
    muscle: Muscle,
    number: int,
    surface: WrapSurface,
    contacts: Sequence[Sequence[Contact]],
    poses: courses.Poses,
) -> courses.Site | None:
    """The side site of a surface that is passed on one side, where it makes MuJoCo do what OpenSim does.

    MuJoCo bends a path that meets the surface, or whose straight line runs on the other side than the site,
    and takes the turn that lies nearer to the site.
    """
    if surface.side is None:
        return None
    side = np.array(surface.side)
    name, axes = f"side of {surface.name} for {muscle.name}", np.array(surface.axes)
    if surface.kind == "cylinder" and surface.side[2] == 0.0 and len(contacts):
        ends = muscle.points[number : number + 2]
        start, stop = (
            (poses.to_segment(surface.segment, poses.to_ground(end.segment, end.at)) - surface.origin) @ axes
            for end in ends
        )
        _, middle, _ = courses.gather_touches(contacts, number, (surface.name, surface.of))
        touches = np.array([(each - surface.origin) @ axes for each in middle])
        side[:2] = _choose_side(start[:, :2], stop[:, :2], touches[:, :2], surface.sizes[0], side[:2])
    return courses.Site(
        name, surface.segment, body.to_vector(surface.origin + axes @ side * _AWAY * surface.sizes[0])
    )


def _choose_side(start: Array, stop: Array, touches: Array, radius: float, side: Array) -> Array:
    """The direction nearest to ``side`` with which MuJoCo does in most poses what OpenSim does, (2,).

    ``start``, ``stop``, ``touches`` ((n_poses, 2), m, about the cylinder's axis): the path's points before
    and after, and where it touches; NaN where it does not.
    """
    nearest = courses.find_nearest(np.zeros(2), start, stop)
    meets = np.linalg.norm(nearest, axis=1) < radius
    across = (stop - start)[:, ::-1] * (-1.0, 1.0)
    across = across * np.sign(np.sum(across * touches, axis=1))[:, None]
    touched = np.isfinite(touches[:, 0])
    turns = np.linspace(0.0, np.pi, _TURNS)

    def count_wrong(direction: Array) -> int:
        beyond = nearest @ direction < 0.0
        wrong = np.where(touched, ~((meets | beyond) & (across @ direction > 0.0)), beyond & ~meets)
        return int(wrong.sum())

    tried = [
        np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ side
        for turn in np.stack([turns, -turns], axis=1).ravel()
    ]
    return min(tried, key=count_wrong)


def order_surfaces(contacts: Sequence[Sequence[Contact]], number: int) -> list[str]:
    """The surfaces that are touched after a path point in any pose, in the order of the path."""
    places: dict[str, list[int]] = {}
    for pose in contacts:
        for place, contact in enumerate(c for c in pose if c.after == number):
            places.setdefault(contact.surface, []).append(place)
    together = [[c.surface for c in pose if c.after == number] for pose in contacts]
    before = Counter((a, b) for names in together for k, a in enumerate(names) for b in names[k + 1 :])
    return sorted(places, key=lambda name: sum(before[other, name] > before[name, other] for other in places))


def _place_between(
    muscle: Muscle,
    number: int,
    names: tuple[str, str],
    contacts: Sequence[Sequence[Contact]],
    surfaces: Mapping[str, WrapSurface],
    poses: courses.Poses,
) -> tuple[courses.Site, list[body.Segment]]:
    """A site at the middle of the free stretch between two surfaces, in the segment where it moves least."""
    ends = [muscle.points[number], muscle.points[number + 1]]
    firm = [poses.to_ground(end.segment, end.at) for end in ends]
    touch = [courses.gather_touches(contacts, number, (name,)) for name in names]
    known = [np.isfinite(first[:, 0]) for first, _, _ in touch]
    left, met = (
        poses.to_ground(surfaces[name].segment, each)
        for name, each in zip(names, (touch[0][2], touch[1][0]), strict=True)
    )
    start = np.where(known[0][:, None], left, firm[0])
    stop = np.where(known[1][:, None], met, firm[1])
    for k, name in enumerate(names):  # where a surface is left, the place on the line that is nearest to it
        middle = poses.to_ground(surfaces[name].segment, surfaces[name].origin)
        nearest = courses.find_nearest(middle, start, stop)
        if k == 0:
            start = np.where(known[0][:, None], start, nearest)
        else:
            stop = np.where(known[1][:, None], stop, nearest)
    free = 0.5 * (start + stop)
    name = f"{muscle.name}-{names[0]}-{names[1]}"
    best = min(
        (_follow(poses, segment, free) for segment in dict.fromkeys(surfaces[n].segment for n in names)),
        key=lambda found: found[0],
    )
    _, segment, at, laws = best
    if laws is None:
        return courses.Site(name, segment, at), []
    joints = tuple(
        body.Joint("translation", body.to_vector(axis), law)
        for axis, law in zip(np.eye(3), laws, strict=True)
    )
    return courses.Site(name, name, (0.0, 0.0, 0.0)), [
        body.Segment(name=name, parent=segment, joint_name=name, joints=joints)
    ]


def _follow(
    poses: courses.Poses, segment: str, points: Array
) -> tuple[float, str, body.Vector, tuple[body.Law, ...] | None]:
    """Points as a quartic of the one coordinate that explains them best: what is left, m, and the laws."""
    local = poses.to_segment(segment, points)
    middle = local.mean(axis=0)
    spread = float(np.sqrt(np.mean(np.sum((local - middle) ** 2, axis=1))))
    best: tuple[float, str, body.Vector, tuple[body.Law, ...] | None] = (
        spread,
        segment,
        body.to_vector(middle),
        None,
    )
    if spread < _STILL_M:
        return best
    for k, name in enumerate(poses.model.coordinate_names):
        x = poses.q[:, k]
        if np.ptp(x) == 0.0:
            continue
        coefficients = np.polyfit(x - x.min(), local, QUARTIC)
        left = local - np.vander(x - x.min(), QUARTIC + 1) @ coefficients
        rest = float(np.sqrt(np.mean(np.sum(left**2, axis=1))))
        if rest < best[0]:
            span = (float(x.min()), float(x.max()))
            shapes = [body.Shape(span, (tuple(float(c) for c in own),)) for own in coefficients.T]
            laws = tuple(body.Law((body.Term(1.0, coordinate=name, shape=shape),)) for shape in shapes)
            best = (rest, segment, body.to_vector(middle), laws)
    return best


def _simplify(
    muscle: Muscle, surface: WrapSurface, contacts: Sequence[Sequence[Contact]]
) -> tuple[WrapSurface, list[str]]:
    """An ellipsoid or torus as a cylinder along where the muscle touches it, and what is to be said."""
    if surface.kind in ("cylinder", "sphere"):
        return surface, []
    own = [c for pose in contacts for c in pose if c.surface == surface.name]
    touches = np.array([(c.first, c.middle, c.last) for c in own])
    said = f"{surface.name}, {'an' if surface.kind == 'ellipsoid' else 'a'} {surface.kind},"
    normals = np.cross(touches[:, 1] - touches[:, 0], touches[:, 2] - touches[:, 1])
    if len(own) < _LEAST_CONTACTS or not normals.any():
        radius = float(np.prod(surface.sizes) ** (1.0 / len(surface.sizes)))
        ball = replace(
            surface, kind="sphere", sizes=(radius,), name=f"{surface.name}-{muscle.name}", of=surface.name
        )
        return ball, [f"{said} is a sphere of {1e3 * radius:.1f} mm"]
    axis = np.linalg.svd(normals)[2][0]
    turn = Rotation.align_vectors([axis], [[0.0, 0.0, 1.0]])[0].as_matrix()
    flat = touches.reshape(-1, 3) @ turn
    # Their circle (Kasa)
    rows = np.column_stack([2.0 * flat[:, :2], np.ones(len(flat))])
    x, y, rest = np.linalg.lstsq(rows, np.sum(flat[:, :2] ** 2, axis=1), rcond=None)[0]
    radius = float(np.sqrt(rest + x**2 + y**2))
    off = float(np.sqrt(np.mean((np.linalg.norm(flat[:, :2] - (x, y), axis=1) - radius) ** 2)))
    origin = turn @ np.array([x, y, flat[:, 2].mean()])
    side = turn.T @ (touches[:, 1].mean(axis=0) - origin)
    cylinder = replace(
        surface,
        kind="cylinder",
        name=f"{surface.name}-{muscle.name}",
        of=surface.name,
        origin=body.to_vector(origin),
        axes=(body.to_vector(turn[0]), body.to_vector(turn[1]), body.to_vector(turn[2])),
        sizes=(radius, 2.0 * radius),
        side=body.to_vector([*side[:2] / np.linalg.norm(side[:2]), 0.0]),
    )
    return cylinder, [
        f"{said} is a cylinder of {1e3 * radius:.1f} mm, off where it is touched by {1e3 * off:.2f} mm"
    ]
