"""How much of a residual the movement predicts; what it does not predict is noise, whatever its memory.

Third differences tell the noise of an instrument, not slow noise: skin that creeps, filters' ringing. Here
residuals are regressed on the coordinates, their squares, rates and accelerations, and on slow functions
of time, on every other stretch of time, and predicted on those between. What is predicted there is something
that a model could have: it counts against the model. The rest is the floor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.evidence.score import stretches_of
from scaling_service.capabilities.discovery.evidence.watched import Watched
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.signals.filters import butterworth

_CUTOFF_HZ = 6.0  # chosen: holds human movement (Winter 2009, sec. 3.4.3)
_KNOT_S = 2.0  # chosen: slower than the stretches that are left out
_SHARE = (1e-3, 1e-2, 1e-1, 1.0)
"""Ridges tried, in shares of the squares of a function of unit variance."""


@dataclass(frozen=True, slots=True, eq=False)
class Predicted:
    """Residuals of one trial and what the rest of the recordings predicts of them.

    Parameters
    ----------
    residual, predicted : ndarray, shape (n, n_numbers)
        NaN where not known.
    """

    residual: Array
    predicted: Array


def predicted(
    items: Sequence[Watched], residuals: Sequence[Array], moving: Sequence[str], stretch_s: float
) -> list[Predicted]:
    """Predict residuals of every stretch from those between.

    Parameters
    ----------
    residuals : sequence of ndarray, shape (n, n_numbers)
        One for each trial, the same numbers in all; NaN where not known.
    moving : sequence of str
        Coordinates that move.
    """
    x, fold = _functions(items, moving), [_folds(item, stretch_s) for item in items]
    y, folds = np.concatenate(residuals), np.concatenate(fold)
    known = np.isfinite(y)
    filled = np.where(known, y, 0.0)
    guesses = []
    for share in _SHARE:
        guess = np.zeros_like(filled)
        for side in (0, 1):
            fit, new = folds != side, folds == side
            normal = x[fit].T @ x[fit] + share * fit.sum() * np.eye(x.shape[1])
            guess[new] = x[new] @ np.linalg.solve(normal, x[fit].T @ filled[fit])
        guesses.append(guess)
    left = [np.where(known, (filled - g) ** 2, 0.0).sum(axis=0) for g in guesses]
    best = np.argmin(left, axis=0)
    chosen = np.take_along_axis(np.stack(guesses), best[None, None, :], axis=0)[0]
    edges = np.cumsum([0, *(len(r) for r in residuals)])
    return [
        Predicted(r, np.where(np.isfinite(r), chosen[a:b], np.nan))
        for r, a, b in zip(residuals, edges[:-1], edges[1:], strict=True)
    ]


def _folds(item: Watched, stretch_s: float) -> Array:
    fold = np.zeros(len(item.q))
    for k, rows in enumerate(stretches_of(item, stretch_s)):
        fold[rows] = k % 2
    return fold


def _functions(items: Sequence[Watched], moving: Sequence[str]) -> Array:
    """Functions of movement and time, (n, n_functions), each of unit variance or so."""
    movement = np.concatenate([_of_movement(item, moving) for item in items])
    spread = movement.std(axis=0)
    movement = (movement - movement.mean(axis=0)) / np.where(spread > 0, spread, 1.0)
    times = [_of_time(item) for item in items]
    width = sum(t.shape[1] for t in times)
    slow, row, column = np.zeros((len(movement), width)), 0, 0
    for part in times:
        slow[row : row + len(part), column : column + part.shape[1]] = part
        row, column = row + len(part), column + part.shape[1]
    return np.concatenate([np.ones((len(movement), 1)), movement, slow], axis=1)


def _of_movement(item: Watched, moving: Sequence[str]) -> Array:
    names, times = item.task.model.coordinate_names, item.trial.times
    q = item.q[:, [names.index(c) for c in moving]]
    rate = 1.0 / float(np.median(np.diff(times)))
    smooth = butterworth(q, rate_hz=rate, cutoff_hz=min(_CUTOFF_HZ, 0.4 * rate), order=4).values
    speed = np.gradient(smooth, times, axis=0)
    pull = np.gradient(speed, times, axis=0)
    return np.concatenate([smooth, smooth**2, speed, pull], axis=1)


def _of_time(item: Watched) -> Array:
    """Cubic B-splines over the trial, (n, n_splines)."""
    times = item.trial.times
    count = max(1, round(float(times[-1] - times[0]) / _KNOT_S))
    inner = np.linspace(times[0], times[-1], count + 1)
    knots = np.concatenate([[inner[0]] * 3, inner, [inner[-1]] * 3])
    return np.asarray(BSpline.design_matrix(times, knots, 3).toarray())


def marker_predictions(account: Account, moving: Sequence[str], stretch_s: float) -> dict[str, Predicted]:
    """Of every trial, (n, 3 n_markers) over all markers of all trials in their order."""
    names = marker_names(account)
    residuals = []
    for item in account.watched:
        wide = np.full((len(item.q), len(names), 3), np.nan)
        wide[:, [names.index(m) for m in item.markers]] = item.residuals
        residuals.append(wide.reshape(len(item.q), -1))
    found = predicted(account.watched, residuals, moving, stretch_s)
    return {item.name: p for item, p in zip(account.watched, found, strict=True)}


def marker_names(account: Account) -> tuple[str, ...]:
    """All markers of all trials."""
    return tuple(dict.fromkeys(m for item in account.watched for m in item.markers))


def wrench_predictions(account: Account, moving: Sequence[str], stretch_s: float) -> dict[str, Predicted]:
    """Of every trial with forces, (n, 6)."""
    if not account.weighed:
        return {}
    residuals = [np.where(item.usable[:, None], item.gap, np.nan) for item in account.weighed]
    found = predicted([item.item for item in account.weighed], residuals, moving, stretch_s)
    return {item.name: p for item, p in zip(account.weighed, found, strict=True)}
