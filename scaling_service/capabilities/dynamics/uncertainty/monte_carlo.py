"""The kinematic part of a residual's uncertainty by Monte Carlo (Muller et al. 2017, sec. 2.2)."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np

from scaling_service.capabilities.dynamics.uncertainty.reference import Reference
from scaling_service.capabilities.dynamics.uncertainty.tasks import in_chunks
from scaling_service.core.errors import InputError
from scaling_service.core.streams import stream
from scaling_service.numerics.multibody.laws import Array

UNIFORM_RANGE = np.sqrt(12.0)
"""Range of a uniform distribution over its standard deviation (Muller et al. 2017, eq. 10)."""

BEYOND = 0.1
"""Reference errors that the database reaches beyond the largest level (chosen; the paper: "arbitrarily")."""

EXACT_M = 1e-6
"""Reconstruction error below which markers are followed exactly (chosen: far below any camera's noise)."""

_LEVER_M = 0.1
"""How far markers move per radian of noise, about (chosen: the filter lets a third of it through, and markers
sit some 0.3 m from their joints); only where the search for the largest perturbation begins."""

_PILOTS = 3  # motions that the largest perturbation is found with; their errors differ by few per cent


@dataclass(frozen=True, slots=True, eq=False)
class MotionDatabase:
    """Perturbed motions, reduced to what is asked of them.

    Parameters
    ----------
    error_m : float
        Reconstruction error of the reference motion (filtered).
    dr : ndarray, shape (6,)
        Its residual indicator.
    largest : float
        Upper end of the perturbations' standard deviation, rad and m.
    sizes : ndarray, shape (n,), rad and m
        Standard deviation of each perturbation before the filter.
    errors_m : ndarray, shape (n,)
    indicators : ndarray, shape (n, 6)
    """

    error_m: float
    dr: Array
    largest: float
    sizes: Array
    errors_m: Array
    indicators: Array


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """Motions whose reconstruction error is uniform between the reference's and this much more.

    Parameters
    ----------
    relative : float
        The largest added error over the reference's.
    added_m : float
        The same in m.
    dispersion : ndarray, shape (6,)
        Of the residual indicator: ``sqrt(12)`` standard deviations.
    distinct : int
        How many different motions were drawn.
    misfit_m : float
        The largest distance between an error asked for and the one drawn.
    """

    relative: float
    added_m: float
    dispersion: Array
    distinct: int
    misfit_m: float


def draw_database(
    reference: Reference,
    count: int,
    seed: int,
    reach: float,
    executor: Executor,
    progress: Callable[[float], None] | None = None,
) -> MotionDatabase:
    """Perturb the reference motion and compute each motion's error and residual.

    Parameters
    ----------
    reference : Reference
    count : int
    seed : int
    reach : float
        Reconstruction error that must be covered, over the reference's.
    executor : Executor
    progress : callable, optional

    Raises
    ------
    InputError
        The reference follows its markers exactly.
    """
    error, residual = reference.residual(reference.q)
    if error < EXACT_M:
        raise InputError(
            "the model follows its markers without error, so nothing tells how uncertain the motion is",
            file=reference.trial,
            field="markers",
            remedy="Give the measured markers with the motion",
        )
    largest = _largest(reference, seed, error, reach + BEYOND)
    sample = partial(_samples, reference, seed, largest)
    rows = in_chunks(executor, sample, count, progress)
    return MotionDatabase(error, reference.indicator(residual), largest, rows[:, 0], rows[:, 1], rows[:, 2:])


def _samples(reference: Reference, seed: int, largest: float, numbers: range) -> Array:
    return np.array([_sample(reference, seed, largest, number) for number in numbers])


def _sample(reference: Reference, seed: int, largest: float, number: int) -> Array:
    """Size, error and indicator of one perturbed motion, shape (8,)."""
    rng = stream(seed, "uncertainty", reference.trial, "motion", number)
    size = largest * rng.random()
    noise = rng.standard_normal((len(reference.varied), reference.n_frames))
    error, residual = reference.residual(reference.perturbed(noise, size))
    return np.concatenate([[size, error], reference.indicator(residual)])


def _largest(reference: Reference, seed: int, error: float, reach: float) -> float:
    """The size of perturbations whose error is ``reach`` times the reference's, in the mean of few motions.

    The squared error grows about as the squared size; two steps settle it.
    """
    shape = (len(reference.varied), reference.n_frames)
    size = error / _LEVER_M
    for _ in range(2):
        reached = []
        for number in range(_PILOTS):
            noise = stream(seed, "uncertainty", reference.trial, "pilot", number).standard_normal(shape)
            reached.append(reference.residual(reference.perturbed(noise, size))[0])
        size *= float(np.sqrt((reach**2 - 1.0) / ((np.mean(reached) / error) ** 2 - 1.0)))
    return size


def levels_of(
    database: MotionDatabase, levels: tuple[float, ...], samples: int, seed: int
) -> tuple[Level, ...]:
    """Draw each level's motions from the database, with replacement."""
    return tuple(_level(database, relative, samples, seed) for relative in levels)


def _level(database: MotionDatabase, relative: float, samples: int, seed: int) -> Level:
    added = relative * database.error_m
    wanted = database.error_m + added * stream(seed, "uncertainty", "level", str(relative)).random(samples)
    order = np.argsort(database.errors_m, kind="stable")
    drawn = order[_nearest(database.errors_m[order], wanted)]
    spread = database.indicators[drawn].std(axis=0, ddof=1)
    return Level(
        relative,
        added,
        UNIFORM_RANGE * spread,
        len(np.unique(drawn)),
        float(np.abs(database.errors_m[drawn] - wanted).max()),
    )


def _nearest(ascending: Array, wanted: Array) -> Array:
    """The place of the nearest value for each that is wanted."""
    after = np.clip(np.searchsorted(ascending, wanted), 1, len(ascending) - 1)
    before = after - 1
    nearer = wanted - ascending[before] < ascending[after] - wanted
    places: Array = np.where(nearer, before, after)
    return places


def slopes_through_zero(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Least-squares lines without intercept, and how well they fit.

    Parameters
    ----------
    x : ndarray, shape (n,)
    y : ndarray, shape (n, k)

    Returns
    -------
    slopes, r2, r2_centred : ndarray, shape (k,)
        ``1 - SSE / sum y^2`` (right without intercept: Eisenhauer 2003, Teach Stat 25:76-80), and
        ``1 - SSE / sum (y - mean)^2``, which is never larger.

    Examples
    --------
    >>> import numpy as np
    >>> [values.tolist() for values in slopes_through_zero(np.array([1.0, 2.0]), np.array([[2.0], [4.0]]))]
    [[2.0], [1.0], [1.0]]
    """
    slopes = x @ y / (x @ x)
    left = ((y - np.outer(x, slopes)) ** 2).sum(axis=0)
    centred = 1.0 - left / ((y - y.mean(axis=0)) ** 2).sum(axis=0)
    return slopes, 1.0 - left / (y**2).sum(axis=0), centred
