"""The verdict in words: whether this recording can calibrate this person's inertial parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.dynamics.residuals import COMPONENTS
from scaling_service.numerics.multibody.laws import Array

SMALL_FORCE, SMALL_MOMENT = 0.032, 0.027
"""Mean dr of forces and moments up to which parameters of a table are acceptable: mean and two standard
deviations of the ten persons of Muller et al. 2017 (sec. 3.3: 2 ± 0.6 %, 1.3 ± 0.7 %), who are called so."""

LARGER = np.sqrt(2.0)
"""Residual over the standard deviation of the measurement's error from which inertia has the larger part:
both errors are independent, so the residual's variance is then more than twice the measurement's."""

Whole = Literal["yes", "in part", "no"]


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """What the comparison of a residual with its uncertainty says.

    Parameters
    ----------
    table_acceptable : bool
        H1: the inertial parameters at hand leave a residual as small as the paper's.
    supported : ndarray of bool, shape (6,)
        H2, component by component: the residual stands above its uncertainty.
    calibration : 'yes', 'in part' or 'no'
        H2 as a whole: all components, some, or none.
    sentence : str
    """

    table_acceptable: bool
    supported: NDArray[np.bool_]
    calibration: Whole
    sentence: str


def judge(dr: Array, total: Array) -> Verdict:
    """Compare a residual indicator with its global uncertainty (Muller et al. 2017, sec. 3.3).

    Parameters
    ----------
    dr, total : ndarray, shape (6,)
        Shares of body weight, and of body weight times stature.

    Examples
    --------
    >>> import numpy as np
    >>> verdict = judge(np.full(6, 0.02), np.array([0.1, 0.1, 0.1, 0.1, 0.01, 0.1]))
    >>> verdict.calibration
    'in part'
    >>> print(verdict.sentence)
    Only my can calibrate inertial parameters: its residual stands above the uncertainty. In fx, fy, fz, mx,
    mz the measurement's own uncertainty explains all of the residual, so an identification would fit noise
    there. The parameters at hand are acceptable: forces are left by 2.0 % of body weight, moments by 2.0 % of
    body weight times stature.
    """
    supported = np.asarray(dr > total)
    force, moment = float(dr[:3].mean()), float(dr[3:].mean())
    acceptable = force <= SMALL_FORCE and moment <= SMALL_MOMENT
    whole: Whole = "yes" if supported.all() else "in part" if supported.any() else "no"
    return Verdict(
        acceptable, supported, whole, f"{_about_calibration(supported)} {_about(acceptable, force, moment)}"
    )


def blames_inertia(dr: Array, sd: Array) -> NDArray[np.bool_]:
    """Where the larger part of a residual is inertia's, by the uncertainty that the markers' errors give.

    Sharper than :func:`judge`, which sets the residual against the whole range of white noise on every angle.

    Parameters
    ----------
    dr, sd : ndarray, shape (6,)
        The residual indicator, and the same of :attr:`MarkerUncertainty.sd`: shares of body weight, and of
        body weight times stature.

    Examples
    --------
    >>> blames_inertia(np.array([0.02, 0.02]), np.array([0.01, 0.015])).tolist()
    [True, False]
    """
    return np.asarray(dr > LARGER * sd)


def _about_calibration(supported: NDArray[np.bool_]) -> str:
    names = np.array(COMPONENTS)
    yes, no = ", ".join(names[supported]), ", ".join(names[~supported])
    if not yes:
        return (
            "This recording cannot calibrate inertial parameters: in every component the measurement's own "
            "uncertainty explains all of the residual, so an identification would fit noise."
        )
    if not no:
        return (
            "This recording can calibrate inertial parameters: in every component the residual stands above "
            "what the measurement's uncertainty explains."
        )
    one = supported.sum() == 1
    return (
        f"Only {yes} can calibrate inertial parameters: {'its' if one else 'their'} residual stands above "
        f"the uncertainty. In {no} the measurement's own uncertainty explains all of the residual, so an "
        "identification would fit noise there."
    )


def _about(acceptable: bool, force: float, moment: float) -> str:
    said = "are acceptable" if acceptable else "leave more than those of a table usually do"
    return (
        f"The parameters at hand {said}: forces are left by {100 * force:.1f} % of body weight, moments by "
        f"{100 * moment:.1f} % of body weight times stature."
    )
