"""Squares of residuals and of their floors, place by place and stretch by stretch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.evidence.predictable import (
    Predicted,
    marker_names,
    marker_predictions,
    wrench_predictions,
)
from scaling_service.capabilities.discovery.evidence.score import stretches_of
from scaling_service.capabilities.discovery.evidence.watched import Role, Watched
from scaling_service.capabilities.discovery.evidence.weighed import COMPONENTS, Weighed
from scaling_service.capabilities.discovery.laws.generators import span
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import forward, jacobian, positions

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


@dataclass(frozen=True, slots=True, eq=False)
class Floors:
    """What the movement does not predict of the residuals of an account, and what it does.

    Parameters
    ----------
    markers, wrenches : mapping
        Trial to the mean square per frame (n_places,) that is not predicted; NaN where a place is not seen.
    explained_markers, explained_wrenches : mapping
        Trial to the squares that prediction takes off, frame by frame (n, n_places).
    """

    markers: Mapping[str, Array]
    wrenches: Mapping[str, Array]
    explained_markers: Mapping[str, Array]
    explained_wrenches: Mapping[str, Array]


def floors_of(account: Account, moving: Sequence[str], stretch_s: float) -> Floors:
    """Of the account in which everything that was found is taken into account."""
    by_marker = {name: _by_place(p, 3) for name, p in marker_predictions(account, moving, stretch_s).items()}
    by_component = {
        name: _by_place(p, 1) for name, p in wrench_predictions(account, moving, stretch_s).items()
    }
    return Floors(
        {name: found[0] for name, found in by_marker.items()},
        {name: found[0] for name, found in by_component.items()},
        {name: found[1] for name, found in by_marker.items()},
        {name: found[1] for name, found in by_component.items()},
    )


def _by_place(found: Predicted, width: int) -> tuple[Array, Array]:
    n = len(found.residual)
    known = np.isfinite(found.residual).reshape(n, -1, width).all(axis=2)
    square = np.nan_to_num(found.residual**2).reshape(n, -1, width).sum(axis=2)
    left = np.nan_to_num((found.residual - found.predicted) ** 2).reshape(n, -1, width).sum(axis=2)
    count = np.maximum(known.sum(axis=0), 1)
    mean = np.minimum(square.sum(axis=0), left.sum(axis=0)) / count
    return np.where(known.any(axis=0), mean, np.nan), square - left


def marker_tally(
    account: Account, role: Role | None, stretch_s: float, floors: Floors | None = None
) -> Tally | None:
    """Of all markers, by distance.

    Parameters
    ----------
    floors : Floors, optional
        Noise with memory; that of the instrument alone without.
    """
    items = [item for item in account.watched if role is None or item.role == role]
    names = marker_names(account)
    rows, trials, starts = [], [], []
    for item in items:
        at = [names.index(m) for m in item.markers]
        square = np.nan_to_num(np.square(item.residuals).sum(axis=2))
        slow = np.zeros(len(at)) if floors is None else np.nan_to_num(floors.markers[item.name][at])
        noise = np.where(item.seen, np.maximum(_left(item) * item.floor**2, slow), 0.0)
        for part in stretches_of(item, stretch_s):
            row = np.zeros((3, len(names)))
            row[:, at] = square[part].sum(axis=0), noise[part].sum(axis=0), item.seen[part].sum(axis=0)
            rows.append(row)
            trials.append(item.name)
            starts.append(float(item.trial.times[part.start]))
    return _tally(names, rows, trials, starts)


def wrench_tally(
    account: Account, role: Role | None, stretch_s: float, floors: Floors | None = None
) -> Tally | None:
    """Of the six components of the ground wrench."""
    rows, trials, starts = [], [], []
    for item in account.weighed:
        if role is None or item.role == role:
            for part in stretches_of(item.item, stretch_s):
                slow = np.zeros(6) if floors is None else np.nan_to_num(floors.wrenches[item.name])
                rows.append(_wrench_row(item, part, slow))
                trials.append(item.name)
                starts.append(float(item.times[part.start]))
    return _tally(COMPONENTS, rows, trials, starts)


def _wrench_row(item: Weighed, part: slice, slow: Array) -> Array:
    used = item.usable[part]
    square = np.square(item.gap[part][used]).sum(axis=0)
    count = float(used.sum())
    return np.array([square, count * np.maximum(item.floor**2, slow), np.full(len(COMPONENTS), count)])


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
