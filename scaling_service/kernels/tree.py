"""Poses of a tree of joints for all frames at once, and how markers move with every variable.

Inside, frames are the last axis and a rotation is stored by its three axis vectors:
``axes[j]`` is the j-th axis of the frame, expressed in ground, shape (3, n_frames).
Variables are the coordinates (per frame) followed by the parameters (shared by all frames).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scaling_service.kernels.laws import NONE, Array, Factor, TermArrays, Values


@dataclass(frozen=True, slots=True, eq=False)
class Shift:
    """A translation by ``constant + sum of terms``, expressed in the frame reached so far (m)."""

    constant: Array
    terms: tuple[TermArrays, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """A rotation about axis 0, 1 or 2 of the frame reached so far (rad)."""

    axis: int
    constant: float
    terms: tuple[TermArrays, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Fixed:
    """A constant rotation, (3, 3), mapping the new frame to the one reached so far."""

    rotation: Array


Move = Shift | Turn | Fixed


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """The moves that lead from a parent link to this one; parent ``NONE`` is ground."""

    parent: int
    moves: tuple[Move, ...]


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
    def carried(self) -> tuple[NDArray[np.intp], ...]:
        """For every link the markers on it and on everything that hangs on it."""
        below: list[set[int]] = [
            set(np.flatnonzero(self.marker_link == k).tolist()) for k in range(len(self.links))
        ]
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
        return tuple(tuple(sorted(set(_variables_of(self, link)))) for link in self.links)

    @cached_property
    def terms_of_marker(self) -> dict[int, tuple[TermArrays, ...]]:
        """The varying terms of each marker that has any."""
        terms: dict[int, tuple[TermArrays, ...]] = {}
        for item in self.marker_terms:
            terms[item.marker] = (*terms.get(item.marker, ()), item.term)
        return terms


def _variables_of(tree: Tree, link: Link) -> list[int]:
    found = []
    for move in link.moves:
        for term in () if isinstance(move, Fixed) else move.terms:
            if term.parameter != NONE:
                found.append(tree.n_coordinates + term.parameter)
            if term.factor != NONE and tree.factors[term.factor].coordinate != NONE:
                found.append(tree.factors[term.factor].coordinate)
    return found


@dataclass(slots=True, eq=False)
class Poses:
    """Frames of all links for a block of frames.

    Parameters
    ----------
    axes : list of ndarray, shape (3, 3, n_frames)
        ``axes[link][j]`` is the link's j-th axis in ground.
    origins : list of ndarray, shape (3, n_frames), m
    screws : list of list of (move index, direction, point)
        Where each varying move of a link acts: a turn's axis and a point on it, or, for a shift,
        the frame's axes (3, 3, n_frames) and None.
    values : Values
    """

    axes: list[Array]
    origins: list[Array]
    screws: list[list[tuple[int, Array, Array | None]]]
    values: Values


_IDENTITY = np.eye(3)[:, :, None]
_NEXT = ((1, 2), (2, 0), (0, 1))  # the plane that a turn about axis 0, 1 or 2 mixes


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
    n = q.shape[1]
    values = Values.of(tree.factors, q, p, signals)
    poses = Poses([], [], [], values)
    root = (np.broadcast_to(_IDENTITY, (3, 3, n)), np.zeros((3, n)) if ground is None else ground)
    for link in tree.links:
        axes, origin = root if link.parent == NONE else (poses.axes[link.parent], poses.origins[link.parent])
        screws: list[tuple[int, Array, Array | None]] = []
        for index, move in enumerate(link.moves):
            if isinstance(move, Turn):
                screws.append((index, axes[move.axis], origin))
                axes = _turned(axes, move.axis, values.scalar(move.constant, move.terms))
            elif isinstance(move, Shift):
                if move.terms:
                    screws.append((index, axes, None))
                origin = origin + _along(axes, values.vector(move.constant, move.terms))
            else:
                axes = np.matmul(move.rotation.T, axes.reshape(3, -1)).reshape(3, 3, -1)
        poses.axes.append(axes)
        poses.origins.append(origin)
        poses.screws.append(screws)
    return poses


def _turned(axes: Array, axis: int, angle: Array | float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    i, j = _NEXT[axis]
    turned = np.empty(axes.shape)
    turned[axis] = axes[axis]
    turned[i] = c * axes[i] + s * axes[j]
    turned[j] = c * axes[j] - s * axes[i]
    return turned


def _along(axes: Array, local: Array) -> Array:
    """A local vector (3, n or 1) in ground, (3, n)."""
    result: Array = axes[0] * local[0] + axes[1] * local[1] + axes[2] * local[2]
    return result


def positions(tree: Tree, poses: Poses) -> Array:
    """Marker positions in ground, shape (n_markers, 3, n_frames), m."""
    n = poses.origins[0].shape[1]
    result = np.empty((tree.n_markers, 3, n))
    for k, rows in enumerate(tree.marker_rows):
        if len(rows):
            spread = tree.marker_local[rows] @ poses.axes[k].reshape(3, -1)
            result[rows] = spread.reshape(-1, 3, n) + poses.origins[k]
    for marker, terms in tree.terms_of_marker.items():
        local = poses.values.vector(np.zeros(3), terms)
        result[marker] += _along(poses.axes[tree.marker_link[marker]], local)
    return result


def columns(
    tree: Tree, poses: Poses, link: int, variables: Sequence[int] | None = None
) -> list[tuple[int, Array | None, Array]]:
    """How each variable moves a link relative to its parent: twists about the ground origin.

    Returns
    -------
    list of (variable, turn, shift)
        ``turn`` (3, n_frames) is the angular velocity per unit of the variable (None if it only
        translates), ``shift`` (3, n_frames) the velocity of the point now at the ground origin.
    """
    wanted = tree.variables[link] if variables is None else variables
    twists: dict[int, list[tuple[Array | None, Array]]] = {v: [] for v in wanted}
    for index, direction, point in poses.screws[link]:
        move = tree.links[link].moves[index]
        assert not isinstance(move, Fixed)
        for term in move.terms:
            for variable, rate in _rates(tree, poses.values, term):
                if variable in twists:
                    twists[variable].append(_twist(term, rate, direction, point))
    return [(v, *_sum(parts)) for v, parts in twists.items() if parts]


def _rates(tree: Tree, values: Values, term: TermArrays) -> list[tuple[int, Array | float]]:
    """The variables of a term and the rate of its scalar part with each."""
    rates: list[tuple[int, Array | float]] = []
    if term.factor != NONE and tree.factors[term.factor].coordinate != NONE:
        rates.append((tree.factors[term.factor].coordinate, values.by_coordinate(term)))
    if term.parameter != NONE:
        rates.append((tree.n_coordinates + term.parameter, values.by_parameter(term)))
    return rates


def _twist(
    term: TermArrays, rate: Array | float, direction: Array, point: Array | None
) -> tuple[Array | None, Array]:
    if point is None:
        return None, _along(direction, (term.gain[:, None] * rate))
    turn = direction * (term.gain[0] * rate)
    return turn, cross(point, turn)


def _sum(parts: list[tuple[Array | None, Array]]) -> tuple[Array | None, Array]:
    turn, shift = parts[0]
    for other_turn, other_shift in parts[1:]:
        shift = shift + other_shift
        if other_turn is not None:
            turn = other_turn if turn is None else turn + other_turn
    return turn, shift


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
    for link, rows in enumerate(tree.carried):
        if not len(rows):
            continue
        wanted = [v for v in tree.variables[link] if v in row]
        for variable, turn, shift in columns(tree, poses, link, wanted) if wanted else ():
            motion = shift if turn is None else cross(turn, placed[rows]) + shift
            result[row[variable], rows] += motion
    for marker, terms in tree.terms_of_marker.items():
        axes = poses.axes[tree.marker_link[marker]]
        for term in terms:
            for variable, rate in _rates(tree, poses.values, term):
                if variable in row:
                    result[row[variable], marker] += _along(axes, term.gain[:, None] * rate)
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
