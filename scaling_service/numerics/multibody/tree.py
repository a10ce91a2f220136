"""Poses of a tree of joints for all frames at once, and how markers move with every variable.

Inside, frames are the last axis and a rotation is stored by its three axis vectors:
``axes[j]`` is the j-th axis of a frame, expressed in ground, shape (3, n_frames).
Variables are the coordinates (per frame) followed by the parameters (shared by all frames).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.numerics.multibody import laws
from scaling_service.numerics.multibody import plan as plans

CYCLE = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
"""The components of a cross product: i from j and k."""

_ROWS = 64  # transposed at once; measured: up to nine times as fast as all at once


@dataclass(frozen=True, slots=True, eq=False)
class MarkerTerm:
    """A varying part of one marker's local position."""

    marker: int
    term: laws.TermArrays


@dataclass(frozen=True, eq=False, kw_only=True)
class Tree:
    """A compiled body model: indices and arrays, no names."""

    links: tuple[laws.Link, ...]  # Parents first
    factors: tuple[laws.Factor, ...]
    n_coordinates: int
    n_parameters: int
    marker_link: NDArray[np.intp]  # (n_markers,)
    marker_local: Array  # (n_markers, 3), m: the constant part of the local positions
    marker_terms: tuple[MarkerTerm, ...] = ()
    # (n_markers,): 0 for a marker that is a direction, a point at infinity: it turns with its link, and where
    # the link is does not matter; 1 for the others. None where all are points
    placed: Array | None = None

    @property
    def n_markers(self) -> int:
        """The number of markers carried."""
        return len(self.marker_link)

    @cached_property
    def plan(self) -> plans.Plan:
        """The order of computation."""
        return plans.plan_of(self.links, self.factors, self.n_coordinates)

    @cached_property
    def shape_groups(self) -> tuple[laws.ShapeGroup, ...]:
        """Shapes that are evaluated together."""
        return laws.group_shapes(self.factors)

    @cached_property
    def carried(self) -> tuple[slice | NDArray[np.intp], ...]:
        """For every link the markers on it and on everything that hangs on it."""
        below: list[set[int]] = [set(rows.tolist()) for rows in self.marker_rows]
        for k in reversed(range(len(self.links))):
            if self.links[k].parent != laws.NONE:
                below[self.links[k].parent] |= below[k]
        return tuple(plans.run_of(np.array(sorted(s), dtype=np.intp)) for s in below)

    @cached_property
    def followed(self) -> NDArray[np.bool_]:
        """Whether a marker moves with a coordinate at all, (n_markers, n_coordinates)."""
        found = np.zeros((self.n_markers, self.n_coordinates), dtype=bool)
        for below, own in zip(self.carried, self.variables, strict=True):
            for v in own:
                if v < self.n_coordinates:
                    found[below, v] = True
        for item in self.gliding:
            found[item.marker, [v for v in list_variables(self, item.term) if v < self.n_coordinates]] = True
        return found

    @cached_property
    def rotations(self) -> NDArray[np.intp]:
        """The coordinates that turn links, by themselves or while they shift them, (n_rotations,)."""
        turns = (e for e in self.plan.entries if e.is_turn and e.term.factor != laws.NONE)
        return np.unique(np.array([self.factors[e.term.factor].coordinate for e in turns], dtype=np.intp))

    @cached_property
    def marker_rows(self) -> tuple[NDArray[np.intp], ...]:
        """For every link the markers that sit on it."""
        return tuple(np.flatnonzero(self.marker_link == k) for k in range(len(self.links)))

    @cached_property
    def marker_shifts(self) -> Array:
        """How parameters alone move markers in their links, per unit, (n_markers, 3, n_parameters)."""
        shifts = np.zeros((self.n_markers, 3, self.n_parameters))
        for item in self.marker_terms:
            if item.term.factor == laws.NONE:
                shifts[item.marker, :, item.term.parameter] += item.term.gain
        return shifts

    @cached_property
    def gliding(self) -> tuple[MarkerTerm, ...]:
        """The terms of markers that coordinates enter."""
        return tuple(item for item in self.marker_terms if item.term.factor != laws.NONE)

    @cached_property
    def glides(self) -> Array:
        """How these move markers in their links, per unit, (n_markers, 3, n_gliding)."""
        glides = np.zeros((self.n_markers, 3, len(self.gliding)))
        for k, item in enumerate(self.gliding):
            glides[item.marker, :, k] = item.term.gain
        return glides

    @cached_property
    def marker_parameters(self) -> dict[int, tuple[int, laws.TermArrays]]:
        """Parameters that enter one term of one marker and nothing else: the marker and the term."""
        found: dict[int, tuple[int, laws.TermArrays]] = {}
        taken = [e.term.parameter for entries in self.entries_of_link for e in entries]
        for item in self.marker_terms:
            if item.term.parameter in found:
                taken.append(item.term.parameter)
            found[item.term.parameter] = (item.marker, item.term)
        return {k: at for k, at in found.items() if k not in (laws.NONE, *taken)}

    @cached_property
    def entries_of_link(self) -> tuple[tuple[plans.Entry, ...], ...]:
        """For every link the varying terms of its moves, in their order."""
        return tuple(tuple(e for e in self.plan.entries if e.link == k) for k in range(len(self.links)))

    @cached_property
    def variables(self) -> tuple[tuple[int, ...], ...]:
        """For every link the variables that enter its moves, ascending."""
        moves = ([move for move in link.moves if not isinstance(move, laws.Fixed)] for link in self.links)
        terms = ([term for move in own for term in move.terms] for own in moves)
        return tuple(tuple(sorted({v for t in own for v in list_variables(self, t)})) for own in terms)


