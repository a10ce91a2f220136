"""A body as points: its net wrench from positions alone, for many perturbed motions.

It shares nothing with Newton and Euler's equations but the poses, so that each is tested against the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.dynamics.uncertainty import reference as references
from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import list_parameter_values
from scaling_service.model.inertia import to_matrix
from scaling_service.numerics import wrench as wrenches
from scaling_service.numerics.multibody import tree as trees

BLOCK = 1016
"""Frames computed together; with the halo 1024 (chosen: the fastest measured, 3.2 µs a frame against 3.9
at 256; a block takes 15 MB)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PointBody:
    """A body model as vectors that move: its net wrench from positions alone, for many perturbed motions.

    A rigid segment moves as its mass at the centre of mass and three vectors fixed in it, along the principal
    axes of its second moments of mass, as long as the roots of these moments. With ``y`` all these vectors
    (the first times the root of the mass), the momentum balance about the ground origin is

        F = sum m (c'' - g),    M = sum y x y'' - sum m c x g.

    ``y''`` is a central difference ``sum_l w_l (y(i+l) + y(i-l))`` of high order, ``y x y`` is zero, so that

        sum y x y'' = sum_l w_l [G_l(i) - G_l(i-l)],    G_l(i) = sum y(i) x y(i+l):

    the rate of an angular momentum taken between frames. Frames come last, as in the kernels.
    """

    tree: (
        trees.Tree
    )  # with all segments that have mass, and the markers that are compared with the measured ones
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
        whole, tree = references.make_trees(model, markers, heavy)
        vectors, signs = np.empty((len(heavy), 4, 3)), np.ones((len(heavy), 4))
        for row, segment in enumerate(heavy):
            tensor = to_matrix(segment.inertia)
            moments, axes = np.linalg.eigh(0.5 * np.trace(tensor) * np.eye(3) - tensor)
            vectors[row, 0] = np.sqrt(segment.mass) * np.array(segment.com)
            vectors[row, 1:] = (axes * np.sqrt(np.abs(moments))).T
            signs[row, 1:][moments < 0] = -1.0
        masses = np.array([s.mass for s in heavy])
        links = whole.marker_link[len(markers) :]
        return cls(
            tree=tree,
            links=links,
            p=list_parameter_values(model),
            masses=masses,
            vectors=vectors,
            signs=signs,
        )

    @cached_property
    def nodes(self) -> NDArray[np.intp]:
        """The node of the tree's plan that is each massive segment's frame."""
        return self.tree.plan.link_node[self.links]

    def poses(self, q: Array) -> trees.Poses:
        """Where all segments are, of coordinates (n_coordinates, n)."""
        return trees.pose_links(self.tree, q, self.p)

    def move(self, poses: trees.Poses) -> Array:
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
        inner = slice(references.HALO, n - references.HALO)
        result = np.empty((6, n - 2 * references.HALO))
        result[:3] = (
            references.difference_twice(first, step_s) - self.masses.sum() * wrenches.GRAVITY[:, None]
        )
        length = y.shape[-1]
        total = np.zeros((3, length - 2 * references.HALO))
        signed = y if (self.signs > 0).all() else y * self.signs.ravel()[:, None, None]
        for lag, weight in enumerate(references.STENCIL, start=1):
            between = sum_lagged_products(signed, y, lag)
            # starts at frame HALO - lag of the difference, so that both terms are slices of one array
            ahead = between[:, references.HALO : references.HALO + total.shape[1]]
            behind = between[:, references.HALO - lag : references.HALO - lag + total.shape[1]]
            total += weight * (ahead - behind)
        result[3:] = total / step_s**2
        result[3:] -= trees.cross(first[:, inner], wrenches.GRAVITY[:, None]) + trees.cross(
            root[:, inner], result[:3]
        )
        return result


def sum_lagged_products(y: Array, other: Array, lag: int) -> Array:
    """``sum y(i) x other(i + lag)`` over all vectors, shape (3, n - lag)."""
    n = y.shape[-1] - lag
    result = np.empty((3, n))
    for i, j, k in trees.CYCLE:
        np.einsum("mn,mn->n", y[:, j, :n], other[:, k, lag:], out=result[i])
        result[i] -= np.einsum("mn,mn->n", y[:, k, :n], other[:, j, lag:])
    return result


def compute_residual(body: PointBody, reference: references.Reference, q: Array) -> tuple[float, Array]:
    """What a filtered motion leaves unexplained, as ``Reference.residual`` has it."""
    far, total = 0.0, 0.0
    residual = np.zeros((6, reference.n_frames))
    blocks = (
        slice(at, min(at + BLOCK + 2 * references.HALO, stop))
        for start, stop in reference.spans
        for at in range(start, stop - 2 * references.HALO, BLOCK)
    )
    for rows in blocks:
        inner = slice(rows.start + references.HALO, rows.stop - references.HALO)
        poses = body.poses(np.ascontiguousarray(q[:, rows]))
        root = poses.frames[poses.plan.link_node[0], 3]
        needed = body.wrench(body.move(poses), root, reference.step_s)
        residual[:, inner] = needed - wrenches.move_moment(
            reference.external[:, inner], root[:, references.HALO : -references.HALO]
        )
        away = (
            trees.place_tree_markers(body.tree, poses)[:, :, references.HALO : -references.HALO]
            - reference.measured[:, :, inner]
        )
        seen = reference.seen[:, inner]
        far += float(np.vdot(np.sqrt(np.einsum("man,man->mn", away, away)), seen))
        total += float(seen.sum())
    return far / total, residual
