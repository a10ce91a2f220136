"""What the report of a subject's dynamics shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.dynamics.document import DynamicsDocument
from scaling_service.core.text import few

Array = NDArray[np.float64]

COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")
"""Ground axes X forward, Y up, Z right; moments about the root segment's origin."""


@dataclass(frozen=True, slots=True, eq=False)
class ResidualCurves:
    """A residual over time.

    Parameters
    ----------
    times : ndarray, shape (n,), s
    residual : ndarray, shape (n, 6), N and N m
        NaN in frames that do not count.
    """

    times: Array
    residual: Array


@dataclass(frozen=True, slots=True, eq=False)
class DynamicsData:
    """The document, and curves of every recording in it."""

    document: DynamicsDocument
    curves: Mapping[str, ResidualCurves]


def told(document: DynamicsDocument) -> list[str]:
    """The recordings' warnings, what holds of several of them told once."""
    where: dict[str, list[str]] = {}
    for name, trial in document.trials.items():
        for warning in trial.warnings:
            where.setdefault(warning.removeprefix(f"{name}: "), []).append(name)
    return [f"{few(names)}: {said}" for said, names in where.items()]