def list_variables(tree: Tree, term: laws.TermArrays) -> list[int]:
    """The variables that enter a term: its coordinates, its parameter."""
    found: list[int] = []
    if term.factor != laws.NONE:
        found += tree.factors[term.factor].coordinates
    if term.parameter != laws.NONE:
        found.append(tree.n_coordinates + term.parameter)
    return found


def list_rates(tree: Tree, values: laws.Values, term: laws.TermArrays) -> list[tuple[int, Array | float]]:
    """The variables of a term and the rate of its scalar part with each."""
    rates: list[tuple[int, Array | float]] = []
    if term.factor != laws.NONE:
        coordinates = tree.factors[term.factor].coordinates
        rates += [(c, values.by_coordinate(term, k)) for k, c in enumerate(coordinates)]
    if term.parameter != laws.NONE:
        rates.append((tree.n_coordinates + term.parameter, values.by_parameter(term)))
    return rates


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Frames of all nodes and links for a block of frames."""

    plan: plans.Plan
    # (n_nodes, 4, 3, n_frames): ``frames[node, j]`` is the node's j-th axis in ground, ``frames[node, 3]``
    # its origin (m)
    frames: Array
    values: laws.Values

    @property
    def axes(self) -> Array:
        """Axes of all links, shape (n_links, 3, 3, n_frames)."""
        return np.asarray(self.frames[self.plan.link_node, :3])

    @property
    def origins(self) -> Array:
        """Origins of all links, shape (n_links, 3, n_frames), m."""
        return np.asarray(self.frames[self.plan.link_node, 3])

    def directions(self, entries: Sequence[plans.Entry]) -> Array:
        """Axes or shifts of some entries in ground, (n_entries, 3, n_frames)."""
        parents = self.plan.parent[[entry.node for entry in entries]]
        local = np.array([entry.direction for entry in entries])
        return np.asarray(np.einsum("ejan,ej->ean", self.frames[parents, :3], local))


def pose_links(tree: Tree, q: Array, p: Array, ground: Array | None = None) -> Poses:
    """Poses of all links.

    ``q``: (n_coordinates, n_frames), rad or m.
    ``p``: (n_parameters,).
    ``ground`` (3, n_frames), m: where the ground origin lies; zero unless given. Moving it near the body
        keeps moments about it small.
    """
    plan, n = tree.plan, q.shape[1]
    values = laws.Values.of(tree.factors, tree.shape_groups, q, p)
    # One piece of memory: two are given back to the system after every call, and to get them anew takes
    # longer than the computation.
    local, frames = np.empty((2, len(plan.parent), 4, 3, n))
    # One, sine and cosine of every angle (rows, n), as (rows, 3, n).
    angle = plan.angles.values(q, values)
    result = np.empty((len(angle), 3, angle.shape[1]))
    result[:, 0] = 1.0
    np.sin(angle, out=result[:, 1])
    np.cos(angle, out=result[:, 2])
    np.matmul(plan.rotations, result, out=local.reshape(len(local), 12, -1)[:, :9])
    local[:, 3] = plan.shifts.values(q, values).reshape(-1, 3, n)
    frames[0, :3] = np.eye(3)[:, :, None]
    frames[0, 3] = 0.0 if ground is None else ground
    for level, carriers in plan.levels:
        carrier, reached = frames[carriers], frames[level]
        np.einsum("gjan,gkjn->gkan", carrier[:, :3], local[level], out=reached)
        reached[:, 3] += carrier[:, 3]
    return Poses(plan, frames, values)


def evaluate_local_positions(tree: Tree, p: Array) -> Array:
    """Marker positions in their links, which no coordinate enters, shape (n_markers, 3, 1), m."""
    values = laws.Values.of(tree.factors, tree.shape_groups, np.zeros((tree.n_coordinates, 1)), p)
    result = tree.marker_local[:, :, None].astype(float)
    for item in tree.marker_terms:
        result[item.marker] += item.term.gain[:, None] * values.scalar(item.term)
    return result


def place_tree_markers(tree: Tree, poses: Poses) -> Array:
    """Marker positions in ground, shape (n_markers, 3, n_frames), m; of directions where they point."""
    frames = poses.frames[poses.plan.link_node[tree.marker_link]]
    local = np.ones((tree.n_markers, 1, 4))
    local[:, 0, :3] = tree.marker_local + tree.marker_shifts @ poses.values.p
    if tree.placed is not None:
        local[:, 0, 3] = tree.placed
    result: Array = np.matmul(local, frames.reshape(tree.n_markers, 4, -1)).reshape(tree.n_markers, 3, -1)
    if tree.gliding:
        far = np.array([poses.values.scalar(item.term) for item in tree.gliding])
        result += np.einsum("mjan,mjn->man", frames[:, :3], tree.glides @ far)
    return result


def cross(a: Array, b: Array) -> Array:
    """Cross product over the second-last axis (3 components), frames last."""
    result = np.empty(a.shape if a.shape == b.shape else np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in CYCLE:
        component = result[..., i, :]
        np.multiply(a[..., j, :], b[..., k, :], out=component)
        component -= a[..., k, :] * b[..., j, :]
    return result


def compute_jacobian(tree: Tree, poses: Poses, placed: Array, variables: NDArray[np.intp]) -> Array:
    """Derivatives of all marker positions with respect to some variables.

    ``placed`` (n_markers, 3, n_frames): as :func:`place_tree_markers` gives them.
    ``variables`` int (n_variables,): coordinates first, then ``n_coordinates + parameter``.
    Returns (n_variables, n_markers, 3, n_frames).
    """
    row = {int(v): k for k, v in enumerate(variables)}
    result = np.zeros((len(variables), *placed.shape))
    for link, below in enumerate(tree.carried):
        moving = [
            e for e in tree.entries_of_link[link] if any(v in row for v in list_variables(tree, e.term))
        ]
        if not moving:
            continue
        motions = poses.directions(moving)[:, None]
        turns = [k for k, entry in enumerate(moving) if entry.is_turn]
        centres = poses.frames[[moving[k].node for k in turns], 3]
        points = None if tree.placed is None else tree.placed[below, None, None]
        centres = centres[:, None] if points is None else centres[:, None] * points
        turned = dict(zip(turns, cross(motions[turns], placed[below] - centres), strict=True))
        for k, entry in enumerate(moving):
            moved = turned.get(k, motions[k] if points is None else motions[k] * points)
            for variable, rate in list_rates(tree, poses.values, entry.term):
                if variable in row:
                    result[row[variable], below] += moved * rate
    if tree.marker_terms:
        gains = np.array([item.term.gain for item in tree.marker_terms])
        nodes = poses.plan.link_node[tree.marker_link[[item.marker for item in tree.marker_terms]]]
        directions = np.einsum("tjan,tj->tan", poses.frames[nodes, :3], gains)
        for item, direction in zip(tree.marker_terms, directions, strict=True):
            for variable, rate in list_rates(tree, poses.values, item.term):
                if variable in row:
                    result[row[variable], item.marker] += direction * rate
    return result


def order_by_frame(rates: Array) -> Array:
    """Derivatives (n_variables, n_markers, 3, n) frame after frame, (n, n_variables, 3 n_markers).

    Copied some rows at a time, so that what is read stays in the processor's cache.
    """
    count, markers, _, n = rates.shape
    flat, result = rates.reshape(-1, n), np.empty((n, count * markers * 3))
    for start in range(0, len(flat), _ROWS):
        result[:, start : start + _ROWS] = flat[start : start + _ROWS].T
    return result.reshape(n, count, 3 * markers)


def pose_markers(tree: Tree, q: Array, p: Array) -> Array:
    """Marker positions in ground for coordinates by frame.

    ``q``: (n_frames, n_coordinates), rad or m.
    ``p``: (n_parameters,).
    Returns (n_frames, n_markers, 3), m.
    """
    by_frame = np.ascontiguousarray(np.asarray(q, dtype=float).T)
    poses = pose_links(tree, by_frame, np.asarray(p, dtype=float))
    return np.ascontiguousarray(np.moveaxis(place_tree_markers(tree, poses), -1, 0))


def compute_marker_rates(tree: Tree, q: Array, p: Array, variables: NDArray[np.intp]) -> Array:
    """How markers move with variables, frame by frame, (n_frames, n_variables, 3 n_markers).

    ``q``, ``p``: as of :func:`pose_markers`; ``variables``: as of :func:`compute_jacobian`.
    """
    poses = pose_links(tree, np.ascontiguousarray(q.T), p)
    return order_by_frame(compute_jacobian(tree, poses, place_tree_markers(tree, poses), variables))
