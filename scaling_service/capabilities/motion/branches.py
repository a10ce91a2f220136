"""The many ways to write one pose: full turns, and the two triplets of angles of three consecutive rotations.

Turns about three axes of which each stands square on the next, by ``a``, ``b``, ``c``, make the same rotation
as ``a + pi``, ``-b - 2 l``, ``c + pi``: with ``l`` the angle about the second axis from the first axis to the
third, ``R3(c) = R2(l) R1(c) R2(-l)``, and ``R1(pi) R2(-x) R1(pi) = R2(x)``. For body-fixed x-y-z angles the
second is ``pi - b``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.numerics.multibody import laws
from scaling_service.numerics.multibody.tree import Tree

Bounds = tuple[Array, Array]  # each (n_coordinates,)

_TURN = 2.0 * np.pi
_SQUARE = 1e-9  # cosine between axes that stand square on each other
_ROUNDING = 1e-9  # rad: a value brought back from another turn may miss its bound by so much
_TREES = 32  # kept; as many as trees are


@dataclass(frozen=True, slots=True, eq=False)
class Triplet:
    """Three consecutive rotations; their angles are ``gain * coordinate + constant``.

    Or several such, one a row: each array then has one axis more.
    """

    coordinates: NDArray[np.intp]  # (3,)
    gains: Array  # (3,): +1 or -1
    constants: Array  # (3,), rad
    lead: float | Array  # rad: about the second axis, from the first to the third

    @classmethod
    def join(cls, some: Sequence[Triplet]) -> Triplet:
        """Several as one, (n_triplets, 3)."""
        return cls(
            np.stack([each.coordinates for each in some]),
            np.stack([each.gains for each in some]),
            np.stack([each.constants for each in some]),
            np.array([each.lead for each in some]),
        )

    def write_otherwise(self, q: Array) -> Array:
        """The other triplet (..., 3) of the same rotation, each angle within half a turn of zero."""
        first, second, third = np.moveaxis(self.gains * q + self.constants, -1, 0)
        other = np.stack([first + np.pi, -second - 2.0 * self.lead, third + np.pi], axis=-1)
        return wrap(self.gains * (other - self.constants))


@lru_cache(maxsize=_TREES)
def find_turning(tree: Tree) -> NDArray[np.intp]:
    """The coordinates of which a full turn changes nothing: each is one rotation's angle, and nothing else.

    Returns (n_turning,).
    """
    uses = np.zeros(tree.n_coordinates, dtype=np.intp)
    plain = np.zeros(tree.n_coordinates, dtype=np.intp)
    for link in tree.links:
        for move in link.moves:
            for term in () if isinstance(move, laws.Fixed) else move.terms:
                if term.factor != laws.NONE:
                    uses[tree.factors[term.factor].coordinate] += 1
            if isinstance(move, laws.Turn) and (found := _read_angle(tree, move)) is not None:
                plain[found[0]] += 1
    for item in tree.marker_terms:
        if item.term.factor != laws.NONE:
            uses[tree.factors[item.term.factor].coordinate] += 1
    return np.flatnonzero((uses == 1) & (plain == 1))


def _read_angle(tree: Tree, move: laws.Turn) -> tuple[int, float] | None:
    """The coordinate that a turn's angle is, and its sign; None where the angle is anything else."""
    if len(move.terms) != 1:
        return None
    term = move.terms[0]
    if term.factor == laws.NONE or term.parameter != laws.NONE or tree.factors[term.factor].shape is not None:
        return None
    gain = float(term.gain[0])
    return (tree.factors[term.factor].coordinate, gain) if abs(gain) == 1.0 else None


@lru_cache(maxsize=_TREES)
def find_triplets(tree: Tree) -> tuple[Triplet, ...]:
    """Every three consecutive rotations of a link that can be written in two ways."""
    turning, found = set(find_turning(tree).tolist()), []
    for link in tree.links:
        prefix, row = np.eye(3), list[tuple[Array, int, float, float]]()
        for move in link.moves:
            if isinstance(move, laws.Fixed):
                prefix = prefix @ move.rotation
                continue
            angle = _read_angle(tree, move) if isinstance(move, laws.Turn) else None
            if isinstance(move, laws.Turn) and angle is not None and angle[0] in turning:
                row.append((prefix[:, move.axis], *angle, move.constant))
            else:
                row, prefix = [], np.eye(3)
            if len(row) == 3:
                axes = [axis for axis, *_ in row]
                if max(abs(axes[0] @ axes[1]), abs(axes[1] @ axes[2])) < _SQUARE:
                    lead = float(np.arctan2(axes[1] @ np.cross(axes[0], axes[2]), axes[0] @ axes[2]))
                    found.append(
                        Triplet(
                            np.array([c for _, c, _, _ in row], dtype=np.intp),
                            np.array([gain for _, _, gain, _ in row]),
                            np.array([constant for *_, constant in row]),
                            lead,
                        )
                    )
                    row, prefix = [], np.eye(3)
                else:
                    row = row[1:]
    return tuple(found)


def find_loose(tree: Tree, bounds: Bounds) -> NDArray[np.bool_]:
    """Which coordinates may make full turns, which then change nothing, (n_coordinates,)."""
    loose = np.zeros(tree.n_coordinates, dtype=bool)
    loose[find_turning(tree)] = True
    return loose & np.isinf(bounds[0]) & np.isinf(bounds[1])


