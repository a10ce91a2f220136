"""The articulated-body algorithm for steps of a fit: from the leaves to the root, and back.

The normal equations of markers on a tree are the equations of motion of a tree of bodies at rest whose masses
are the markers' weights (Featherstone 2008, Rigid Body Dynamics Algorithms, table 7.1). The step of a
coordinate is its acceleration; the markers' residuals are forces. His letters stand for

- ``S`` (6,): motion subspace of a coordinate, the twist of its link per unit;
- ``IA`` (6, 6): articulated-body inertia of a link, the information on its pose from all markers at or below
  it, the coordinates below being eliminated;
- ``pA`` (6,): its bias force, the gradient of half the cost by its pose, likewise: the residuals' wrench,
  negative;
- ``U = IA S``, ``D = S' U`` and ``u = tau - S' pA``: ``tau`` is what pulls the coordinate itself, whose
  weight adds to ``D`` as a rotor's inertia does;
- ``a`` (6,): spatial acceleration of a link, the twist by which the step moves it.

Eliminating a coordinate leaves ``IA - U U' / D`` and ``pA + U u / D`` to what carries it. Nothing has a
velocity, so there is no ``c`` and no ``v x* I v``. Twists and wrenches are in ground axes about the ground
origin, so what children leave is added to their parents without a transform. Near the minimum second
derivatives add to the links' own inertia, and half of how ``S`` turns the residuals' wrench comes off ``U``.

Links of equal depth do not touch each other, so their k-th last coordinates are eliminated in one
operation: a *round*. Rows (links) are sorted by depth and number of coordinates, columns (coordinates)
by round, so that everything a round needs lies together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.numerics.least_squares.clusters import compute_wrench_rate
from scaling_service.numerics.multibody import plan as plans
from scaling_service.numerics.multibody import tree as trees
from scaling_service.numerics.multibody.laws import NONE

Index = NDArray[np.intp]
_KEPT = 32  # plans; as many as trees are kept


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Moves:
    """What columns do at nodes: turn about, or shift along, a direction of the parent node's frame.

    The rows come in sets, turns before shifts; ``targets`` holds the rows of each set and their columns, of
    which none stands twice in a set. ``turning`` counts the sets of turns, ``turned`` are the nodes of these.
    ``constant`` (m, 3, 1) is the part of the direction that does not vary; ``matrix`` (3 m, len(varying))
    times the rates of the terms ``varying`` is the part that does.
    """

    targets: tuple[tuple[slice, Index], ...]
    turning: int
    turned: Index
    parents: Index
    constant: Array
    matrix: Array
    varying: tuple[plans.Entry, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Depth:
    """Links of one depth: the rounds (rows, columns) that eliminate their coordinates, and what carries them.

    ``carried`` pairs each row with the row of its parent; links on the ground are not in it.
    """

    rounds: tuple[tuple[slice, slice], ...]
    carried: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Elimination:
    """The plan for one tree and one choice of free coordinates."""

    depths: tuple[Depth, ...]  # The deepest first
    # variables, column_row: (n_columns,): the coordinate of each column, and the row of its link
    variables: Index
    column_row: Index
    # row_of_link, link_of_row: (n_links,)
    row_of_link: Index
    link_of_row: Index
    moves: _Moves


@lru_cache(maxsize=_KEPT)
def plan_elimination(tree: trees.Tree, chosen: bytes) -> Elimination:
    """Plan the elimination of the free coordinates of an articulated tree, bool (n_coordinates,) as bytes."""
    free = np.frombuffer(chosen, dtype=bool)
    # The free coordinates of every link in the order in which its moves first use them, which second
    # derivatives need: what stands before carries what comes after.
    own: list[list[int]] = []
    for k in range(len(tree.links)):
        used = [e.coordinate for e in tree.plan.moving if e.link == k]
        own.append([v for v in dict.fromkeys(used) if free[v]])
    depth: list[int] = []
    for link in tree.links:
        depth.append(0 if link.parent == NONE else depth[link.parent] + 1)
    order = sorted(range(len(own)), key=lambda k: (depth[k], -len(own[k])))
    row = {link: k for k, link in enumerate(order)}
    depths: list[Depth] = []
    columns: list[tuple[int, int]] = []
    for d in reversed(range(max(depth) + 1)):
        group = [link for link in order if depth[link] == d]
        rounds = []
        for k in range(len(own[group[0]])):
            active = [link for link in group if len(own[link]) > k]
            first, start = row[group[0]], len(columns)
            columns += [(own[link][-1 - k], link) for link in active]
            rounds.append((slice(first, first + len(active)), slice(start, len(columns))))
        carried = tuple((row[link], row[tree.links[link].parent]) for link in group if d)
        depths.append(Depth(tuple(rounds), carried))
    return Elimination(
        depths=tuple(depths),
        variables=np.array([v for v, _ in columns], dtype=np.intp),
        column_row=np.array([row[link] for _, link in columns], dtype=np.intp),
        row_of_link=np.argsort(order),
        link_of_row=np.array(order, dtype=np.intp),
        moves=_list_moves(tree, columns),
    )


Item = tuple[int, int, list[plans.Entry]]
"""A column, a node that it moves, and the terms by which it does."""


def _list_moves(tree: trees.Tree, columns: Sequence[tuple[int, int]]) -> _Moves:
    turns, shifts = (_list_sets(tree, columns, turns=turns) for turns in (True, False))
    items = [item for group in (*turns, *shifts) for item in group]
    nodes = np.array([node for _, node, _ in items], dtype=np.intp)
    constant = np.zeros((len(items), 3, 1))
    varying: list[tuple[int, plans.Entry]] = []
    for row, (_, _, entries) in enumerate(items):
        for entry in entries:
            if plans.is_plain(entry.term, tree.factors):
                constant[row, :, 0] += entry.direction
            else:
                varying.append((row, entry))
    matrix = np.zeros((len(items), 3, len(varying)))
    for k, (row, entry) in enumerate(varying):
        matrix[row, :, k] = entry.direction
    ends = np.cumsum([0, *(len(group) for group in (*turns, *shifts))]).tolist()
    targets = tuple(
        (slice(start, stop), np.array([column for column, _, _ in items[start:stop]], dtype=np.intp))
        for start, stop in pairwise(ends)
    )
    return _Moves(
        targets=targets,
        turning=len(turns),
        turned=nodes[: ends[len(turns)]],
        parents=tree.plan.parent[nodes],
        constant=constant,
        matrix=matrix.reshape(3 * len(items), len(varying)),
        varying=tuple(entry for _, entry in varying),
    )


def _list_sets(tree: trees.Tree, columns: Sequence[tuple[int, int]], *, turns: bool) -> list[list[Item]]:
    """The turns, or the shifts, of all columns; those that move several nodes come again in the next set."""
    found: list[dict[int, list[plans.Entry]]] = [{} for _ in columns]
    number = {variable: column for column, (variable, _) in enumerate(columns)}
    for entry in tree.plan.moving:
        if entry.is_turn == turns and entry.coordinate in number:
            found[number[entry.coordinate]].setdefault(entry.node, []).append(entry)
    return [
        [(c, *list(at.items())[k]) for c, at in enumerate(found) if len(at) > k]
        for k in range(max(map(len, found), default=0))
    ]


def compute_motion_subspaces(plan: Elimination, poses: trees.Poses) -> Array:
    """S of every column: angular and linear velocity of its link about the ground origin, (c, 6, n)."""
    moves, n = plan.moves, poses.frames.shape[-1]
    result = np.zeros((len(plan.variables), 6, n))
    local = moves.constant
    if moves.varying:
        rates = np.empty((len(moves.varying), n))
        for k, entry in enumerate(moves.varying):
            rates[k] = poses.values.by_coordinate(entry.term, entry.number)
        local = local + (moves.matrix @ rates).reshape(len(local), 3, n)
    directions = np.einsum("mjan,mjn->man", poses.frames[moves.parents, :3], local)
    about_ground = trees.cross(poses.frames[moves.turned, 3], directions[: len(moves.turned)])
    for k, (rows, columns) in enumerate(moves.targets):
        if k < moves.turning:
            result[columns, :3] += directions[rows]
            result[columns, 3:] += about_ground[rows]
        else:
            result[columns, 3:] += directions[rows]
    return result


Limits = tuple[Array, Array]
"""How far the coordinates may move, by column: down (not positive) and up (not negative), (c, n)."""


def solve_articulated(
    plan: Elimination,
    bodies: Array,
    S: Array,
    damping: tuple[Array, Array],
    *,
    second: Array,
    tasks: tuple[Array, Array] | None,
    limits: Limits,
) -> tuple[Array, Array]:
    """One damped step of all columns, (c, n), and the decrease of the cost it promises, (n,).

    ``bodies`` (n_rows, 6, 7, n): inertia of every link's own markers and, as seventh column, their residuals'
        wrench; overwritten, for they become ``IA`` and ``-pA``.
    ``S``: (c, 6, n).
    ``damping``: what is added to every ``D``: a share of it, and a least one, each (n,).
    ``second`` (n,): one where second derivatives are used, else zero.
    ``tasks``: of the coordinates themselves: weight, and weight times way to go (``tau``), each (c, n).

    A coordinate that would pass its bound is moved just to it, as a joint of known acceleration is in hybrid
    dynamics (Featherstone's ch. 9), and what carries it is then eliminated knowing so.
    """
    bend = None
    if second.any():
        # Half of how each column turns the residual wrench of all that it carries, (c, 6, n).
        load = bodies[:, :, 6] * (0.5 * second)
        for depth in plan.depths:
            for row, parent in depth.carried:
                load[parent] += load[row]
        bend = compute_wrench_rate(S, load[plan.column_row])
    grown, floor, (count, _, n) = 1.0 + damping[0], damping[1], S.shape
    # Of every column: U and u side by side, both over the damped D, and D itself
    U_u, by_D, pivots = np.empty((count, 7, n)), np.empty((count, 7, n)), np.empty((count, n))
    for depth in plan.depths:
        for rows, columns in depth.rounds:
            IA_pA, own, D, share = bodies[rows], U_u[columns], pivots[columns], by_D[columns]
            U, step = own[:, :6], share[:, 6]
            np.einsum("gin,gijn->gjn", S[columns], IA_pA, out=own)
            if bend is not None:
                U -= bend[columns]
            np.einsum("gjn,gjn->gn", S[columns], U, out=D)
            np.abs(D, out=D)
            if tasks is not None:
                D += tasks[0][columns]
                own[:, 6] += tasks[1][columns]
            damped = D * grown
            damped += floor
            np.divide(own, damped[:, None], out=share)
            # Coordinates that would pass their bounds are moved to them, and what carries them feels that.
            within = np.minimum(np.maximum(step, limits[0][columns]), limits[1][columns])
            stopped = within != step
            if stopped.any():
                IA_pA[:, :, 6] -= U * np.where(stopped, within, 0.0)[:, None]
                share[:, :6] *= ~stopped[:, None]
                step[:] = within
            IA_pA -= share[:, :6, None] * own[:, None]
        for row, parent in depth.carried:
            bodies[parent] += bodies[row]
    steps = by_D[:, 6].copy()
    promised = np.einsum("cn,cn->n", steps, 2.0 * U_u[:, 6] - pivots * steps)
    # From the root to the leaves: each column's step, given how its link is carried along
    a = np.zeros((len(plan.row_of_link), 6, n))
    for depth in reversed(plan.depths):
        for row, parent in depth.carried:
            a[row] = a[parent]
        for rows, columns in reversed(depth.rounds):
            carried, own_step = a[rows], steps[columns]
            own_step -= np.einsum("gjn,gjn->gn", by_D[columns, :6], carried)
            carried += S[columns] * own_step[:, None]
    return steps, promised
