"""Held-out beside fitted: how much worse a model follows recordings that it was not fitted to."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.scaling.comparison.kinematic_error import KinematicError


@dataclass(frozen=True, slots=True)
class Generalisation:
    """Mean kinematic errors of one method, each trial counting once.

    Parameters
    ----------
    fitted, held_out : float, m
        Over the trials whose frames may have been fitted, and over the others; NaN where there is none:
        what was never held out cannot be made up for by splitting what was fitted.
    """

    fitted: float
    held_out: float

    @property
    def ratio(self) -> float:
        """Held out over fitted: 1 where nothing was overfitted; NaN where either is missing or zero."""
        return self.held_out / self.fitted if self.fitted > 0.0 else float("nan")


def generalisation(errors: Mapping[str, KinematicError], fitted: Collection[str]) -> Generalisation:
    """Both means from a method's errors.

    Parameters
    ----------
    errors : mapping
        Trial to its kinematic error.
    fitted : collection of str
        The calibration trials.

    Examples
    --------
    >>> def error(mean):
    ...     return KinematicError(mean, 0.0, mean, mean, {}, mean, mean, 1)
    >>> errors = {"hip": error(0.004), "knee": error(0.006), "walk": error(0.010)}
    >>> found = generalisation(errors, fitted=["hip", "knee"])
    >>> found.fitted, found.held_out, found.ratio
    (0.005, 0.01, 2.0)
    """
    used = [error.mean for trial, error in errors.items() if trial in fitted]
    others = [error.mean for trial, error in errors.items() if trial not in fitted]
    return Generalisation(_mean(used), _mean(others))


def _mean(values: list[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.mean(known)) if known else float("nan")
