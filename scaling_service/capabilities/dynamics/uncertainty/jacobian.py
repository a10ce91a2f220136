"""How the net wrench of a motion changes with the coordinates of its own and of the neighbouring frames.

The wrench of frame i is a function of the coordinates of frames i - HALO … i + HALO (see
``uncertainty_points``). Its derivatives follow from those of the vectors ``y`` that stand for the body.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.dynamics.uncertainty.points import (
    HALO,
    STENCIL,
    PointBody,
    second_difference,
)
from scaling_service.capabilities.dynamics.uncertainty.reference import Reference
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import CYCLE, Poses, cross, rates_of
from scaling_service.numerics.wrench.ground_wrench import GRAVITY

LAGS = tuple(range(-HALO, HALO + 1))
"""Frames that a wrench depends on, relative to its own."""

_BLOCK = 120  # frames together: 35 coordinates times 192 components are 7 MB


@dataclass(frozen=True, slots=True, eq=False)
class WrenchJacobian:
    """Derivatives of the residual wrench about the root segment's origin for a block of frames.

    Parameters
    ----------
    rows : ndarray of int, shape (n,)
        Frames, all of them used.
    by_lag : ndarray, shape (len(LAGS), n_varied, 6, n), N and N m per rad and m
        With respect to the varied coordinates at frames ``rows + lag``.
    poses : Poses
        Of these frames with their halo on both sides.
    kept : ndarray of int, shape (n,)
        Where these frames stand in ``poses``.
    """

    rows: NDArray[np.intp]
    by_lag: Array
    poses: Poses
    kept: NDArray[np.intp]


def wrench_jacobians(reference: Reference, *, every: int = 1) -> Iterator[WrenchJacobian]:
    """Derivatives of the wrench of every frame used, or of every tenth and so on, in blocks."""
    for start, stop in reference.spans:
        for at in range(start, stop - 2 * HALO, _BLOCK):
            whole = slice(at, min(at + _BLOCK + 2 * HALO, stop))
            rows = np.arange(whole.start + HALO, whole.stop - HALO)
            kept = reference.used[rows] & (rows % every == 0)
            if kept.any():
                poses = reference.body.poses(np.ascontiguousarray(reference.q[:, whole]))
                by_lag = _by_lag(reference, poses, reference.external[:3, whole])
                yield WrenchJacobian(rows[kept], by_lag[..., kept], poses, HALO + np.flatnonzero(kept))


def _by_lag(reference: Reference, poses: Poses, external: Array) -> Array:
    """All derivatives, (len(LAGS), n_varied, 6, n); ``external`` is the loads' force, (3, n + 2 HALO)."""
    body, step = reference.body, reference.step_s
    y, moved = body.moved(poses), vector_jacobian(body, poses, reference.varied)
    n = y.shape[-1] - 2 * HALO
    inner = slice(HALO, HALO + n)
    signed = y * body.signs.ravel()[:, None, None]
    roots = np.sqrt(body.masses)
    result = np.empty((len(LAGS), len(reference.varied), 6, n))
    weights = [*STENCIL[::-1], -2.0 * sum(STENCIL), *STENCIL]
    for k, (lag, weight) in enumerate(zip(LAGS, weights, strict=True)):
        there = moved[..., HALO + lag : HALO + lag + n]
        scaled = weight / step**2
        result[k, :, :3] = scaled * np.einsum("m,vman->van", roots, there[:, ::4])
        result[k, :, 3:] = scaled * _summed_cross(signed[..., inner], there)
    here = moved[..., inner]
    own = result[HALO]
    own[:, 3:] -= _summed_cross(second_difference(signed, step), here)
    own[:, 3:] -= cross(np.einsum("m,vman->van", roots, here[:, ::4]), GRAVITY[:, None])
    # about the moving root, needed and provided alike: M - root x F
    root, carried = _root(body, poses, reference.varied)
    force = second_difference(np.tensordot(roots, y[::4], axes=1), step) - roots @ roots * GRAVITY[:, None]
    result[:, :, 3:] -= cross(root[:, inner], result[:, :, :3])
    own[:, 3:] -= cross(carried[..., inner], force - external[:, inner])
    return result


def _summed_cross(y: Array, other: Array) -> Array:
    """``sum_m y_m x other_m``, (m, 3, n) with (v, m, 3, n) to (v, 3, n)."""
    result = np.empty((len(other), 3, y.shape[-1]))
    for i, j, k in CYCLE:
        result[:, i] = np.einsum("mn,vmn->vn", y[:, j], other[:, :, k])
        result[:, i] -= np.einsum("mn,vmn->vn", y[:, k], other[:, :, j])
    return result


def vector_jacobian(body: PointBody, poses: Poses, varied: NDArray[np.intp]) -> Array:
    """Derivatives of the vectors y with respect to coordinates, shape (n_varied, 4 n_massive, 3, n)."""
    y = body.moved(poses)
    pull = np.zeros((len(body.masses), 4))
    pull[:, 0] = np.sqrt(body.masses)  # the first vector is a place, the others are directions
    return _moved_by(body, poses, varied, y, pull.ravel(), np.repeat(body.links, 4))


def _root(body: PointBody, poses: Poses, varied: NDArray[np.intp]) -> tuple[Array, Array]:
    """The root's origin (3, n) and its derivatives (n_varied, 3, n)."""
    root = poses.frames[poses.plan.link_node[0], 3]
    moved = _moved_by(body, poses, varied, root[None], np.ones(1), np.zeros(1, dtype=np.intp))
    return root, moved[:, 0]


def _moved_by(
    body: PointBody, poses: Poses, varied: NDArray[np.intp], y: Array, pull: Array, links: NDArray[np.intp]
) -> Array:
    """Derivatives of vectors y = pull * place + direction that sit on links, (n_varied, len(y), 3, n)."""
    tree = body.tree
    row = {int(v): k for k, v in enumerate(varied)}
    below = _below(body)
    result = np.zeros((len(varied), *y.shape))
    entries = tree.plan.entries
    for entry, axis in zip(entries, poses.directions(entries), strict=True):
        rows = np.flatnonzero(below[entry.link][links])
        wanted = [(row[v], rate) for v, rate in rates_of(tree, poses.values, entry.term) if v in row]
        if not wanted or not len(rows):
            continue
        if entry.is_turn:
            lever = y[rows] - pull[rows, None, None] * poses.frames[entry.node, 3]
            turned = cross(axis, lever)
        else:
            turned = pull[rows, None, None] * axis
        for k, rate in wanted:
            result[k, rows] += turned * rate
    return result


def _below(body: PointBody) -> NDArray[np.bool_]:
    """Which links hang on a link or are it, shape (n_links, n_links)."""
    links = body.tree.links
    found = np.eye(len(links), dtype=bool)
    for k, link in enumerate(links):  # parents come first
        if link.parent >= 0:
            found[:, k] |= found[:, link.parent]
    return found
