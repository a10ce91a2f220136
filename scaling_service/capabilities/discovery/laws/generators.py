"""How the markers of every frame move with the pose and with whatever else may move them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.laws.spots import BentSpot, Spot, VolumeSpot, with_parameters
from scaling_service.capabilities.discovery.observations.tracked import TrackedTrial
from scaling_service.model.compile import compile_model, parameter_values
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import Tree, forward, jacobian, positions

_NULL = 1e-9  # of a column's own curvature, so that a frame may leave a direction of its pose open


@dataclass(frozen=True, slots=True, eq=False)
class Generators:
    """The derivative of all markers with respect to every spot."""

    tree: Tree
    p: Array
    variables: NDArray[np.intp]
    volumes: tuple[tuple[int, VolumeSpot | BentSpot], ...]

    @classmethod
    def of(cls, item: TrackedTrial, spots: Sequence[Spot]) -> Generators:
        """For a recording as it is followed."""
        opened, names = with_parameters(item.task.model, spots)
        tree = compile_model(opened, item.markers)
        number = {p.name: k for k, p in enumerate(opened.parameters)}
        free = np.flatnonzero(item.task.free)
        chosen = [tree.n_coordinates + number[name] for name in names if name]
        volumes = tuple((k, spot) for k, spot in enumerate(spots) if isinstance(spot, VolumeSpot | BentSpot))
        return cls(
            tree,
            parameter_values(opened),
            np.concatenate([free, np.array(chosen, dtype=np.intp)]),
            volumes,
        )

    def at(self, item: TrackedTrial, rows: slice) -> tuple[Array, Array, Array]:
        """Residuals (n, r), the pose's columns (n, r, n_free) and the spots' (n, r, n_spots), by floors."""
        poses = forward(self.tree, np.ascontiguousarray(item.q[rows].T), self.p)
        placed = positions(self.tree, poses)
        rates = jacobian(self.tree, poses, placed, self.variables)
        for k, spot in self.volumes:
            rates = np.insert(rates, int(item.task.free.sum()) + k, spot.field(placed), axis=0)
        n = placed.shape[-1]
        measured = item.task.measured[rows]
        scale = np.repeat(1.0 / item.floor, 3)
        shown = np.isfinite(measured).reshape(n, -1)
        gap = np.where(shown, (measured - np.moveaxis(placed, -1, 0)).reshape(n, -1), 0.0) * scale
        white = np.ascontiguousarray(np.moveaxis(rates.reshape(len(rates), -1, n), -1, 0).transpose(0, 2, 1))
        white *= (shown * scale)[:, :, None]
        count = int(item.task.free.sum())
        return gap, white[:, :, :count], white[:, :, count:]


def span(pose: Array) -> Array:
    """A basis of the columns of every frame, (n, r, q), orthonormal but for directions without meaning.

    Those come out short, as far as rounding leaves anything of them.
    """
    size = np.sqrt(np.einsum("nrq,nrq->nq", pose, pose))
    even = np.divide(pose, size[:, None], out=np.zeros_like(pose), where=size[:, None] > 0)
    bend = even.transpose(0, 2, 1) @ even
    bend += _NULL * np.eye(pose.shape[2])
    basis = np.linalg.solve(np.linalg.cholesky(bend), even.transpose(0, 2, 1))
    return np.asarray(basis.transpose(0, 2, 1))
