"""Equations between points of a tree that every pose must obey: loops that the tree does not close."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.numerics.multibody import tree as trees

Index = NDArray[np.intp]

CLOSED = 1e-6  # m or rad: what an equation may miss (chosen: a camera resolves no less)
_MOST_STEPS = 30  # chosen: Newton's method needs three or four where a pose is near
_DONE = 1e-11  # m or rad: equations that are met
_LONGEST = 0.5  # rad or m, chosen: further a linearised rotation means little
_RANK = 1e-8  # chosen: share of the largest rate below which equations only repeat each other


@dataclass(frozen=True, eq=False, kw_only=True)
class Closure:
    """Equations between the markers of a tree, all zero at a pose that obeys them.

    ``meeting`` (k, 2): points that are one, three equations each. ``apart`` (k, 2): points that are
    ``distances`` (k,), m, apart. ``level`` (k, 3): the way from the second point to the first is at right
    angles to the way from the second to the third.
    """

    tree: trees.Tree
    meeting: Index
    apart: Index
    distances: Array
    level: Index

    @property
    def count(self) -> int:
        """How many equations there are."""
        return 3 * len(self.meeting) + len(self.apart) + len(self.level)

    def evaluate(self, q: Array, p: Array) -> Array:
        """What the equations miss, (n, count), m, at coordinates (n, n_coordinates)."""
        poses = trees.pose_links(self.tree, np.ascontiguousarray(q.T), p)
        return self._miss(np.moveaxis(trees.place_tree_markers(self.tree, poses), -1, 0))

    def linearise(self, q: Array, p: Array, variables: Index) -> tuple[Array, Array]:
        """What the equations miss, (n, count), and its rates with variables, (n, n_variables, count)."""
        poses = trees.pose_links(self.tree, np.ascontiguousarray(q.T), p)
        placed = trees.place_tree_markers(self.tree, poses)
        rates = np.moveaxis(trees.compute_jacobian(self.tree, poses, placed, variables), -1, 0)
        x = np.moveaxis(placed, -1, 0)
        shape = (*rates.shape[:2], -1)
        met = (rates[:, :, self.meeting[:, 0]] - rates[:, :, self.meeting[:, 1]]).reshape(shape)
        i, j = self.apart.T
        way = x[:, i] - x[:, j]
        way /= np.linalg.norm(way, axis=2, keepdims=True) + 1e-300
        spread = np.einsum("nvkc,nkc->nvk", rates[:, :, i] - rates[:, :, j], way)
        a, b, c = self.level.T
        tilted = np.einsum("nvkc,nkc->nvk", rates[:, :, a] - rates[:, :, b], x[:, c] - x[:, b])
        tilted += np.einsum("nvkc,nkc->nvk", rates[:, :, c] - rates[:, :, b], x[:, a] - x[:, b])
        return self._miss(x), np.concatenate([met, spread, tilted], axis=2)

    def _miss(self, x: Array) -> Array:
        met = (x[:, self.meeting[:, 0]] - x[:, self.meeting[:, 1]]).reshape(len(x), -1)
        i, j = self.apart.T
        spread = np.linalg.norm(x[:, i] - x[:, j], axis=2) - self.distances
        a, b, c = self.level.T
        tilted = np.einsum("nkc,nkc->nk", x[:, a] - x[:, b], x[:, c] - x[:, b])
        return np.concatenate([met, spread, tilted], axis=1)

    def close(self, q: Array, p: Array, free: Index, lower: Array, upper: Array) -> None:
        """Move coordinates (n, n_coordinates), in place, the shortest way to where the equations are met.

        ``free`` int (m,): those that may move, ``lower``, ``upper`` (m,): how far. Where there is no such
        pose near, equations stay open: see :meth:`evaluate`.
        """
        rows = np.arange(len(q))
        for _ in range(_MOST_STEPS):
            missed, rates = self.linearise(q[rows], p, free)
            open_still = np.abs(missed).max(axis=1, initial=0.0) > _DONE
            rows, missed, rates = rows[open_still], missed[open_still], rates[open_still]
            if not len(rows):
                return
            now = q[np.ix_(rows, free)]
            step = _step_to(missed, rates)
            held = ((now <= lower) & (step < 0.0)) | ((now >= upper) & (step > 0.0))
            if held.any():
                step = _step_to(missed, rates * ~held[:, :, None])
            step *= _LONGEST / np.maximum(np.abs(step).max(axis=1, initial=0.0, keepdims=True), _LONGEST)
            q[np.ix_(rows, free)] = np.clip(now + step, lower, upper)


def _step_to(missed: Array, rates: Array) -> Array:
    """The least step (n, m) that meets linearised equations; those that repeat each other do no harm."""
    inverse = np.linalg.pinv(rates.transpose(0, 2, 1), rcond=_RANK)
    return np.asarray(-np.einsum("nmk,nk->nm", inverse, missed))
