"""The net wrench of a moving body from positions alone, for many perturbed motions.

A rigid segment moves as its mass at the centre of mass and three vectors fixed in it, along the principal
axes of its second moments of mass, as long as the roots of these moments. With ``y`` all these vectors
(the first times the root of the mass), the momentum balance about the ground origin is

    F = sum m (c'' - g),    M = sum y x y'' - sum m c x g.

``y''`` is a central difference ``sum_l w_l (y(i+l) + y(i-l))`` of high order, ``y x y`` is zero, so that

    sum y x y'' = sum_l w_l [G_l(i) - G_l(i-l)],    G_l(i) = sum y(i) x y(i+l):

the rate of an angular momentum taken between frames. No velocity, no acceleration and no inverse dynamics
of single segments is needed. Frames come last, as in the kernels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scaling_service.model.body import BodyModel, Marker, Segment
from scaling_service.model.compile import compile_model, parameter_values
from scaling_service.model.inertia import tensor_of
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import CYCLE, Poses, Tree, cross, forward
from scaling_service.numerics.wrench.ground_wrench import GRAVITY

STENCIL = (1.6, -0.2, 8.0 / 315.0, -1.0 / 560.0)
"""Weights of the central second difference of order 8 at lags 1 to 4, times the squared step (Fornberg 1988,
Math Comput 51:699-706, table 1). At 5 Hz and 100 frames per second it errs by 3e-8, at 20 Hz by 8e-4."""

HALO = len(STENCIL)
"""Frames on each side that the difference needs."""


def trees_of(model: BodyModel, markers: tuple[str, ...], segments: Sequence[Segment]) -> tuple[Tree, Tree]:
    """A tree with these markers and then the segments' centres of mass, and the same without the latter."""
    centres = tuple(Marker.at(f"centre of mass of {s.name}", s.name, s.com) for s in segments)
    whole = compile_model(model.with_markers((*(model.marker(name) for name in markers), *centres)))
    count = len(markers)
    alone = replace(
        whole,
        marker_link=whole.marker_link[:count],
        marker_local=whole.marker_local[:count],
        marker_terms=tuple(t for t in whole.marker_terms if t.marker < count),
    )
    return whole, alone


@dataclass(frozen=True, eq=False)
class PointBody:
    """A body model as vectors that move."""

    tree: Tree  # with all segments that have mass, and the markers that are compared with the measured ones
    links: NDArray[np.intp]  # (n_massive,): its segments with mass
    p: Array  # (n_parameters,)
    masses: Array  # (n_massive,), kg
    # (n_massive, 4, 3), kg^0.5 m: of each segment with mass, in its axes: the root of its mass times its
    # centre of mass, and the three vectors along the principal axes
    vectors: Array
    signs: Array  # (n_massive, 4): -1 for a vector of a negative second moment, as impossible tensors have

    @classmethod
    def of(cls, model: BodyModel, markers: tuple[str, ...]) -> PointBody:
        """A model with mass, and the markers to compare in this order."""
        heavy = [s for s in model.segments if s.mass]
        whole, tree = trees_of(model, markers, heavy)
        vectors, signs = np.empty((len(heavy), 4, 3)), np.ones((len(heavy), 4))
        for row, segment in enumerate(heavy):
            tensor = tensor_of(segment.inertia)
            moments, axes = np.linalg.eigh(0.5 * np.trace(tensor) * np.eye(3) - tensor)
            vectors[row, 0] = np.sqrt(segment.mass) * np.array(segment.com)
            vectors[row, 1:] = (axes * np.sqrt(np.abs(moments))).T
            signs[row, 1:][moments < 0] = -1.0
        masses = np.array([s.mass for s in heavy])
        links = whole.marker_link[len(markers) :]
        return cls(tree, links, parameter_values(model), masses, vectors, signs)

    @cached_property
    def nodes(self) -> NDArray[np.intp]:
        """The node of the tree's plan that is each massive segment's frame."""
        return self.tree.plan.link_node[self.links]

    def poses(self, q: Array) -> Poses:
        """Where all segments are, of coordinates (n_coordinates, n)."""
        return forward(self.tree, q, self.p)

    def moved(self, poses: Poses) -> Array:
        """The vectors y of a motion, shape (4 n_massive, 3, n), kg^0.5 m."""
        n = poses.frames.shape[-1]
        y = np.empty((len(self.masses), 4, 3, n))
        for row, node in enumerate(self.nodes.tolist()):
            np.matmul(self.vectors[row], poses.frames[node, :3].reshape(3, -1), out=y[row].reshape(4, -1))
            y[row, 0] += np.sqrt(self.masses[row]) * poses.frames[node, 3]
        return y.reshape(-1, 3, n)

    def wrench(self, y: Array, root: Array, step_s: float) -> Array:
        """What moves the body, without the frames of the halo, (6, n - 2 HALO), ground axes.

        Force (N) and moment (N m) about the root segment's origin (3, n), m, of vectors y one step apart.
        """
        n = y.shape[-1]
        first = np.tensordot(np.sqrt(self.masses), y[::4], axes=1)
        inner = slice(HALO, n - HALO)
        result = np.empty((6, n - 2 * HALO))
        result[:3] = second_difference(first, step_s) - self.masses.sum() * GRAVITY[:, None]
        result[3:] = self._angular_momentum_rate(y) / step_s**2
        result[3:] -= cross(first[:, inner], GRAVITY[:, None]) + cross(root[:, inner], result[:3])
        return result

    def _angular_momentum_rate(self, y: Array) -> Array:
        n = y.shape[-1]
        total = np.zeros((3, n - 2 * HALO))
        signed = y if (self.signs > 0).all() else y * self.signs.ravel()[:, None, None]
        for lag, weight in enumerate(STENCIL, start=1):
            between = lagged_moment(signed, y, lag)
            # starts at frame HALO - lag of the difference, so that both terms are slices of one array
            ahead = between[:, HALO : HALO + total.shape[1]]
            behind = between[:, HALO - lag : HALO - lag + total.shape[1]]
            total += weight * (ahead - behind)
        return total


def lagged_moment(y: Array, other: Array, lag: int) -> Array:
    """``sum y(i) x other(i + lag)`` over all vectors, shape (3, n - lag)."""
    n = y.shape[-1] - lag
    result = np.empty((3, n))
    for i, j, k in CYCLE:
        np.einsum("mn,mn->n", y[:, j, :n], other[:, k, lag:], out=result[i])
        result[i] -= np.einsum("mn,mn->n", y[:, k, :n], other[:, j, lag:])
    return result


def second_difference(x: Array, step_s: float) -> Array:
    """Second derivative along the last axis without the halo, shape (..., n - 2 HALO)."""
    n = x.shape[-1] - 2 * HALO
    result: Array = -2.0 * sum(STENCIL) * x[..., HALO : HALO + n]
    for lag, weight in enumerate(STENCIL, start=1):
        result += weight * (x[..., HALO + lag : HALO + lag + n] + x[..., HALO - lag : HALO - lag + n])
    return result / step_s**2
