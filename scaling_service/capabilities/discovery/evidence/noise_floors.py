"""How much of a residual the movement predicts; what it does not predict is noise, whatever its memory.

Third differences tell the noise of an instrument, not slow noise: skin that creeps, filters' ringing. Here
residuals are regressed on the coordinates, their squares, rates and accelerations, and on slow functions
of time, on every other block of time, and predicted on those between. What is predicted there is something
that a model could have: it counts against the model. The rest is the floor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import block_diag

from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.markers import MARKERS
from scaling_service.capabilities.discovery.evidence.observation import Observation
from scaling_service.capabilities.discovery.evidence.wrench import OBSERVATIONS, WRENCH
from scaling_service.capabilities.discovery.laws.candidates import Seen
from scaling_service.capabilities.discovery.observations.tracked import TrackedTrial
from scaling_service.numerics.multibody.laws import Array

_ALIKE = 1.4
"""Of the mean square: how much more the median place may have than the quieter ones so that what both have
is noise (chosen: mean squares of thirty independent numbers differ by so much)."""

_QUIETER = 0.1  # quantile of all places in all recordings (chosen: a fault shows less in one of ten)
_SLACK = 1.25
"""Of the mean square: how much noisier than those a place may be where places differ (chosen: in recordings
of some hundred frames 95 % of places stay below)."""

_BEYOND = 2.0
"""Of the distance from the quieter places to the median, in logarithms: how far beyond it a place may be
where they are alike (chosen: of places that are distributed log-normally one in two hundred is noisier)."""

_KNOT_S = 2.0  # chosen: slower than the blocks that are left out
_SHARE = (1e-3, 1e-2, 1e-1, 1.0)
"""Ridges tried, in shares of the squares of a function of unit variance."""


@dataclass(frozen=True, slots=True, eq=False)
class NoiseFloor:
    """What the movement does not predict of one observation's residuals, and what it does."""

    # trial to the mean square per frame (n_places,) that is not predicted; NaN where a place is not seen
    noise: Mapping[str, Array]
    # trial to the squares that prediction takes off, frame by frame (n, n_places)
    explained: Mapping[str, Array]


Floors = Mapping[Seen, NoiseFloor]


def measure_noise_floors(fit: Fit, moving: Sequence[str]) -> Floors:
    """Of every observation, in a fit in which everything that was found is taken into account.

    What is missing lifts what is not predicted, too, at some places and in some recordings. Memory and tails
    of an instrument's noise are the same everywhere: how much more there is than third differences tell is
    taken from the quieter places, and no place may have much more. Where there is no more, or places differ
    so much that even the quieter ones hold something of what is missing, the instrument's noise is the floor,
    if it shows. Plates may drift, whatever the cameras do.
    """
    found = {observation.name: measure_noise_floor(fit, observation, moving) for observation in OBSERVATIONS}
    own = {observation.name: _measure_instrument(fit, observation) for observation in OBSERVATIONS}
    known = found[MARKERS.name].noise
    more = np.concatenate([noise / own[MARKERS.name][trial] for trial, noise in known.items()])
    finite = more[np.isfinite(more)]
    usual, median = np.quantile(finite, (_QUIETER, 0.5)).tolist() if len(finite) else [1.0, 1.0]
    lasting = usual > 1.0 and median <= _ALIKE * usual
    shown = any(item.shows_noise for item in fit.tracked)
    most = 1.0 if shown else _SLACK * max(1.0, usual)
    if lasting:
        most = median * (median / usual) ** _BEYOND
    limits = {name: {trial: most * noise for trial, noise in by.items()} for name, by in own.items()}
    for item in fit.wrenches:
        limit = limits[WRENCH.name][item.name]
        limits[WRENCH.name][item.name] = np.maximum(limit, item.drifting_floor**2)
    return {
        name: replace(floor, noise={t: np.minimum(n, limits[name][t]) for t, n in floor.noise.items()})
        for name, floor in found.items()
    }


def _measure_instrument(fit: Fit, observation: Observation[Any]) -> dict[str, Array]:
    """Mean square per frame that third differences' noise would leave at every place of every trial."""
    found = {}
    for item in observation.items(fit):
        _, floor, seen = observation.frames(fit, item, None)
        count = seen.sum(axis=0)
        found[item.name] = np.divide(
            floor.sum(axis=0), count, out=np.full(len(count), np.nan), where=count > 0
        )
    return found


