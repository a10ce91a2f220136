"""How much of a residual wrench is only the measurement's uncertainty (Muller et al. 2017), and the verdict.

Components are in the order of ``COMPONENTS``, as shares of body weight, and of body weight times stature. The
numbers are the paper's, in closed form; the study of the paper draws them by Monte Carlo as it does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.dynamics.uncertainty.linear import propagate_motion_noise
from scaling_service.capabilities.dynamics.uncertainty.plates import PlateNoise, propagate_plate_noise
from scaling_service.capabilities.dynamics.uncertainty.reference import LoadedMotion as LoadedMotion
from scaling_service.capabilities.dynamics.uncertainty.reference import NoiseOn, Reference
from scaling_service.capabilities.kinetics.inverse_dynamics import COMPONENTS
from scaling_service.core.arrays import Array

LEVELS = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Largest added reconstruction error over the reference's (Muller et al. 2017, sec. 2.2)."""

SMALL_FORCE, SMALL_MOMENT = 0.032, 0.027
"""Mean dr of forces and moments up to which parameters of a table are acceptable: mean and two standard
deviations of the ten persons of Muller et al. 2017 (sec. 3.3: 2 ± 0.6 %, 1.3 ± 0.7 %), who are called so."""

LARGER = np.sqrt(2.0)
"""Residual over the standard deviation of the measurement's error from which inertia has the larger part:
both errors are independent, so the residual's variance is then more than twice the measurement's."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WrenchUncertainty:
    """The residual of one recording and its uncertainty, six components each."""

    trial: str
    frames: int  # over how many the indicator is taken
    reconstruction_error_m: float  # of the filtered reference motion
    dr: Array  # (6,): the reference's residual indicator (eq. 7).
    # (6,): reconstruction error times slope: the dispersion that an added error as large as the reference's
    # brings
    kinematic: Array
    plate: Array  # (6,): three standard deviations by the plates' own noise
    total: Array  # (6,): their sum (eq. 12).
    slopes_per_cm: Array  # (6,): dispersion per centimetre of added reconstruction error
    r2: Array  # (6,): of the lines through zero: ``1 - SSE / sum y^2``, as is right without intercept
    r2_centred: Array  # (6,): the stricter ``1 - SSE / sum (y - mean)^2``

    @property
    def calibration_supported(self) -> NDArray[np.bool_]:
        """Component by component, whether inertial parameters can be calibrated: dr exceeds ``total``."""
        return np.asarray(self.dr > self.total)

    @property
    def verdict(self) -> str:
        """What the comparison of the residual with its uncertainty says."""
        return describe_verdict(self.dr, self.total)


def propagate(
    recording: LoadedMotion,
    *,
    levels: tuple[float, ...] = LEVELS,
    noise_on: NoiseOn = "rotations",
    plates: PlateNoise = PlateNoise(),
) -> WrenchUncertainty:
    """How far the motion's and the plates' noise move the residual of one recording.

    ``noise_on``: which coordinates are uncertain. Raises InputError: a recording whose markers are followed
    without any error.
    """
    reference = Reference.of(recording, noise_on)
    moved = propagate_motion_noise(reference, levels)
    plate = propagate_plate_noise(reference, plates)
    return WrenchUncertainty(
        trial=reference.trial,
        frames=int(reference.used.sum()),
        reconstruction_error_m=moved.error_m,
        dr=moved.dr,
        kinematic=moved.kinematic,
        plate=plate,
        total=moved.kinematic + plate,
        slopes_per_cm=moved.slopes_per_cm,
        r2=moved.r2,
        r2_centred=moved.r2_centred,
    )


def describe_verdict(dr: Array, total: Array) -> str:
    """Compare a residual indicator with its global uncertainty, in words (Muller et al. 2017, sec. 3.3).

    Examples
    --------
    >>> import numpy as np
    >>> print(describe_verdict(np.full(6, 0.02), np.array([0.1, 0.1, 0.1, 0.1, 0.01, 0.1])))
    Only my can calibrate inertial parameters: its residual stands above the uncertainty. In fx, fy, fz, mx,
    mz the measurement's own uncertainty explains all of the residual, so an identification would fit noise
    there. The parameters at hand are acceptable: forces are left by 2.0 % of body weight, moments by 2.0 % of
    body weight times stature.
    """
    force, moment = float(dr[:3].mean()), float(dr[3:].mean())
    acceptable = force <= SMALL_FORCE and moment <= SMALL_MOMENT
    said = "are acceptable" if acceptable else "leave more than those of a table usually do"
    supported = dr > total
    names = np.array(COMPONENTS)
    yes, no = ", ".join(names[supported]), ", ".join(names[~supported])
    if not yes:
        calibration = (
            "This recording cannot calibrate inertial parameters: in every component the measurement's own "
            "uncertainty explains all of the residual, so an identification would fit noise."
        )
    elif not no:
        calibration = (
            "This recording can calibrate inertial parameters: in every component the residual stands above "
            "what the measurement's uncertainty explains."
        )
    else:
        whose = "its" if supported.sum() == 1 else "their"
        calibration = (
            f"Only {yes} can calibrate inertial parameters: {whose} residual stands above the uncertainty. "
            f"In {no} the measurement's own uncertainty explains all of the residual, so an identification "
            "would fit noise there."
        )
    return (
        f"{calibration} The parameters at hand {said}: forces are left by "
        f"{100 * force:.1f} % of body weight, moments by {100 * moment:.1f} % of body weight times stature."
    )


def is_inertia_dominant(dr: Array, sd: Array) -> NDArray[np.bool_]:
    """Where the larger part of a residual is inertia's, by the uncertainty that the markers' errors give.

    Sharper than the verdict, which sets the residual against the whole range of white noise on every angle.
    ``sd`` (6,) is :attr:`MarkerUncertainty.sd` in the units of the indicator.

    Examples
    --------
    >>> is_inertia_dominant(np.array([0.02, 0.02]), np.array([0.01, 0.015])).tolist()
    [True, False]
    """
    return np.asarray(dr > LARGER * sd)