def wrap(angle: Array) -> Array:
    """Angles within half a turn of zero, rad."""
    return np.asarray(angle - _TURN * np.rint(angle / _TURN))


def join_branches(tree: Tree, q: Array, bounds: Bounds, natural: Bounds, neutral: Array) -> Array:
    """The same poses, written so that coordinates change least from frame to frame.

    ``q`` (n_frames, n_coordinates), rad or m; frames in the order of time. Full turns are taken out of
    coordinates without ``bounds``, and a triplet is written in its other way where that is nearer to the
    frame before. The whole recording then stands as near as can be to the ranges ``natural`` that the model
    declares, and within them to its default pose ``neutral`` (n_coordinates,). A triplet that could not keep
    to its bounds stays as it is.
    """
    joined = q.copy()
    if not len(q):
        return joined
    loose = np.flatnonzero(find_loose(tree, bounds))
    if triplets := find_triplets(tree):
        _join_triplets(Triplet.join(triplets), joined, bounds, natural, neutral)
    joined[:, loose] = np.unwrap(joined[:, loose], axis=0, period=_TURN)
    # Full turns by which whole recordings (n, k) stand away from their ranges, or from the default
    middle = _find_middle(natural[0][loose], natural[1][loose], neutral[loose])
    joined[:, loose] -= _TURN * np.rint((np.median(joined[:, loose], axis=0) - middle) / _TURN)
    return joined


def cross_stretches(tree: Tree, q: Array, stretches: NDArray[np.intp], bounds: Bounds) -> Array:
    """The same poses, written after each stretch (start, stop) in the way that is nearest to before it.

    For stretches in which nothing tells how a triplet turns, so that what lies between does not count.
    """
    crossed, loose = q.copy(), find_loose(tree, bounds)
    for start, stop in stretches.tolist():
        before, after = crossed[start - 1], crossed[stop:]
        after[:, loose] -= _TURN * np.rint((after[0] - before) / _TURN)[loose]
        for triplet in find_triplets(tree):
            own = triplet.coordinates
            other, allowed = write_within(triplet, after[:, own], bounds)
            turns = loose[own]
            other[:, turns] = np.unwrap(other[:, turns], axis=0, period=_TURN)
            other[:, turns] -= _TURN * np.rint((other[0] - before[own]) / _TURN)[turns]
            nearer = np.square(other[0] - before[own]).sum() < np.square(after[0, own] - before[own]).sum()
            if nearer and allowed.all():
                after[:, own] = other
    return crossed


def _join_triplets(triplets: Triplet, q: Array, bounds: Bounds, natural: Bounds, neutral: Array) -> None:
    """The coordinates of some triplets rewritten in place.

    From a frame to the next, either both keep their way or one changes it; what is nearer does not depend on
    how the frames before were written, so the ways are a running sum.
    """
    own = triplets.coordinates
    here = q[:, own]
    other, allowed = write_within(triplets, here, bounds)
    loose = np.isinf(bounds[0][own]) & np.isinf(bounds[1][own])
    changes = measure_step(other[1:] - here[:-1], loose) < measure_step(here[1:] - here[:-1], loose)
    first = np.cumsum(np.insert(changes, 0, False, axis=0), axis=0) % 2 == 1
    # Either way (2, n, t) as a whole: whether it may be, how far it leaves the ranges, how far the default.
    otherwise = np.stack([first, ~first])
    value = np.where(otherwise[..., None], other, here)
    possible = (allowed | ~otherwise).all(axis=1)
    lower, upper = (b[own] for b in natural)
    middle = _find_middle(lower, upper, neutral[own])
    near = middle + wrap(value - middle)
    outside = np.maximum(lower - near, 0.0) + np.maximum(near - upper, 0.0)
    leaves = np.square(outside).sum(axis=(1, 3)).round(6)
    away = np.square(wrap(value - neutral[own])).sum(axis=(1, 3))
    nearer = (leaves[1] < leaves[0]) | ((leaves[1] == leaves[0]) & (away[1] < away[0]))
    second = possible[1] & (nearer | ~possible[0])
    q[:, own] = np.where(second[:, None], value[1], np.where(possible[0][:, None], value[0], here))


def write_within(triplet: Triplet, q: Array, bounds: Bounds) -> tuple[Array, NDArray[np.bool_]]:
    """The other way to write a triplet (..., 3), and whether it keeps to the bounds (...)."""
    lower, upper = (b[triplet.coordinates] for b in bounds)
    # Angles turned into their bounds where one of their turns lies there.
    angle = triplet.write_otherwise(q)
    middle = _find_middle(lower, upper, np.zeros(lower.shape))
    near = middle + wrap(angle - middle)
    off = np.maximum(lower - near, near - upper)
    other = np.asarray(np.where(off < _ROUNDING, np.clip(near, lower, upper), near))
    return other, np.asarray(((other >= lower) & (other <= upper)).all(axis=-1))


def measure_step(step: Array, loose: NDArray[np.bool_]) -> Array:
    """Squares (...) of steps (..., k), rad; full turns of what is loose (k,) do not count."""
    return np.asarray(np.square(np.where(loose, wrap(step), step)).sum(axis=-1))


def _find_middle(lower: Array, upper: Array, otherwise: Array) -> Array:
    """The middle of each range (...), or another value where it has no end."""
    both = np.isfinite(lower) & np.isfinite(upper)
    return np.where(both, 0.5 * (np.where(both, lower, 0.0) + np.where(both, upper, 0.0)), otherwise)
