"""A residual's uncertainty by Monte Carlo, of the motion and of the plates (Muller et al. 2017, sec. 2.2)."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from functools import partial

import numpy as np

from scaling_service.capabilities.dynamics.uncertainty.reference import Reference
from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError
from scaling_service.core.streams import stream
from scaling_service.model.forces import CONTACT_N
from scaling_service.numerics.multibody.tree import cross, pose_links

UNIFORM_RANGE = np.sqrt(12.0)
"""Range of a uniform distribution over its standard deviation (Muller et al. 2017, eq. 10)."""

BEYOND = 0.1
"""Reference errors that the database reaches beyond the largest level (chosen; the paper: "arbitrarily")."""

EXACT_M = 1e-6
"""Reconstruction error below which markers are followed exactly (chosen: far below any camera's noise)."""

_LEVER_M = 0.1
"""How far markers move per radian of noise, about (chosen: the filter lets a third of it through, and markers
sit some 0.3 m from their joints); only where the search for the largest perturbation begins."""

SIGMAS = 3.0
"""A data sheet's figure of a plate stands for three standard deviations, and so does the dispersion that is
reported (Muller et al. 2017, sec. 2.2)."""

CHUNK = 125
"""Samples per task (chosen: some seconds of work each, so that two workers end together)."""

_PILOTS = 3  # motions that the largest perturbation is found with; their errors differ by few per cent


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MotionDatabase:
    """Perturbed motions, reduced to what is asked of them."""

    error_m: float  # reconstruction error of the reference motion (filtered)
    dr: Array  # (6,): its residual indicator
    sizes: Array  # (n,), rad and m: standard deviation of each perturbation before the filter
    errors_m: Array  # (n,)
    indicators: Array  # (n, 6)


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """Motions whose reconstruction error is uniform between the reference's and this much more."""

    added_m: float  # the largest added error
    dispersion: Array  # (6,): of the residual indicator: ``sqrt(12)`` standard deviations
    distinct: int  # how many different motions were drawn


def draw_database(
    reference: Reference,
    count: int,
    seed: int,
    reach: float,
    executor: Executor,
    progress: Callable[[float], None] | None = None,
) -> MotionDatabase:
    """Perturb the reference motion and compute each motion's error and residual.

    ``reach`` is the reconstruction error that must be covered, over the reference's.
    """
    error, dr = compute_error_and_indicator(reference)
    largest = _find_largest(reference, seed, error, reach + BEYOND)
    rows = _sample(executor, partial(_perturb, reference, seed, largest), count, progress)
    return MotionDatabase(error_m=error, dr=dr, sizes=rows[:, 0], errors_m=rows[:, 1], indicators=rows[:, 2:])


def compute_error_and_indicator(reference: Reference) -> tuple[float, Array]:
    """Of the reference motion itself, which must not follow its markers exactly."""
    error, residual = reference.residual(reference.q)
    if error < EXACT_M:
        raise InputError(
            "the model follows its markers without error, so nothing tells how uncertain the motion is",
            file=reference.trial,
            field="markers",
            remedy="Give the measured markers with the motion",
        )
    return error, reference.indicator(residual)


def _sample(
    executor: Executor,
    sample: Callable[[int], Array],
    count: int,
    progress: Callable[[float], None] | None = None,
) -> Array:
    """Rows of all samples in their order, computed in chunks, here or in worker processes (so picklable)."""
    chunks = [range(start, min(start + CHUNK, count)) for start in range(0, count, CHUNK)]
    futures = [executor.submit(_list_rows, sample, chunk) for chunk in chunks]
    for done, _ in enumerate(as_completed(futures), start=1):
        if progress is not None:
            progress(done / len(futures))
    return np.concatenate([future.result() for future in futures])


def _list_rows(sample: Callable[[int], Array], numbers: range) -> Array:
    return np.array([sample(number) for number in numbers])


def _perturb(reference: Reference, seed: int, largest: float, number: int) -> Array:
    """Size, error and indicator of one perturbed motion, shape (8,)."""
    rng = stream(seed, "uncertainty", reference.trial, "motion", number)
    size = largest * rng.random()
    noise = rng.standard_normal((len(reference.varied), reference.n_frames))
    error, residual = reference.residual(reference.perturb(noise, size))
    return np.concatenate([[size, error], reference.indicator(residual)])


def _find_largest(reference: Reference, seed: int, error: float, reach: float) -> float:
    """The size of perturbations whose error is ``reach`` times the reference's, in the mean of few motions.

    The squared error grows about as the squared size; two steps settle it.
    """
    shape = (len(reference.varied), reference.n_frames)
    size = error / _LEVER_M
    for _ in range(2):
        reached = []
        for number in range(_PILOTS):
            noise = stream(seed, "uncertainty", reference.trial, "pilot", number).standard_normal(shape)
            reached.append(reference.residual(reference.perturb(noise, size))[0])
        size *= float(np.sqrt((reach**2 - 1.0) / ((np.mean(reached) / error) ** 2 - 1.0)))
    return size


def draw_levels(
    database: MotionDatabase, levels: tuple[float, ...], samples: int, seed: int
) -> tuple[Level, ...]:
    """Draw each level's motions from the database, with replacement."""
    order = np.argsort(database.errors_m, kind="stable")
    found = []
    for relative in levels:
        added = relative * database.error_m
        shares = stream(seed, "uncertainty", "level", str(relative)).random(samples)
        wanted = database.error_m + added * shares
        # The place of the nearest value for each that is wanted.
        ascending = database.errors_m[order]
        after = np.clip(np.searchsorted(ascending, wanted), 1, len(ascending) - 1)
        before = after - 1
        nearer = wanted - ascending[before] < ascending[after] - wanted
        drawn = order[np.where(nearer, before, after)]
        spread = UNIFORM_RANGE * database.indicators[drawn].std(axis=0, ddof=1)
        found.append(Level(added, spread, len(np.unique(drawn))))
    return tuple(found)


def fit_slopes_through_zero(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Least-squares lines without intercept, and how well they fit.

    Of x (n,) and y (n, k): slopes (k,), ``r2 = 1 - SSE / sum y^2`` (right without intercept: Eisenhauer 2003,
    Teach Stat 25:76-80), and the centred ``1 - SSE / sum (y - mean)^2``, which is never larger.

    Examples
    --------
    >>> import numpy as np
    >>> fitted = fit_slopes_through_zero(np.array([1.0, 2.0]), np.array([[2.0], [4.0]]))
    >>> [values.tolist() for values in fitted]
    [[2.0], [1.0], [1.0]]
    """
    slopes = x @ y / (x @ x)
    left = ((y - np.outer(x, slopes)) ** 2).sum(axis=0)
    centred = 1.0 - left / ((y - y.mean(axis=0)) ** 2).sum(axis=0)
    return slopes, 1.0 - left / (y**2).sum(axis=0), centred


@dataclass(frozen=True, slots=True)
class PlateNoise:
    """What the data sheet of a force plate promises (AMTI, as Muller et al. 2017 quote it)."""

    share: float = 0.001  # of the load
    least_n: float = 0.22  # not less than this
    centre_m: float = 0.0002  # of the centre of pressure, in each direction
    surface_m: float = 0.0  # height of the plates' surface


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Plates:
    """Residual (6, n), and each load's force and lever from the root (k, 3, n), over the frames used.

    ``sigma`` and ``centre`` (k, 1, n) are standard deviations of the components of each force and of its
    centre of pressure, zero without contact.
    """

    residual: Array
    force: Array
    lever: Array
    sigma: Array
    centre: Array
    scale: Array


def draw_plate_dispersion(
    reference: Reference, noise: PlateNoise, samples: int, seed: int, executor: Executor
) -> Array:
    """Three standard deviations of the indicator under noise of forces and centres of pressure, (6,)."""
    used = reference.used
    _, residual = reference.residual(reference.q)
    poses = pose_links(reference.body.tree, reference.q[:, used], reference.body.p)
    root = poses.frames[poses.plan.link_node[0], 3]
    force, moment = (np.moveaxis(x[used], 0, -1) for x in (reference.loads.force, reference.loads.moment))
    pressing = force[:, 1]
    loaded = pressing > CONTACT_N
    ground = np.array([0.0, noise.surface_m, 0.0])[:, None]
    about = moment - cross(np.broadcast_to(ground, force.shape), force)
    # n x M / (n . F) with the normal n up
    flat = np.stack([about[:, 2], np.zeros_like(pressing), -about[:, 0]], axis=1)
    centre = np.divide(flat, pressing[:, None], out=np.zeros_like(flat), where=loaded[:, None]) + ground
    load = np.linalg.norm(force, axis=1)
    sigma = np.where(loaded, np.maximum(noise.share * load, noise.least_n) / SIGMAS, 0.0)[:, None]
    spread = np.where(loaded, noise.centre_m / SIGMAS, 0.0)[:, None]
    plates = _Plates(
        residual=residual[:, used],
        force=force,
        lever=centre - root,
        sigma=sigma,
        centre=spread,
        scale=reference.scale,
    )
    rows = _sample(executor, partial(_push, plates, seed, reference.trial), samples)
    return np.asarray(SIGMAS * rows.std(axis=0, ddof=1))


def _push(plates: _Plates, seed: int, trial: str, number: int) -> Array:
    """The residual indicator under one draw of noise; what the plates measure too much is missing then."""
    rng = stream(seed, "uncertainty", trial, "plates", number)
    pushed = plates.sigma * rng.standard_normal(plates.force.shape)
    shifted = plates.centre * rng.standard_normal(plates.force.shape)
    moment = cross(plates.lever + shifted, pushed) + cross(shifted, plates.force)
    residual = plates.residual - np.concatenate([pushed.sum(axis=0), moment.sum(axis=0)])
    rms: Array = np.sqrt(np.einsum("cn,cn->c", residual, residual) / residual.shape[1]) / plates.scale
    return rms
