"""The order in which a tree is computed: nodes by depth, so that left and right go together.

A *node* is at most one shift followed by at most one turn; a link is a run of nodes. Nodes of equal
depth do not depend on each other, so they are computed in one operation. Node 0 is the ground.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.numerics.multibody import laws

Index = NDArray[np.intp]
_TO_AXIS = (
    np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    np.eye(3),
)
"""Rotations whose z axis is axis 0, 1 or 2."""
_ORIGIN, _UNTURNED = np.zeros(3), np.eye(3)
_TURNING = np.stack(
    [np.diag([0.0, 0.0, 1.0]), [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]], np.diag([1.0, 1.0, 0.0])]
)
"""A rotation about z: its constant part, and what the angle's sine and cosine multiply."""
_STILL = np.stack([_UNTURNED, np.zeros((3, 3)), np.zeros((3, 3))])
"""No rotation, in the same parts."""


@dataclasses.dataclass(slots=True, kw_only=True)
class _Node:
    """A node while it is put together."""

    link: int
    shift: Array = dataclasses.field(default_factory=lambda: _ORIGIN)
    shift_terms: tuple[laws.TermArrays, ...] = ()
    before: Array = dataclasses.field(default_factory=lambda: _UNTURNED)
    after: Array = dataclasses.field(default_factory=lambda: _UNTURNED)
    turn: float | None = None
    turn_terms: tuple[laws.TermArrays, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Linear:
    """Laws of many nodes at once: ``constant``, a matrix times q, and the terms that are not linear in q.

    ``constant`` is (n_rows,); ``matrix`` (len(varying), n_coordinates) adds to the rows ``varying``;
    ``gains`` (len(curved), len(factors)) times the ``factors`` adds to the rows ``curved``; ``others`` holds
    (row, gain, term) of the terms with a parameter.
    """

    constant: Array
    varying: slice | Index
    matrix: Array
    curved: slice | Index
    gains: Array
    factors: tuple[int, ...]
    others: tuple[tuple[int, float, laws.TermArrays], ...]

    def values(self, q: Array, values: laws.Values) -> Array:
        """Values of all rows, (n_rows, n_frames)."""
        result = np.repeat(self.constant[:, None], q.shape[1], axis=1)
        result[self.varying] += self.matrix @ q
        if self.factors:
            result[self.curved] += self.gains @ np.array([values.factors[k] for k in self.factors])
        for row, gain, term in self.others:
            scale = gain * values.p[term.parameter]
            result[row] += scale * values.factors[term.factor] if term.factor != laws.NONE else scale
        return result


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Entry:
    """One term of one node's law: what it moves, and how.

    For a turn ``direction`` is its axis in the parent node's frame (times the gain) and
    ``is_turn`` is true; for a shift it is the term's gain there.
    """

    node: int
    link: int
    term: laws.TermArrays
    direction: Array
    is_turn: bool
    # Of a coordinate that moves it: which of its factor's, and which of all
    number: int = 0
    coordinate: int = laws.NONE


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Plan:
    """Nodes sorted by depth, as arrays; row 0 is the ground."""

    parent: Index  # (n_nodes,)
    # tuple of (slice, slice or ndarray of int): nodes of equal depth and the nodes that carry them, the
    # shallowest first, ground left out
    levels: tuple[tuple[slice, slice | Index], ...]
    link_node: Index  # (n_links,): the node that is each link's frame
    # (n_nodes, 9, 3): a node's rotation, column by column, is ``rotations @ [1, sin(angle), cos(angle)]``
    rotations: Array
    # angles, shifts: One row per node, and three rows per node
    angles: Linear
    shifts: Linear
    entries: tuple[Entry, ...]  # Every varying term, in the order of the links' moves
    moving: tuple[Entry, ...]  # those that coordinates move, once for each coordinate


def plan_of(links: Sequence[laws.Link], factors: Sequence[laws.Factor], n_coordinates: int) -> Plan:
    """Arrange the moves of all links for computation."""
    nodes: list[_Node] = [_Node(link=laws.NONE)]
    parents, last = [laws.NONE], [0] * len(links)
    for k, link in enumerate(links):
        before = 0 if link.parent == laws.NONE else last[link.parent]
        for node in _list_nodes(k, link):
            parents.append(before)
            nodes.append(node)
            before = len(nodes) - 1
        last[k] = before
    depth = [0]
    for parent in parents[1:]:
        depth.append(depth[parent] + 1)
    order = np.argsort(depth, kind="stable")
    place = np.argsort(order)
    ordered = [nodes[k] for k in order]
    edges = np.flatnonzero(np.diff(np.array(depth)[order])) + 1
    bounds = [*edges.tolist(), len(nodes)]
    parent_rows = np.array(
        [place[parents[k]] if parents[k] != laws.NONE else 0 for k in order], dtype=np.intp
    )
    levels = tuple((slice(a, b), run_of(parent_rows[a:b])) for a, b in pairwise(bounds))
    parts = np.stack([_STILL if node.turn is None else _TURNING for node in ordered])
    first, second = np.stack([node.before for node in ordered]), np.stack([node.after for node in ordered])
    rotations = (first[:, None] @ parts @ second[:, None]).transpose(0, 3, 2, 1)
    entries: list[Entry] = []
    for k in np.argsort(order).tolist():
        node = ordered[k]
        for terms, turns in ((node.shift_terms, False), (node.turn_terms, True)):
            ways = (node.before[:, 2] * t.gain[0] if turns else t.gain for t in terms)
            entries += [
                Entry(node=k, link=node.link, term=t, direction=way, is_turn=turns)
                for t, way in zip(terms, ways, strict=True)
            ]
    return Plan(
        parent=parent_rows,
        levels=levels,
        link_node=place[np.array(last, dtype=np.intp)],
        rotations=np.ascontiguousarray(rotations).reshape(len(ordered), 9, 3),
        angles=_build_linear(
            [(node.turn or 0.0,) for node in ordered], [n.turn_terms for n in ordered], factors, n_coordinates
        ),
        shifts=_build_linear(
            [tuple(n.shift) for n in ordered], [n.shift_terms for n in ordered], factors, n_coordinates
        ),
        entries=tuple(entries),
        moving=tuple(
            dataclasses.replace(entry, number=number, coordinate=coordinate)
            for entry in entries
            if entry.term.factor != laws.NONE
            for number, coordinate in enumerate(factors[entry.term.factor].coordinates)
        ),
    )


def _list_nodes(number: int, link: laws.Link) -> list[_Node]:
    nodes = [_Node(link=number)]
    for move in link.moves:
        node = nodes[-1]
        if isinstance(move, laws.Shift):
            if node.turn is not None or node.before is not _UNTURNED:
                node = _Node(link=number)
                nodes.append(node)
            node.shift = node.shift + move.constant
            node.shift_terms += move.terms
        elif isinstance(move, laws.Turn):
            if node.turn is not None:
                node = _Node(link=number)
                nodes.append(node)
            node.before = node.before @ _TO_AXIS[move.axis]
            node.after = _TO_AXIS[move.axis].T
            node.turn, node.turn_terms = move.constant, move.terms
        elif node.turn is None:
            node.before = node.before @ move.rotation
        else:
            node.after = node.after @ move.rotation
    return nodes


def run_of(rows: Index) -> slice | Index:
    """The rows as a slice, which needs no copy, where they follow each other or are all the same one."""
    if not len(rows):
        return slice(0)
    first = int(rows[0])
    if (rows == first).all():
        return slice(first, first + 1)
    return slice(first, first + len(rows)) if (np.diff(rows) == 1).all() else rows


def _build_linear(
    constants: Sequence[tuple[float, ...]],
    terms: Sequence[tuple[laws.TermArrays, ...]],
    factors: Sequence[laws.Factor],
    n_coordinates: int,
) -> Linear:
    width = len(constants[0])
    matrix = np.zeros((len(constants) * width, n_coordinates))
    gains = np.zeros((len(matrix), len(factors)))
    others = []
    for k, own in enumerate(terms):
        rows = slice(k * width, (k + 1) * width)
        for term in own:
            if is_plain(term, factors):
                matrix[rows, factors[term.factor].coordinate] += term.gain
            elif term.parameter == laws.NONE:
                gains[rows, term.factor] += term.gain
            else:
                others += [(k * width + i, float(gain), term) for i, gain in enumerate(term.gain) if gain]
    varying, curved = np.flatnonzero(matrix.any(axis=1)), np.flatnonzero(gains.any(axis=1))
    used = np.flatnonzero(gains.any(axis=0))
    constant = np.array(constants, dtype=float).ravel()
    return Linear(
        constant=constant,
        varying=run_of(varying),
        matrix=matrix[varying],
        curved=run_of(curved),
        gains=gains[np.ix_(curved, used)],
        factors=tuple(used.tolist()),
        others=tuple(others),
    )


def is_plain(term: laws.TermArrays, factors: Sequence[laws.Factor]) -> bool:
    """Whether a term is a constant times one coordinate, nothing else."""
    return term.parameter == laws.NONE and term.factor != laws.NONE and factors[term.factor].shape is None
