"""A tree with mass: which entries carry which links, as matrices of zeros and ones.

Twists and wrenches are written in ground axes at the ground origin. They then need no transformation
from body to body: the twist of a link is the sum of the twists of all entries above it, and the force
through an entry is the sum of the forces on all links below it. Both sums are one matrix product for
all frames (Featherstone 2008, Rigid Body Dynamics Algorithms, sec. 2.14 and 5.3).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scaling_service.numerics.multibody.laws import NONE, Array
from scaling_service.numerics.multibody.plan import Entry
from scaling_service.numerics.multibody.tree import Tree

TENSOR = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Places of the six numbers of a symmetric tensor: xx, yy, zz, xy, xz, yz."""

N_PARAMETERS = 10
"""Inertial parameters of a link: mass, first moments x, y, z, tensor about the link's origin (six)."""


@dataclass(frozen=True, slots=True, eq=False)
class Inertias:
    """What every link weighs and how it resists turning."""

    mass: Array  # (n_links,), kg
    com: Array  # (n_links, 3), m: centre of mass in the link's frame
    tensor: Array  # (n_links, 3, 3), kg m2: about the centre of mass, in the link's axes

    def parameters(self) -> Array:
        """The numbers that forces are linear in, shape (n_links, 10).

        Mass (kg), mass times centre of mass (kg m), tensor about the link's *origin* xx, yy, zz, xy, xz,
        yz (kg m2).
        """
        about_origin = self.tensor + self.mass[:, None, None] * _point_tensor(self.com)
        six = np.stack([about_origin[:, i, j] for i, j in TENSOR], axis=1)
        return np.concatenate([self.mass[:, None], self.mass[:, None] * self.com, six], axis=1)

    @classmethod
    def of_parameters(cls, parameters: Array) -> Inertias:
        """The inverse of :meth:`parameters`; a link without mass keeps its centre at the origin.

        ``parameters``: (n_links, 10).
        """
        mass = parameters[:, 0]
        com = np.divide(
            parameters[:, 1:4], mass[:, None], out=np.zeros((len(mass), 3)), where=mass[:, None] != 0
        )
        tensor = np.empty((len(mass), 3, 3))
        for k, (i, j) in enumerate(TENSOR):
            tensor[:, i, j] = tensor[:, j, i] = parameters[:, 4 + k]
        return cls(mass, com, tensor - mass[:, None, None] * _point_tensor(com))


def _point_tensor(at: Array) -> Array:
    """Tensor of unit masses at some places (n, 3) about the origin, (n, 3, 3)."""
    squares = (at**2).sum(axis=1)
    tensors: Array = squares[:, None, None] * np.eye(3) - at[:, :, None] * at[:, None, :]
    return tensors


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A compiled tree and what its links weigh."""

    tree: Tree  # With every link that has mass
    inertias: Inertias  # One row per link of the tree

    def __post_init__(self) -> None:
        if len(self.inertias.mass) != len(self.tree.links):
            raise ValueError(f"{len(self.inertias.mass)} inertias do not fit {len(self.tree.links)} links")

    @property
    def n_links(self) -> int:
        """The number of links."""
        return len(self.tree.links)

    @cached_property
    def entries(self) -> tuple[Entry, ...]:
        """The terms that move with time, turns first, then shifts."""
        moving = [e for e in self.tree.plan.entries if e.term.factor != NONE]
        return tuple(sorted(moving, key=lambda e: not e.is_turn))

    @cached_property
    def n_turns(self) -> int:
        """How many of the entries are turns."""
        return sum(e.is_turn for e in self.entries)

    @cached_property
    def carriers(self) -> Array:
        """1 where an entry moves a link, shape (n_entries, n_links)."""
        rows = [self._at_or_below(e.node)[self.tree.plan.link_node] for e in self.entries]
        return np.array(rows, dtype=float).reshape(len(self.entries), self.n_links)

    @cached_property
    def before(self) -> Array:
        """1 where entry j moves the frame that entry i starts from, shape (n_entries, n_entries).

        A node shifts first and turns then.
        """
        nodes = np.array([e.node for e in self.entries], dtype=np.intp)
        turns = np.array([e.is_turn for e in self.entries], dtype=bool)
        result = np.zeros((len(nodes), len(nodes)))
        for j, entry in enumerate(self.entries):
            reached = self._at_or_below(entry.node)
            reached[entry.node] = False
            result[:, j] = reached[nodes] | ((nodes == entry.node) & turns & (not entry.is_turn))
        return result

    @cached_property
    def coordinates(self) -> NDArray[np.intp]:
        """The coordinate that each entry follows, shape (n_entries,)."""
        return np.array([self.tree.factors[e.term.factor].coordinate for e in self.entries], dtype=np.intp)

    @cached_property
    def gathering(self) -> Array:
        """1 where an entry acts on a coordinate, shape (n_coordinates, n_entries)."""
        rows = np.arange(self.tree.n_coordinates)[:, None]
        return np.asarray((rows == self.coordinates[None, :]).astype(float))

    def _at_or_below(self, node: int) -> NDArray[np.bool_]:
        """Which nodes are this one or hang on it, shape (n_nodes,)."""
        parent = self.tree.plan.parent
        found = np.zeros(len(parent), dtype=bool)
        found[node] = True
        for k in range(node + 1, len(parent)):  # nodes are sorted by depth: parents first
            found[k] = found[parent[k]]
        return found
