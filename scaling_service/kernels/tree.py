"""Poses of a tree of joints for all frames at once, and how markers move with every variable.

Inside, frames are the last axis and a rotation is stored by its three axis vectors:
``axes[j]`` is the j-th axis of a frame, expressed in ground, shape (3, n_frames).
Variables are the coordinates (per frame) followed by the parameters (shared by all frames).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scaling_service.kernels.laws import NONE, Array, Factor, ShapeGroup, TermArrays, Values, shape_groups
from scaling_service.kernels.moves import Fixed, Link
from scaling_service.kernels.plan import Entry, Plan, plan_of


@dataclass(frozen=True, slots=True, eq=False)
class MarkerTerm:
    """A varying part of one marker's local position."""

    marker: int
    term: TermArrays


@dataclass(frozen=True, eq=False)
class Tree:
    """A compiled body model: indices and arrays, no names.

    Parameters
    ----------
    links : tuple of Link
        Parents first.
    factors : tuple of Factor
    n_coordinates, n_parameters : int
    marker_link : ndarray of int, shape (n_markers,)
    marker_local : ndarray, shape (n_markers, 3), m
        The constant part of the local positions.
    marker_terms : tuple of MarkerTerm
    """

    links: tuple[Link, ...]
    factors: tuple[Factor, ...]
    n_coordinates: int
    n_parameters: int
    marker_link: NDArray[np.intp]
    marker_local: Array
    marker_terms: tuple[MarkerTerm, ...] = ()

    @property
    def n_markers(self) -> int:
        """The number of markers carried."""
        return len(self.marker_link)

    @cached_property
    def plan(self) -> Plan:
        """The order of computation."""
        return plan_of(self.links, self.factors, self.n_coordinates)

    @cached_property
    def shape_groups(self) -> tuple[ShapeGroup, ...]:
        """Shapes that are evaluated together."""
        return shape_groups(self.factors)

    @cached_property
    def carried(self) -> tuple[NDArray[np.intp], ...]:
        """For every link the markers on it and on everything that hangs on it."""
        below: list[set[int]] = [set(rows.tolist()) for rows in self.marker_rows]
        for k in reversed(range(len(self.links))):
            if self.links[k].parent != NONE:
                below[self.links[k].parent] |= below[k]
        return tuple(np.array(sorted(s), dtype=np.intp) for s in below)

    @cached_property
    def marker_rows(self) -> tuple[NDArray[np.intp], ...]:
        """For every link the markers that sit on it."""
        return tuple(np.flatnonzero(self.marker_link == k) for k in range(len(self.links)))

    @cached_property
    def variables(self) -> tuple[tuple[int, ...], ...]:
        """For every link the variables that enter its moves, ascending."""
        return tuple(
            tuple(
                sorted(
                    {
                        v
                        for move in link.moves
                        if not isinstance(move, Fixed)
                        for term in move.terms
                        for v in variables_of(self, term)
                    }
                )
            )
            for link in self.links
        )

    @cached_property
    def terms_of_marker(self) -> dict[int, tuple[TermArrays, ...]]:
        """The varying terms of each marker that has any."""
        terms: dict[int, tuple[TermArrays, ...]] = {}
        for item in self.marker_terms:
            terms[item.marker] = (*terms.get(item.marker, ()), item.term)
        return terms


def variables_of(tree: Tree, term: TermArrays) -> list[int]:
    """The variables that enter a term: its coordinate, its parameter."""
    found = []
    if term.factor != NONE and tree.factors[term.factor].coordinate != NONE:
        found.append(tree.factors[term.factor].coordinate)
    if term.parameter != NONE:
        found.append(tree.n_coordinates + term.parameter)
    return found


def rates_of(tree: Tree, values: Values, term: TermArrays) -> list[tuple[int, Array | float]]:
    """The variables of a term and the rate of its scalar part with each."""
    rates: list[tuple[int, Array | float]] = []
    if term.factor != NONE and tree.factors[term.factor].coordinate != NONE:
        rates.append((tree.factors[term.factor].coordinate, values.by_coordinate(term)))
    if term.parameter != NONE:
        rates.append((tree.n_coordinates + term.parameter, values.by_parameter(term)))
    return rates


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Frames of all nodes and links for a block of frames.

    Parameters
    ----------
    plan : Plan
    node_axes : ndarray, shape (n_nodes, 3, 3, n_frames)
        ``node_axes[node, j]`` is the node's j-th axis in ground.
    node_origins : ndarray, shape (n_nodes, 3, n_frames), m
    values : Values
    """

    plan: Plan
    node_axes: Array
    node_origins: Array
    values: Values

    @property
    def axes(self) -> Array:
        """Axes of all links, shape (n_links, 3, 3, n_frames)."""
        return self.node_axes[self.plan.link_node]

    @property
    def origins(self) -> Array:
        """Origins of all links, shape (n_links, 3, n_frames), m."""
        return self.node_origins[self.plan.link_node]

    def direction(self, entry: Entry) -> Array:
        """An entry's axis or shift in ground, (3, n_frames)."""
        return ground_direction(self.node_axes[self.plan.parent[entry.node]], entry.direction[:, None])


