"""The numbers of an effect as results have them: mm, deg, factors, with their uncertainty."""

from __future__ import annotations

import math

import numpy as np

from scaling_service.capabilities.discovery.document import QuantityDocument
from scaling_service.capabilities.discovery.laws.candidates import Candidate, FreeMotion
from scaling_service.capabilities.discovery.search.findings import NamedEffect
from scaling_service.numerics.multibody.laws import Array

_DIGITS = 6
"""Significant figures: far beyond what any of these is known to."""

_MOMENTS = ("x_kgmm", "y_kgmm", "z_kgmm")


def quantities(named: NamedEffect) -> dict[str, QuantityDocument]:
    """Every number of an effect by its name in the results.

    Parameters
    ----------
    named : Named
    """
    values, covariance = _in_results(named)
    sds = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    names = [column.name for column in named.effect.candidate.columns]
    if set(_MOMENTS) < set(names):
        names, values, sds = _placed(names, values, covariance)
    found = {n: _quantity(v, s) for n, v, s in zip(names, values.tolist(), sds.tolist(), strict=True)}
    found |= _axis_of(named.effect.candidate)
    for name, value in named.details.items():
        if math.isfinite(value) and name not in found and not name.startswith("axis_"):
            spread = named.spreads.get(name)
            found[name] = QuantityDocument(value=rounded(value), sd=spread and rounded(spread))
    return found


def _in_results(named: NamedEffect) -> tuple[Array, Array]:
    """Values and covariance in the units of the results."""
    columns = named.effect.candidate.columns
    units = np.array([column.unit for column in columns])
    neutral = np.array([column.neutral for column in columns])
    covariance = np.asarray(named.covariance, dtype=float).reshape(len(columns), len(columns))
    return neutral + units * named.effect.size, covariance * np.outer(units, units)


def _placed(names: list[str], values: Array, covariance: Array) -> tuple[list[str], Array, Array]:
    """A carried load's first moments as a place: moments over mass, errors to first order."""
    mass = names.index("kg")
    at = [names.index(name) for name in _MOMENTS]
    kg = float(values[mass])
    place = values[at] / kg
    slope = np.zeros((4, len(values)))
    slope[0, mass] = 1.0
    for row, (k, where) in enumerate(zip(at, place, strict=True), start=1):
        slope[row, k] = 1.0 / kg
        slope[row, mass] = -where / kg
    spread = slope @ covariance @ slope.T
    return (
        ["kg", "x_mm", "y_mm", "z_mm"],
        np.concatenate([[kg], place]),
        np.sqrt(np.maximum(np.diag(spread), 0.0)),
    )


def _axis_of(candidate: Candidate) -> dict[str, QuantityDocument]:
    """The direction of a motion that may take any course; its other numbers are details."""
    if not isinstance(candidate.change, FreeMotion):
        return {}
    x, y, z = candidate.change.axis
    return {"axis": QuantityDocument(value=(rounded(x), rounded(y), rounded(z)), sd=None)}


def _quantity(value: float, sd: float) -> QuantityDocument:
    return QuantityDocument(value=rounded(value), sd=rounded(sd) if math.isfinite(sd) and sd > 0.0 else None)


def rounded(value: float) -> float:
    """A number to the figures that results have."""
    return float(f"{value:.{_DIGITS}g}")


def finite(value: float) -> float | None:
    """A number as JSON has it: null where there is none."""
    return rounded(value) if math.isfinite(value) else None
