"""Points that a path passes in a part of a coordinate's range only, for MuJoCo.

Such a point is a sphere too small to matter. MuJoCo bends a path over a sphere where the straight line runs
on another side of it than the side site. This one moves with the coordinate: it is on the other side while
the point is passed, and on the line's side while it is not. So the path jumps where OpenSim's does.
"""

from __future__ import annotations

from collections import abc

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.files import courses
from scaling_service.files.polynomials import QUARTIC
from scaling_service.model import body, muscles
from scaling_service.model.poses import sweep_coordinates

_VIA_M = 1e-6  # radius of a sphere that stands for a point; chosen: a thousandth of what is asked of lengths
_AWAY_M = 0.05  # how far a moving side site goes; chosen: far beyond the sphere, and light to move
_OVER = 2.0  # of a side by what another coordinate adds to it where the line crosses; chosen: it decides
_CLEAR, _ROUNDS = 0.3, 20
"""Cosine with the wanted side that is clear of the line, and doublings of the weight of what is not. Chosen:
only the sign counts."""
_STEPS = 721  # of a coordinate's range, in which sides are looked for; chosen: a degree or less


def make_via(
    muscle: muscles.Muscle, number: int, model: body.BodyModel
) -> tuple[courses.Bend, body.Segment] | None:
    """A sphere at a point of a path and, in a segment of its own, the moving side site.

    ``model``: without parameters. None: no quartic of the point's coordinate changes sides as the path does.
    """
    point = muscle.points[number]
    sweeps = sweep_coordinates(model, _STEPS)
    if point.coordinate not in sweeps:
        return None
    x = sweeps[point.coordinate][:, model.coordinate_names.index(point.coordinate)]
    away, outside = _find_sides(muscle, number, model, sweeps[point.coordinate])
    passed = ((x >= point.lower) & (x <= point.upper))[:, None]
    wanted = np.where(passed, _normalise(away + outside), -away)
    polynomials = _fit_sides(x, wanted, (point.lower, point.upper))
    if polynomials is None:
        return None
    terms = [[_make_term(point.coordinate, x, own)] for own in polynomials]
    default = model.coordinates[model.coordinate_names.index(point.coordinate)].default
    start = np.array([np.polyval(own, default - x[0]) for own in polynomials])
    passed_at = point.lower <= default <= point.upper
    for name, q in sweeps.items():
        if name == point.coordinate:
            continue
        values = q[:, model.coordinate_names.index(name)]
        for add, flat in _fit_crossings(values, start, *_find_sides(muscle, number, model, q), passed_at):
            for own, size in zip(terms, add, strict=True):
                own.append(_make_term(name, values, size * flat))
    name = f"side of {point.name}"
    joints = tuple(
        body.Joint("translation", body.to_vector(axis), body.Law.constant(place) + body.Law(tuple(own)))
        for axis, place, own in zip(np.eye(3), point.at, terms, strict=True)
    )
    ball = muscles.WrapSurface(
        name=point.name,
        kind="sphere",
        segment=point.segment,
        origin=point.at,
        axes=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        sizes=(_VIA_M,),
    )
    mover = body.Segment(name=name, parent=point.segment, joint_name=name, joints=joints)
    return courses.Bend(ball, courses.Site(name, name, (0.0, 0.0, 0.0))), mover


def _make_term(coordinate: str, x: Array, polynomial: Array) -> body.Term:
    """A polynomial, highest power first, of a coordinate less the lowest of its values."""
    shape = body.Shape((float(x[0]), float(x[-1])), (tuple(float(c) for c in polynomial),))
    return body.Term(1.0, coordinate=coordinate, shape=shape)


def _find_sides(muscle: muscles.Muscle, number: int, model: body.BodyModel, q: Array) -> tuple[Array, Array]:
    """Unit vectors in a point's segment, (n_poses, 3): away from the line, and from it beyond its ends.

    MuJoCo bends the path if the side site lies along the first, and takes the turn along the second.
    """
    point, poses = muscle.points[number], courses.pose_model(model, q)
    at = np.array(point.at)
    before, after = (
        poses.to_segment(point.segment, poses.to_ground(other.segment, other.at))
        for other in (_find_firm(muscle.points[number - 1 :: -1]), _find_firm(muscle.points[number + 1 :]))
    )
    away = _normalise(at - courses.find_nearest(at, before, after))
    return away, _normalise(at - courses.find_nearest(at, before, after, beyond=True))


def _fit_sides(x: Array, wanted: Array, ends: tuple[float, float]) -> list[Array] | None:
    """Quartics of ``x - x[0]``, highest power first, of a vector that flips wherever ``wanted`` does."""
    at = np.flatnonzero(np.sum(wanted[1:] * wanted[:-1], axis=1) < 0.0)
    turns = [
        next((end for end in ends if x[k] <= end <= x[k + 1]), 0.5 * (x[k] + x[k + 1])) - x[0] for k in at
    ]
    if len(turns) > QUARTIC:
        return None
    own = x - x[0]
    turning = np.polynomial.Polynomial(np.polynomial.polynomial.polyfromroots(turns) if turns else [1.0])
    scale = float(np.abs(turning(own)).max()) / _AWAY_M
    steady = wanted * np.sign(turning(own))[:, None]
    weights = np.ones(len(own))
    for _ in range(_ROUNDS):
        fits = [
            np.polynomial.Polynomial.fit(own, column, QUARTIC - len(turns), w=weights).convert()
            for column in steady.T
        ]
        found = _normalise(np.column_stack([fit(own) for fit in fits]))
        unclear = np.sum(found * steady, axis=1) < _CLEAR
        if not unclear.any():
            break
        weights = np.where(unclear, 2.0 * weights, weights)
    return [np.asarray((fit * turning / scale).coef[::-1], dtype=float) for fit in fits]


def _fit_crossings(
    x: Array, side: Array, away: Array, outside: Array, passed: bool
) -> abc.Iterator[tuple[Array, Array]]:
    """What to add to a side where another coordinate takes the line across: a vector and its size.

    The size is a quartic of ``x - x[0]``, highest power first: flat about the middle of the range, 1 where
    the line crosses, 0 at the other end.
    """
    wrong = (away @ side <= 0.0) | (outside @ side <= 0.0) if passed else away @ side > 0.0
    wanted = _normalise(away + outside) if passed else -away
    middle = int(np.argmin(np.abs(x)))
    crossed = np.flatnonzero(wrong)
    ends = [(k, 0, -1) for k in crossed[crossed < middle][-1:]] + [
        (k, -1, 0) for k in crossed[crossed > middle][:1]
    ]
    for at, end, other in ends:
        rows = [[(x[k] - x[middle]) ** power for power in (QUARTIC, QUARTIC - 1)] for k in (at, other)]
        quartic, cubic = np.linalg.solve(rows, [1.0, 0.0])
        flat = np.polynomial.Polynomial([0.0, 0.0, 0.0, cubic, quartic])
        moved = flat(np.polynomial.Polynomial([x[0] - x[middle], 1.0])).coef[::-1]
        yield _OVER * wanted[end] * np.linalg.norm(side), np.asarray(moved, dtype=float)


def _normalise(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), _VIA_M))


def _find_firm(points: abc.Sequence[muscles.PathPoint]) -> muscles.PathPoint:
    """The first point that is always passed, or the last there is."""
    return next((point for point in points if point.coordinate is None), points[-1])
