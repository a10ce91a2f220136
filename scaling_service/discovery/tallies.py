"""Squares of residuals and of their floors, place by place and stretch by stretch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scaling_service.discovery.evidence import span, stretches_of
from scaling_service.discovery.fitting import Account
from scaling_service.discovery.watched import Role, Watched
from scaling_service.discovery.weighed import COMPONENTS, Weighed
from scaling_service.kernels.laws import Array
from scaling_service.kernels.tree import forward, jacobian, positions

_BLOCK = 128
_LEAST_LEFT = (
    1e-3  # of a marker's noise that its pose always leaves (chosen: so that nothing is divided by zero)
)


@dataclass(frozen=True, slots=True, eq=False)
class Tally:
    """Places against stretches of one kind of observable.

    Parameters
    ----------
    places : tuple of str
    square : ndarray, shape (n_stretches, n_places)
        Sum over frames of the squared residual (m2, N2 or N2 m2).
    floor : ndarray, shape (n_stretches, n_places)
        What noise alone would leave of it.
    frames : ndarray, shape (n_stretches, n_places)
    trials : tuple of str, length n_stretches
    starts : tuple of float, length n_stretches
        When each begins, s.
    """

    places: tuple[str, ...]
    square: Array
    floor: Array
    frames: Array
    trials: tuple[str, ...]
    starts: tuple[float, ...]


def marker_tally(account: Account, role: Role | None, stretch_s: float) -> Tally | None:
    """Of all markers, by distance."""
    items = [item for item in account.watched if role is None or item.role == role]
    names = tuple(dict.fromkeys(m for item in items for m in item.markers))
    rows, trials, starts = [], [], []
    for item in items:
        at = [names.index(m) for m in item.markers]
        square = np.nan_to_num(np.square(item.residuals).sum(axis=2))
        noise = np.where(item.seen, _left(item) * item.floor**2, 0.0)
        for part in stretches_of(item, stretch_s):
            row = np.zeros((3, len(names)))
            row[:, at] = square[part].sum(axis=0), noise[part].sum(axis=0), item.seen[part].sum(axis=0)
            rows.append(row)
            trials.append(item.name)
            starts.append(float(item.trial.times[part.start]))
    return _tally(names, rows, trials, starts)


def wrench_tally(account: Account, role: Role | None, stretch_s: float) -> Tally | None:
    """Of the six components of the ground wrench."""
    rows, trials, starts = [], [], []
    for item in account.weighed:
        if role is None or item.role == role:
            for part in stretches_of(item.item, stretch_s):
                rows.append(_wrench_row(item, part))
                trials.append(item.name)
                starts.append(float(item.times[part.start]))
    return _tally(COMPONENTS, rows, trials, starts)


def _wrench_row(item: Weighed, part: slice) -> Array:
    used = item.usable[part]
    square = np.square(item.gap[part][used]).sum(axis=0)
    count = float(used.sum())
    return np.array([square, count * item.floor**2, np.full(len(COMPONENTS), count)])


def _tally(
    places: tuple[str, ...], rows: list[Array], trials: list[str], starts: list[float]
) -> Tally | None:
    kept = [k for k, row in enumerate(rows) if row[2].any()]
    if not kept:
        return None
    table = np.array([rows[k] for k in kept])
    chosen = tuple(trials[k] for k in kept), tuple(starts[k] for k in kept)
    return Tally(places, table[:, 0], table[:, 1], table[:, 2], *chosen)


def _left(item: Watched) -> Array:
    """How many of a marker's three numbers the pose leaves free, (n, n_markers)."""
    tree, free = item.task.tree, np.flatnonzero(item.task.free)
    left = np.empty((len(item.q), len(item.markers)))
    for start in range(0, len(item.q), _BLOCK):
        rows = slice(start, min(start + _BLOCK, len(item.q)))
        poses = forward(tree, np.ascontiguousarray(item.q[rows].T), item.task.p)
        rates = jacobian(tree, poses, positions(tree, poses), free)
        n = rates.shape[-1]
        white = np.moveaxis(rates.reshape(len(free), -1, n), -1, 0).transpose(0, 2, 1)
        shown = np.repeat(item.seen[rows], 3, axis=1) / np.repeat(item.floor, 3)
        basis = span(np.ascontiguousarray(white * shown[:, :, None]))
        taken = np.square(basis).sum(axis=2).reshape(n, -1, 3).sum(axis=2)
        left[rows] = np.maximum(3.0 - taken, _LEAST_LEFT)
    return left
