"""What an identification did, in the numbers of each segment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.dynamics.inertia.prior import PARTS, InertialPrior, tensor_of_second_moments
from scaling_service.capabilities.dynamics.inertia.result import QUANTITIES, Combination, InertialParameter
from scaling_service.model.body import BodyModel
from scaling_service.model.inertia import inertias_of
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.mechanism import N_PARAMETERS, TENSOR

SHOWN = 4
"""Parts of a combination that are named (chosen)."""

_REPORTED = np.eye(N_PARAMETERS)
_REPORTED[4:, 4:] = tensor_of_second_moments()


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Where the parameters end, and how well the directions that moved are known.

    Parameters
    ----------
    change : ndarray, shape (10 n,)
        Of the parameters that forces are linear in.
    directions : ndarray, shape (10 n, k)
        Unit vectors in z.
    gains, moves : ndarray, shape (k,)
        Information of the recordings over the prior's, and how far z went.
    noise : ndarray, shape (6,), N and N m
    """

    change: Array
    directions: Array
    gains: Array
    moves: Array
    noise: Array


def described_parameters(
    before: BodyModel, after: BodyModel, prior: InertialPrior, solution: Solution
) -> tuple[InertialParameter, ...]:
    """Every number of every segment with mass, before and after."""
    old, new = _numbers(before), _numbers(after)
    told = solution.directions * np.sqrt(solution.gains / (1.0 + solution.gains))
    found = []
    for k, segment in enumerate(prior.segments):
        rows = slice(N_PARAMETERS * k, N_PARAMETERS * (k + 1))
        to_numbers = _REPORTED * prior.sd[k]
        alone, possible, learnt = (
            (part**2).sum(axis=1)
            for part in (to_numbers, to_numbers @ prior.basis[rows], to_numbers @ told[rows])
        )
        sd = np.sqrt(np.clip(possible - learnt, 0.0, None))
        known = learnt > 0.5 * possible  # the variance is more than halved: the recordings outweigh the prior
        found += [
            InertialParameter(
                segment,
                QUANTITIES[j],
                float(old[k, j]),
                float(new[k, j]),
                float(np.sqrt(alone[j])),
                float(sd[j]),
                bool(known[j]),
            )
            for j in np.flatnonzero(alone > 0.0).tolist()
        ]
    return tuple(found)


def _numbers(model: BodyModel) -> Array:
    """Mass, centre of mass and tensor about it, (n, 10)."""
    inertias = inertias_of(model)
    tensors = np.stack([inertias.tensor[:, i, j] for i, j in TENSOR], axis=1)
    return np.concatenate([inertias.mass[:, None], inertias.com, tensors], axis=1)


def described_combinations(prior: InertialPrior, solution: Solution) -> tuple[Combination, ...]:
    """What moved, best determined first, each by its largest parts."""
    found = []
    for direction, gain, move in zip(solution.directions.T, solution.gains, solution.moves, strict=True):
        largest = np.argsort(-np.abs(direction))[:SHOWN]
        shares = tuple(
            (prior.segments[at // N_PARAMETERS], PARTS[at % N_PARAMETERS], float(direction[at]))
            for at in largest.tolist()
        )
        found.append(Combination(shares, float(gain), float(move), float(1.0 / np.sqrt(1.0 + gain))))
    return tuple(found)
