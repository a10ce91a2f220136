"""Which coordinates the markers of a frame determine."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scaling_service.numerics.least_squares.masks import seen
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import Tree, forward, jacobian, positions

_NULL = 1e-7  # chosen: curvature per unit weight (1 m arm) below which a direction counts as free
_SHARE = 1e-2  # chosen: of a coordinate's direction that may be free before it counts as not determined


def determined(
    tree: Tree, measured: Array, weights: Array, q: Array, p: Array, free: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Whether each coordinate is determined in each frame, (n_frames, n_coordinates).

    Frames in which the same markers are seen are judged together, at one of them: it is what is
    seen, hardly the pose, that decides.

    ``measured`` (n_frames, n_markers, 3), m. ``weights`` (n_markers,). ``q`` (n_frames, n_coordinates).
    ``free`` (n_coordinates,): the others are known and count as determined.
    """
    shown = seen(measured)
    first, which = _distinct(shown)
    variables = np.flatnonzero(free)
    verdict = np.ones((len(first), tree.n_coordinates), dtype=bool)
    verdict[:, variables] = _judge(tree, shown[first], weights, q[first], p, variables)
    result: NDArray[np.bool_] = verdict[which]
    return result


def _distinct(shown: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The first frame of every pattern (n_frames, n_markers), and the pattern of every frame."""
    packed = np.packbits(shown, axis=1)  # one item per frame sorts far faster than rows do
    items = packed.view(np.dtype((np.void, packed.shape[1])))[:, 0]
    _, first, which = np.unique(items, return_index=True, return_inverse=True)
    return first, which


def _judge(
    tree: Tree, patterns: NDArray[np.bool_], weights: Array, q: Array, p: Array, variables: NDArray[np.intp]
) -> NDArray[np.bool_]:
    poses = forward(tree, np.ascontiguousarray(q.T), p)
    rates = np.moveaxis(jacobian(tree, poses, positions(tree, poses), variables), (0, 3), (3, 0))
    share = patterns * (weights > 0.0)
    rates = (rates * share[:, :, None, None]).reshape(len(q), -1, len(variables))
    curvature = np.matmul(rates.transpose(0, 2, 1), rates)
    values, vectors = np.linalg.eigh(curvature)
    loose = (vectors**2 * (values < _NULL)[:, None, :]).sum(axis=2)
    verdict: NDArray[np.bool_] = loose <= _SHARE
    return verdict
