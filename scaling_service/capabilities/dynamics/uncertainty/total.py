"""How much of a residual wrench is only the measurement's uncertainty (Muller et al. 2017).

For the command that judges a recording::

    found = propagate(recording, settings, executor=executor)

``recording`` is a :class:`Recording` (model, motion, loads, stature), ``found`` a frozen
:class:`WrenchUncertainty` that holds all that ``dynamics.json`` shows: ``dr``, ``kinematic``, ``plate`` and
``total`` (shape (6,), shares of body weight, and of body weight times stature), ``slopes_per_cm``, ``r2``,
``calibration_supported`` (six booleans) and ``verdict``, a sentence. Components are in the order of
``COMPONENTS``. Results do not depend on the executor.
``propagate_linearly`` gives the same numbers without
samples, in about a second.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.dynamics.uncertainty.monte_carlo import (
    Level,
    MotionDatabase,
    draw_database,
    levels_of,
    slopes_through_zero,
)
from scaling_service.capabilities.dynamics.uncertainty.plates import PlateNoise, plate_dispersion
from scaling_service.capabilities.dynamics.uncertainty.reference import NoiseOn, Reference
from scaling_service.capabilities.dynamics.uncertainty.reference import Recording as Recording
from scaling_service.capabilities.dynamics.uncertainty.verdict import Verdict, judge
from scaling_service.core.errors import InputError
from scaling_service.core.serial import Serial
from scaling_service.numerics.multibody.laws import Array

_CM = 1e2

PER_SAMPLE = 3
"""Motions in the database for each sample of a level (chosen: as noise is uniform in size, over a third of
them lie in the lowest level, so that every level draws from more motions than it draws)."""


@dataclass(frozen=True, slots=True)
class UncertaintySettings:
    """How uncertainty is sampled.

    Parameters
    ----------
    samples : int
        Per level, and of the force plates.
    levels : tuple of float
        Largest added reconstruction error over the reference's (Muller et al. 2017, sec. 2.2).
    motions : int, optional
        Perturbed motions in the database from which each level draws with replacement; unless given, three
        times the samples. The paper does not say how many it had.
    noise_on : 'rotations' or 'all'
        Coordinates that are perturbed; see ``NoiseOn``.
    plates : PlateNoise
    seed : int
    """

    samples: int = 1000
    levels: tuple[float, ...] = (0.2, 0.4, 0.6, 0.8, 1.0)
    motions: int | None = None
    noise_on: NoiseOn = "rotations"
    plates: PlateNoise = field(default_factory=PlateNoise)
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


@dataclass(frozen=True, slots=True, eq=False)
class WrenchUncertainty:
    """The residual of one recording and its uncertainty, six components each.

    Parameters
    ----------
    trial : str
    frames : int
        Over how many the indicator is taken.
    reconstruction_error_m : float
        Of the filtered reference motion.
    dr : ndarray, shape (6,)
        The reference's residual indicator (eq. 7).
    kinematic : ndarray, shape (6,)
        Reconstruction error times slope: the dispersion that an added error as large as the reference's
        brings.
    plate : ndarray, shape (6,)
        Three standard deviations by the plates' own noise.
    total : ndarray, shape (6,)
        Their sum (eq. 12).
    slopes_per_cm : ndarray, shape (6,)
        Dispersion per centimetre of added reconstruction error.
    r2 : ndarray, shape (6,)
        Of the lines through zero: ``1 - SSE / sum y^2``, as is right without intercept.
    r2_centred : ndarray, shape (6,)
        The stricter ``1 - SSE / sum (y - mean)^2``.
    levels : tuple of Level
    calibration_supported : ndarray of bool, shape (6,)
        Where the residual stands above its uncertainty.
    judgement : Verdict
    """

    trial: str
    frames: int
    reconstruction_error_m: float
    dr: Array
    kinematic: Array
    plate: Array
    total: Array
    slopes_per_cm: Array
    r2: Array
    r2_centred: Array
    levels: tuple[Level, ...]
    judgement: Verdict

    @property
    def calibration_supported(self) -> NDArray[np.bool_]:
        """Component by component, whether inertial parameters can be calibrated by it."""
        return self.judgement.supported

    @property
    def verdict(self) -> str:
        """The judgement in words."""
        return self.judgement.sentence


def propagate(
    recording: Recording,
    settings: UncertaintySettings = UncertaintySettings(),
    *,
    executor: Executor | None = None,
    progress: Callable[[float], None] | None = None,
) -> WrenchUncertainty:
    """Muller's whole study for one recording, by Monte Carlo.

    Parameters
    ----------
    recording : Recording
    settings : UncertaintySettings
    executor : Executor, optional
        Where samples are drawn; this thread unless given. Every sample has a random stream of its own.
    progress : callable, optional
        Called with the share that is done.

    Raises
    ------
    TrialUnusable
        No frame has a motion and all its forces, or loads are on another clock.
    InputError
        The markers are followed without any error, so that there is nothing to scale a perturbation by.
    """
    reference = Reference.of(recording, settings.noise_on)
    run = executor or Serial()
    database = draw_database(
        reference, settings.database_size, settings.seed, 1.0 + max(settings.levels), run, progress
    )
    levels = levels_of(database, settings.levels, settings.samples, settings.seed)
    plate = plate_dispersion(reference, settings.plates, settings.samples, settings.seed, run)
    return uncertainty_of(reference, database, levels, plate)


def uncertainty_of(
    reference: Reference, database: MotionDatabase, levels: tuple[Level, ...], plate: Array
) -> WrenchUncertainty:
    """Slopes, the global uncertainty and the verdict from the dispersion at all levels."""
    added = np.array([level.added_m for level in levels])
    dispersion = np.array([level.dispersion for level in levels])
    slopes, r2, centred = slopes_through_zero(_CM * added, dispersion)
    kinematic = _CM * database.error_m * slopes
    total = kinematic + plate
    return WrenchUncertainty(
        reference.trial,
        int(reference.used.sum()),
        database.error_m,
        database.dr,
        kinematic,
        plate,
        total,
        slopes,
        r2,
        centred,
        levels,
        judge(database.dr, total),
    )
