"""How lively a person is against people: levels of what is ordinary, learnt from the recordings.

A level multiplies standard deviations. Persons, their parts and the models made of them differ by a factor
whose logarithm is Gaussian; the recordings decide (MacKay 1992, Neural Comput 4:415, eq. 4.8).
"""

from __future__ import annotations

import math

import numpy as np

from scaling_service.capabilities.discovery.ordinary.body import PARTS
from scaling_service.core.arrays import Array

SPREAD = 0.7  # SD of a level's logarithm (chosen: skin of two persons differs by a factor of two)
MARKER = 0.45
"""The same of one marker against the others of its part of the body (upper half over 190 markers of seven
ordinary recordings; feet without joints and shoulders are the liveliest)."""

STILLEST = 0.3  # of its part's level, for a marker (chosen: three deviations)
FACTORS = (1.5, 2.0, 3.0, 4.5, 7.0, 10.0, 15.0, 25.0, 40.0)
"""By which something may be livelier at one place than elsewhere (a grid of half as much again)."""

_LEAST = 0.01  # chosen: computed recordings without noise say nothing about people
_ROUNDS, _SETTLED = 50, 1e-9


def find_most(level: str) -> float:
    """How large a level may be: skin and joints' glide may be livelier than people's are.

    That a model is worse than models are is looked for.

    Examples
    --------
    >>> find_most("legs"), find_most("joint legs")
    (inf, 1.0)
    """
    return math.inf if level in (*PARTS, "trunk") or level.startswith("glide") else 1.0


def learn_level(
    level: Array | float,
    energy: Array | float,
    count: Array | float,
    most: float = math.inf,
    spread: Array | float = SPREAD,
) -> Array:
    """The likeliest level, or levels of any shape.

    Parameters
    ----------
    level : ndarray or float
        The present one.
    energy : ndarray or float
        Sum of squares of numbers divided by their deviations at the present level.
    count : ndarray or float
        How many of them the recordings tell.
    most : float
        It is no larger.
    spread : ndarray or float
        Deviation of its logarithm before anything is seen.

    Examples
    --------
    >>> learn_level(1.0, 400.0, 100.0).round(2).item()  # a hundred numbers of twice the deviation
    1.99
    """
    u, squares = np.log(level), energy * np.square(level)
    for _ in range(_ROUNDS):
        e = squares * np.exp(-2.0 * u)
        step = (count - e + u / spread**2) / (2.0 * e + 1.0 / spread**2)
        u = u - np.clip(step, -1.0, 1.0)
        if np.max(np.abs(step), initial=0.0) < _SETTLED:
            break
    return np.asarray(np.clip(np.exp(u), _LEAST, most))


def weigh_level(level: float) -> float:
    """Logarithm of a level's prior density, but for a constant."""
    return -0.5 * (math.log(level) / SPREAD) ** 2


def weigh_marker(energy: Array, count: Array) -> Array:
    """Log evidence of markers' numbers, but for a constant, however much more each wanders than its part.

    ``energy``: their sum of squares in deviations of its part; ``count``: how many are free.
    """
    factor = learn_level(1.0, energy, count, spread=MARKER)
    lively = np.log(factor)
    return np.asarray(-0.5 * (energy / factor**2 + (lively / MARKER) ** 2) - count * lively)
