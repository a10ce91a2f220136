"""What noise of the markers makes of the motion that follows them, drawn at random."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import forward, jacobian, positions

if TYPE_CHECKING:
    from scaling_service.capabilities.discovery.evidence.watched import Watched

DRAWS = 8  # chosen: 8 trials of thousands of frames tell a spread to some 5 %
_RIDGE = 1e-9  # of a frame's largest curvature, so that what it does not determine stays still


def strays(item: Watched) -> Array:
    """How far noise takes the motion from where it is, (DRAWS, n, n_coordinates), rad or m.

    White noise of each marker's own floor, to which the pose of the frame gives way as far as it does when
    it is solved for: to first order, without the limits of joints.
    """
    tree, free = item.task.tree, np.flatnonzero(item.task.free)
    poses = forward(tree, np.ascontiguousarray(item.q.T), item.task.p)
    rates = jacobian(tree, poses, positions(tree, poses), free)
    white = np.moveaxis(rates.reshape(len(free), -1, len(item.q)), -1, 0) / np.repeat(item.floor, 3)
    white = np.where(np.repeat(item.seen, 3, axis=1)[:, None], white, 0.0)
    bend = white @ white.transpose(0, 2, 1)
    size = np.einsum("nqq->nq", bend).max(axis=1)
    stream = np.random.default_rng(0)
    noise = stream.normal(size=(DRAWS, *white.shape[::2]))
    pull = white @ np.moveaxis(noise, 0, -1)
    followed = np.linalg.solve(bend + (_RIDGE * size)[:, None, None] * np.eye(len(free)), pull)
    found = np.zeros((DRAWS, *item.q.shape))
    found[:, :, free] = np.moveaxis(followed, -1, 0)
    return found
