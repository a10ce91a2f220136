"""A residual's uncertainty by Monte Carlo, of the motion and of the plates, as Muller et al. 2017 draw it.

The closed form of ``dynamics`` gives the same numbers without samples: this is the paper's way, and what the
closed form is tested against.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from scaling_service.capabilities.dynamics.uncertainty import linear
from scaling_service.capabilities.dynamics.uncertainty import plates as uncertainty_plates
from scaling_service.capabilities.dynamics.uncertainty import reference as references
from scaling_service.capabilities.dynamics.uncertainty import total as totals
from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError
from scaling_service.core.streams import stream
from scaling_service.numerics.multibody.tree import cross
from scaling_service.studies.muller2017 import points

PER_SAMPLE = 3
"""Motions in the database for each sample of a level (chosen: as noise is uniform in size, over a third of
them lie in the lowest level, so that every level draws from more motions than it draws)."""

_LEVER_M = 0.1
"""How far markers move per radian of noise, about (chosen: the filter lets a third of it through, and markers
sit some 0.3 m from their joints); only where the search for the largest perturbation begins."""

_PILOTS = 3  # motions that the largest perturbation is found with; their errors differ by few per cent


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MotionDatabase:
    """Perturbed motions, reduced to what is asked of them."""

    error_m: float  # reconstruction error of the reference motion (filtered)
    dr: Array  # (6,): its residual indicator
    sizes: Array  # (n,), rad and m: standard deviation of each perturbation before the filter
    errors_m: Array  # (n,)
    indicators: Array  # (n, 6)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Level:
    """Motions whose reconstruction error is uniform between the reference's and this much more."""

    added_m: float  # the largest added error
    dispersion: Array  # (6,): of the residual indicator: ``sqrt(12)`` standard deviations
    distinct: int  # how many different motions were drawn


def _find_largest(
    body: points.PointBody, reference: references.Reference, seed: int, error: float, reach: float
) -> float:
    """The size of perturbations whose error is ``reach`` times the reference's, in the mean of few motions.

    The squared error grows about as the squared size; two steps settle it.
    """
    shape = (len(reference.varied), reference.n_frames)
    size = error / _LEVER_M
    for _ in range(2):
        reached = []
        for number in range(_PILOTS):
            noise = stream(seed, "uncertainty", reference.trial, "pilot", number).standard_normal(shape)
            reached.append(points.compute_residual(body, reference, reference.perturb(noise, size))[0])
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
        spread = linear.UNIFORM_RANGE * database.indicators[drawn].std(axis=0, ddof=1)
        found.append(Level(added, spread, len(np.unique(drawn))))
    return tuple(found)


def _push(plates: uncertainty_plates.PressedPlates, seed: int, trial: str, number: int) -> Array:
    """The residual indicator under one draw of noise; what the plates measure too much is missing then."""
    rng = stream(seed, "uncertainty", trial, "plates", number)
    pushed = plates.sigma * rng.standard_normal(plates.force.shape)
    shifted = plates.centre * rng.standard_normal(plates.force.shape)
    moment = cross(plates.lever + shifted, pushed) + cross(shifted, plates.force)
    residual = plates.residual - np.concatenate([pushed.sum(axis=0), moment.sum(axis=0)])
    return np.asarray(np.sqrt(np.einsum("cn,cn->c", residual, residual) / residual.shape[1]) / plates.scale)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class UncertaintySettings:
    """How uncertainty is sampled."""

    samples: int = 1000  # per level, and of the force plates
    levels: tuple[float, ...] = totals.LEVELS  # of added reconstruction error
    # perturbed motions in the database from which each level draws with replacement; unless given, three
    # times the samples. The paper does not say how many it had.
    motions: int | None = None
    noise_on: references.NoiseOn = "rotations"  # coordinates that are perturbed; see ``NoiseOn``
    plates: uncertainty_plates.PlateNoise = dataclasses.field(default_factory=uncertainty_plates.PlateNoise)
    seed: int = 0

    def __post_init__(self) -> None:
        if self.samples < 2 or (self.motions is not None and self.motions < 2):
            raise InputError("two samples at least are needed", field="samples", remedy="Take 1000")
        increasing = list(self.levels) == sorted(set(self.levels))
        if len(self.levels) < 2 or min(self.levels) <= 0.0 or not increasing:
            raise InputError(
                "a line needs two levels at least, positive and increasing",
                field="levels",
                remedy="Take 0.2,0.4,0.6,0.8,1.0",
            )

    @property
    def database_size(self) -> int:
        """How many motions are perturbed."""
        return PER_SAMPLE * self.samples if self.motions is None else self.motions


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SampledUncertainty(totals.WrenchUncertainty):
    """A residual's uncertainty with the levels that were drawn."""

    levels: tuple[Level, ...]


def propagate_by_samples(
    recording: references.LoadedMotion, settings: UncertaintySettings = UncertaintySettings()
) -> SampledUncertainty:
    """Muller's whole study for one recording, by Monte Carlo.

    Every sample has a random stream of its own. Refuses a recording whose markers are followed without any
    error, so that there is nothing to scale a perturbation by.
    """
    reference = references.Reference.of(recording, settings.noise_on)
    body = points.PointBody.of(recording.model, recording.motion.markers)
    reach = 1.0 + max(settings.levels)
    # Perturb the reference motion and compute each motion's error and residual.
    error, dr = linear.compute_error_and_indicator(reference)
    largest = _find_largest(body, reference, settings.seed, error, reach + linear.BEYOND)
    rows = np.empty((settings.database_size, 8))
    for number, row in enumerate(rows):
        rng = stream(settings.seed, "uncertainty", reference.trial, "motion", number)
        row[0] = largest * rng.random()
        noise = rng.standard_normal((len(reference.varied), reference.n_frames))
        moved = reference.perturb(noise, float(row[0]))
        row[1], residual = points.compute_residual(body, reference, moved)
        row[2:] = reference.indicator(residual)
    database = MotionDatabase(
        error_m=error, dr=dr, sizes=rows[:, 0], errors_m=rows[:, 1], indicators=rows[:, 2:]
    )
    levels = draw_levels(database, settings.levels, settings.samples, settings.seed)
    plates = uncertainty_plates.list_pressed(reference, settings.plates)
    pushed = [_push(plates, settings.seed, reference.trial, k) for k in range(settings.samples)]
    plate = uncertainty_plates.SIGMAS * np.std(pushed, axis=0, ddof=1)
    added = np.array([level.added_m for level in levels])
    dispersion = np.array([level.dispersion for level in levels])
    slopes, r2, centred = linear.fit_slopes_through_zero(1e2 * added, dispersion)  # per cm
    kinematic = 1e2 * database.error_m * slopes
    total = kinematic + plate
    return SampledUncertainty(
        trial=reference.trial,
        frames=int(reference.used.sum()),
        reconstruction_error_m=database.error_m,
        dr=database.dr,
        kinematic=kinematic,
        plate=plate,
        total=total,
        slopes_per_cm=slopes,
        r2=r2,
        r2_centred=centred,
        levels=levels,
    )