def measure_noise_floor(fit: Fit, observation: Observation[Any], moving: Sequence[str]) -> NoiseFloor:
    """Of one observation, as coordinates that move predict it."""
    residuals = observation.residuals(fit)
    predicted = _predict_residuals(residuals, moving, fit.settings.block_s) if residuals else []
    found = {
        item.name: _by_place(residual, guess, observation.per_place)
        for (item, residual), guess in zip(residuals, predicted, strict=True)
    }
    return NoiseFloor({n: noise for n, (noise, _) in found.items()}, {n: e for n, (_, e) in found.items()})


def _by_place(residual: Array, predicted: Array, width: int) -> tuple[Array, Array]:
    n = len(residual)
    known = np.isfinite(residual).reshape(n, -1, width).all(axis=2)
    square = np.nan_to_num(residual**2).reshape(n, -1, width).sum(axis=2)
    left = np.nan_to_num((residual - predicted) ** 2).reshape(n, -1, width).sum(axis=2)
    count = np.maximum(known.sum(axis=0), 1)
    mean = np.minimum(square.sum(axis=0), left.sum(axis=0)) / count
    return np.where(known.any(axis=0), mean, np.nan), square - left


def _predict_residuals(
    residuals: Sequence[tuple[TrackedTrial, Array]], moving: Sequence[str], block_s: float
) -> list[Array]:
    """Residuals of every block as those between predict them, each (n, n_numbers); NaN where not known."""
    items, values = zip(*residuals, strict=True)
    folds = np.concatenate([assign_folds(item, block_s) for item in items])
    chosen = predict_between(_evaluate_functions(items, moving), np.concatenate(values), folds)
    edges = np.cumsum([0, *(len(r) for r in values)])
    pairs = zip(values, edges[:-1], edges[1:], strict=True)
    return [np.where(np.isfinite(r), chosen[a:b], np.nan) for r, a, b in pairs]


def predict_between(x: Array, y: Array, folds: Array) -> Array:
    """Numbers (n, k) by functions (n, m): those of each fold (0 or 1) as the other one predicts them.

    Of several ridges each number takes the one that leaves least; what is not known (NaN) counts as zero.
    """
    known = np.isfinite(y)
    filled = np.where(known, y, 0.0)
    guesses = []
    for share in _SHARE:
        guess = np.zeros_like(filled)
        for side in (0, 1):
            known_side, new = folds != side, folds == side
            normal = x[known_side].T @ x[known_side] + share * known_side.sum() * np.eye(x.shape[1])
            guess[new] = x[new] @ np.linalg.solve(normal, x[known_side].T @ filled[known_side])
        guesses.append(guess)
    left = [np.where(known, (filled - g) ** 2, 0.0).sum(axis=0) for g in guesses]
    return np.asarray(
        np.take_along_axis(np.stack(guesses), np.argmin(left, axis=0)[None, None, :], axis=0)[0]
    )


def assign_folds(item: TrackedTrial, block_s: float) -> Array:
    """Every other block of time, (n,): 0 or 1."""
    fold = np.zeros(len(item.q))
    for k, rows in enumerate(item.blocks(block_s)):
        fold[rows] = k % 2
    return fold


def _evaluate_functions(items: Sequence[TrackedTrial], moving: Sequence[str]) -> Array:
    """Functions of movement and time, (n, n_functions), each of unit variance or so."""
    movement = np.concatenate([_of_movement(item, moving) for item in items])
    spread = movement.std(axis=0)
    movement = (movement - movement.mean(axis=0)) / np.where(spread > 0, spread, 1.0)
    slow = block_diag(*(_of_time(item) for item in items))
    return np.concatenate([np.ones((len(movement), 1)), movement, slow], axis=1)


def _of_movement(item: TrackedTrial, moving: Sequence[str]) -> Array:
    on = [item.task.model.coordinate_names.index(name) for name in moving]
    q, speed, pull = (values[:, on] for values in item.smooth_rates())
    return np.concatenate([q, q**2, speed, pull], axis=1)


def _of_time(item: TrackedTrial) -> Array:
    """Cubic B-splines over the trial, (n, n_splines)."""
    times = item.trial.times
    count = max(1, round(float(times[-1] - times[0]) / _KNOT_S))
    inner = np.linspace(times[0], times[-1], count + 1)
    knots = np.concatenate([[inner[0]] * 3, inner, [inner[-1]] * 3])
    return np.asarray(BSpline.design_matrix(times, knots, 3).toarray())
