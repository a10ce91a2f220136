"""The order in which coordinates are eliminated from the leaves to the root, and the sweeps that do it.

Links of equal depth do not touch each other, so their k-th last coordinates are eliminated in one
operation: a *round*. Rows (links) are sorted by depth and number of coordinates, columns (coordinates)
by round, so that everything a round needs lies together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.kernels.clusters import wrench_rate
from scaling_service.kernels.laws import NONE, Array
from scaling_service.kernels.plan import Entry, is_plain
from scaling_service.kernels.tree import Poses, Tree, cross, rates_of

Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class _Simple:
    """Columns made of one entry with a constant gain: all at once."""

    columns: Index
    parents: Index
    nodes: Index
    directions: Array  # (c, 3)


@dataclass(frozen=True, slots=True, eq=False)
class Depth:
    """Links of one depth: their rows, and the rounds (rows, columns) that eliminate their coordinates."""

    rows: slice
    rounds: tuple[tuple[slice, slice], ...]


@dataclass(frozen=True, slots=True, eq=False)
class Elimination:
    """The plan for one tree and one choice of free coordinates.

    Parameters
    ----------
    parent_row : tuple of int
        For every row the row of the link that carries it, ``NONE`` for ground.
    depths : tuple of Depth
        The deepest first.
    variables, column_row : ndarray of int, shape (n_columns,)
        The coordinate of each column, and the row of its link.
    row_of_link : ndarray of int, shape (n_links,)
    """

    parent_row: tuple[int, ...]
    depths: tuple[Depth, ...]
    variables: Index
    column_row: Index
    row_of_link: Index
    turns: _Simple
    shifts: _Simple
    general: tuple[tuple[int, tuple[Entry, ...]], ...]


def elimination_of(tree: Tree, free: NDArray[np.bool_]) -> Elimination:
    """Plan the elimination of the free coordinates of an articulated tree."""
    own = [_coordinates(tree, link, free) for link in range(len(tree.links))]
    depth: list[int] = []
    for link in tree.links:
        depth.append(0 if link.parent == NONE else depth[link.parent] + 1)
    order = sorted(range(len(own)), key=lambda k: (depth[k], -len(own[k])))
    row_of_link = np.argsort(order)
    depths, columns = [], []
    start = 0
    groups = [[k for k in order if depth[k] == d] for d in range(max(depth) + 1)]
    starts = np.cumsum([0, *map(len, groups)])
    for group, first in reversed(list(zip(groups, starts[:-1].tolist(), strict=True))):
        rounds = []
        for k in range(len(own[group[0]])):
            active = [link for link in group if len(own[link]) > k]
            columns += [(own[link][-1 - k], link) for link in active]
            rounds.append((slice(first, first + len(active)), slice(start, start + len(active))))
            start += len(active)
        depths.append(Depth(slice(first, first + len(group)), tuple(rounds)))
    parents = tuple(
        NONE if tree.links[k].parent == NONE else int(row_of_link[tree.links[k].parent]) for k in order
    )
    turns, shifts, general = _sorted_entries(tree, columns)
    return Elimination(
        parents,
        tuple(depths),
        np.array([v for v, _ in columns], dtype=np.intp),
        np.array([row_of_link[link] for _, link in columns], dtype=np.intp),
        row_of_link,
        turns,
        shifts,
        general,
    )


def _coordinates(tree: Tree, link: int, free: NDArray[np.bool_]) -> list[int]:
    """The free coordinates of a link in the order in which its moves first use them.

    Second derivatives need it: what stands before carries what comes after.
    """
    used = [
        tree.factors[e.term.factor].coordinate
        for e in tree.plan.entries
        if e.link == link and e.term.factor != NONE
    ]
    return [v for v in dict.fromkeys(used) if v != NONE and free[v]]


def _sorted_entries(
    tree: Tree, columns: Sequence[tuple[int, int]]
) -> tuple[_Simple, _Simple, tuple[tuple[int, tuple[Entry, ...]], ...]]:
    turns: list[tuple[int, Entry]] = []
    shifts: list[tuple[int, Entry]] = []
    general = []
    for column, (variable, link) in enumerate(columns):
        entries = [
            e
            for e in tree.plan.entries
            if e.link == link and e.term.factor != NONE and tree.factors[e.term.factor].coordinate == variable
        ]
        if len(entries) == 1 and is_plain(entries[0].term, tree.factors):
            (turns if entries[0].is_turn else shifts).append((column, entries[0]))
        else:
            general.append((column, tuple(entries)))
    return _simple(tree, turns), _simple(tree, shifts), tuple(general)


def _simple(tree: Tree, items: Sequence[tuple[int, Entry]]) -> _Simple:
    nodes = np.array([e.node for _, e in items], dtype=np.intp)
    return _Simple(
        np.array([c for c, _ in items], dtype=np.intp),
        tree.plan.parent[nodes],
        nodes,
        np.array([e.direction for _, e in items]).reshape(-1, 3),
    )


def twists(plan: Elimination, tree: Tree, poses: Poses) -> Array:
    """How every column moves its link: angular and linear velocity about the ground origin, (c, 6, n)."""
    n = poses.node_origins.shape[2]
    result = np.zeros((len(plan.variables), 6, n))
    if len(plan.turns.columns):
        turn = np.einsum("tjan,tj->tan", poses.node_axes[plan.turns.parents], plan.turns.directions)
        result[plan.turns.columns, :3] = turn
        result[plan.turns.columns, 3:] = cross(poses.node_origins[plan.turns.nodes], turn)
    if len(plan.shifts.columns):
        axes = poses.node_axes[plan.shifts.parents]
        result[plan.shifts.columns, 3:] = np.einsum("tjan,tj->tan", axes, plan.shifts.directions)
    for column, entries in plan.general:
        for entry in entries:
            rate = dict(rates_of(tree, poses.values, entry.term))[int(plan.variables[column])]
            direction = poses.direction(entry) * rate
            if entry.is_turn:
                result[column, :3] += direction
                direction = cross(poses.node_origins[entry.node], direction)
            result[column, 3:] += direction
    return result


@dataclass(frozen=True, slots=True, eq=False)
class Pull:
    """What acts on the coordinates themselves, by column: each (c, n) or (c, 1)."""

    stiffness: Array  # weight of a coordinate's own task
    drive: Array  # that weight times the way to its value
    low: Array  # how far down to its lower bound, not positive
    high: Array  # how far up to its upper bound, not negative


def step(
    plan: Elimination,
    mass: Array,
    twist: Array,
    pull: Pull | None,
    damping: Array,
    floor: Array,
    near: Array,
) -> tuple[Array, Array]:
    """One damped step of all columns, (c, n), and the decrease of the cost it promises, (n,).

    Parameters
    ----------
    mass : ndarray, shape (n_rows, 6, 7, n)
        Curvature and wrench of every link's own markers; overwritten.
    twist : ndarray, shape (c, 6, n)
    damping, floor, near : ndarray, shape (n,)
        Share of each pivot, least pivot, and whether second derivatives are used.

    Notes
    -----
    A coordinate that would pass its bound is moved just to it, and what carries it is then
    eliminated knowing so.
    """
    bend = _bend(plan, mass, twist, near) if near.any() else None
    grown, count = 1.0 + damping, len(plan.variables)
    scaled = np.empty(twist.shape)
    free, drive, pivots = (np.empty((count, len(near))) for _ in range(3))
    for depth in plan.depths:
        for rows, columns in depth.rounds:
            block = mass[rows]
            push = np.einsum("gin,gijn->gjn", twist[columns], block)
            if bend is not None:
                push[:, :6] -= bend[columns]
            pivot = np.abs(np.einsum("gjn,gjn->gn", twist[columns], push[:, :6]))
            if pull is not None:
                pivot += pull.stiffness[columns]
                push[:, 6] += pull.drive[columns]
            ratio = 1.0 / (pivot * grown + floor)
            free[columns] = push[:, 6] * ratio
            if pull is not None:
                within = np.clip(free[columns], pull.low[columns], pull.high[columns])
                stopped = within != free[columns]
                block[:, :, 6] -= push[:, :6] * np.where(stopped, within, 0.0)[:, None]
                ratio[stopped], free[columns] = 0.0, within
            scaled[columns] = push[:, :6] * ratio[:, None]
            drive[columns], pivots[columns] = push[:, 6], pivot
            block -= scaled[columns][:, :, None] * push[:, None]
        for row in range(depth.rows.start, depth.rows.stop):
            if plan.parent_row[row] != NONE:
                mass[plan.parent_row[row]] += mass[row]
    promised = np.einsum("cn,cn->n", free, 2.0 * drive - pivots * free)
    return _descend(plan, twist, scaled, free), promised


def _bend(plan: Elimination, mass: Array, twist: Array, near: Array) -> Array:
    """Half of how each column turns the residual wrench of all that it carries, (c, 6, n)."""
    load = mass[:, :, 6] * (0.5 * near)
    for depth in plan.depths:
        for row in range(depth.rows.start, depth.rows.stop):
            if plan.parent_row[row] != NONE:
                load[plan.parent_row[row]] += load[row]
    return wrench_rate(twist, load[plan.column_row])


def _descend(plan: Elimination, twist: Array, scaled: Array, free: Array) -> Array:
    """From the root to the leaves: each column's step, given how its link is carried along (in ``free``)."""
    motion = np.zeros((len(plan.parent_row), 6, free.shape[1]))
    for depth in reversed(plan.depths):
        for row in range(depth.rows.start, depth.rows.stop):
            if plan.parent_row[row] != NONE:
                motion[row] = motion[plan.parent_row[row]]
        for rows, columns in reversed(depth.rounds):
            free[columns] -= np.einsum("gjn,gjn->gn", scaled[columns], motion[rows])
            motion[rows] += twist[columns] * free[columns][:, None]
    return free