def forward(
    tree: Tree, q: Array, p: Array, signals: Array | None = None, ground: Array | None = None
) -> Poses:
    """Poses of all links.

    Parameters
    ----------
    q : ndarray, shape (n_coordinates, n_frames), rad or m
    p : ndarray, shape (n_parameters,)
    signals : ndarray, shape (n_signals, n_frames), optional
    ground : ndarray, shape (3, n_frames), m, optional
        Where the ground origin lies; zero unless given. Moving it near the body keeps moments
        about it small.
    """
    plan, n = tree.plan, q.shape[1]
    values = Values.of(tree.factors, q, p, signals, tree.shape_groups)
    angle = plan.angles.values(q, values)[:, None, None]
    turned = plan.fixed + plan.sine * np.sin(angle)
    turned += plan.cosine * np.cos(angle)
    shift = plan.shifts.values(q, values).reshape(-1, 3, n)
    axes, origins = np.empty((len(plan.parent), 3, 3, n)), np.empty((len(plan.parent), 3, n))
    axes[0] = np.eye(3)[:, :, None]
    origins[0] = 0.0 if ground is None else ground
    for level in plan.levels:
        carrier = axes[plan.parent[level]]
        np.einsum("gjan,gjkn->gkan", carrier, turned[level], out=axes[level])
        np.einsum("gjan,gjn->gan", carrier, shift[level], out=origins[level])
        origins[level] += origins[plan.parent[level]]
    return Poses(plan, axes, origins, values)


def ground_direction(axes: Array, local: Array) -> Array:
    """A local vector (3, n_frames or 1) in ground, (3, n_frames), by a frame's axes (3, 3, n_frames)."""
    result: Array = axes[0] * local[0] + axes[1] * local[1] + axes[2] * local[2]
    return result


def positions(tree: Tree, poses: Poses) -> Array:
    """Marker positions in ground, shape (n_markers, 3, n_frames), m."""
    n = poses.node_origins.shape[2]
    result = np.empty((tree.n_markers, 3, n))
    for k, rows in enumerate(tree.marker_rows):
        if len(rows):
            node = poses.plan.link_node[k]
            spread = tree.marker_local[rows] @ poses.node_axes[node].reshape(3, -1)
            result[rows] = spread.reshape(-1, 3, n) + poses.node_origins[node]
    for marker, terms in tree.terms_of_marker.items():
        node = poses.plan.link_node[tree.marker_link[marker]]
        result[marker] += ground_direction(poses.node_axes[node], poses.values.vector(np.zeros(3), terms))
    return result


def cross(a: Array, b: Array) -> Array:
    """Cross product over the second-last axis (3 components), frames last."""
    result = np.empty(np.broadcast_shapes(a.shape, b.shape))
    a0, a1, a2 = a[..., 0, :], a[..., 1, :], a[..., 2, :]
    b0, b1, b2 = b[..., 0, :], b[..., 1, :], b[..., 2, :]
    result[..., 0, :] = a1 * b2 - a2 * b1
    result[..., 1, :] = a2 * b0 - a0 * b2
    result[..., 2, :] = a0 * b1 - a1 * b0
    return result


def jacobian(tree: Tree, poses: Poses, placed: Array, variables: NDArray[np.intp]) -> Array:
    """Derivatives of all marker positions with respect to some variables.

    Parameters
    ----------
    placed : ndarray, shape (n_markers, 3, n_frames)
        As :func:`positions` gives them.
    variables : ndarray of int, shape (n_variables,)
        Coordinates first, then ``n_coordinates + parameter``.

    Returns
    -------
    ndarray, shape (n_variables, n_markers, 3, n_frames)
    """
    row = {int(v): k for k, v in enumerate(variables)}
    result = np.zeros((len(variables), *placed.shape))
    for entry in tree.plan.entries:
        rows = tree.carried[entry.link]
        wanted = [(v, r) for v, r in rates_of(tree, poses.values, entry.term) if v in row]
        if not wanted or not len(rows):
            continue
        motion = poses.direction(entry)
        if entry.is_turn:
            motion = cross(motion, placed[rows] - poses.node_origins[entry.node])
        for variable, rate in wanted:
            result[row[variable], rows] += motion * rate
    for marker, terms in tree.terms_of_marker.items():
        axes = poses.node_axes[poses.plan.link_node[tree.marker_link[marker]]]
        for term in terms:
            for variable, rate in rates_of(tree, poses.values, term):
                if variable in row:
                    result[row[variable], marker] += ground_direction(axes, term.gain[:, None] * rate)
    return result


def marker_positions(tree: Tree, q: Array, p: Array, signals: Array | None = None) -> Array:
    """Marker positions in ground for coordinates by frame.

    Parameters
    ----------
    q : ndarray, shape (n_frames, n_coordinates), rad or m
    p : ndarray, shape (n_parameters,)
    signals : ndarray, shape (n_frames, n_signals), optional

    Returns
    -------
    ndarray, shape (n_frames, n_markers, 3), m
    """
    by_frame = np.ascontiguousarray(np.asarray(q, dtype=float).T)
    known = None if signals is None else np.ascontiguousarray(signals.T)
    placed = positions(tree, forward(tree, by_frame, np.asarray(p, dtype=float), known))
    return np.ascontiguousarray(np.moveaxis(placed, -1, 0))
