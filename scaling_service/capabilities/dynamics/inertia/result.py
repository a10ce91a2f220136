"""What inertial identification gives: a model, every parameter, and what held-out recordings say of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from scaling_service.capabilities.dynamics.inertia.prior import PARTS, InertialPrior, tensor_of_second_moments
from scaling_service.model.body import BodyModel
from scaling_service.model.inertia import inertias_of
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.mechanism import N_PARAMETERS, TENSOR

QUANTITIES = ("mass", "com_x", "com_y", "com_z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
"""kg, m in the segment's frame, kg m2 about the centre of mass in the segment's axes."""

SHOWN = 4
"""Parts of a combination that are named (chosen)."""

_REPORTED = np.eye(N_PARAMETERS)
_REPORTED[4:, 4:] = tensor_of_second_moments()


@dataclass(frozen=True, slots=True)
class InertialParameter:
    """One number of one segment, in SI units."""

    segment: str
    quantity: str  # one of ``QUANTITIES``
    before: float
    after: float
    # prior_sd, sd: before and after; the second leaves out that limits of possible bodies narrow it
    prior_sd: float
    sd: float
    identifiable: bool  # whether the recordings say more about it than the prior does

    @property
    def unit(self) -> str:
        """Of all its numbers."""
        return "kg" if self.quantity == "mass" else "m" if self.quantity.startswith("com") else "kg m2"

    @property
    def moved(self) -> float:
        """The change in units of the prior's standard deviation."""
        return (self.after - self.before) / self.prior_sd


class Part(NamedTuple):
    """A part of a combination; weights are a unit vector in units of the prior's standard deviations."""

    segment: str
    quantity: str
    weight: float


@dataclass(frozen=True, slots=True)
class Combination:
    """A combination of parameters that the recordings determine."""

    parts: tuple[Part, ...]  # its largest ones
    gain: float  # how many times more the recordings say about it than the prior, as variances
    # moved, sd: change and standard deviation, in units of the prior's
    moved: float
    sd: float


@dataclass(frozen=True, slots=True, eq=False)
class WrenchFit:
    """How well the ground wrench of one recording is explained."""

    trial: str
    held_out: bool  # whether it was not used to fit
    frames: int
    # before, after (6,), N and N m: RMS error with the prior's and the identified inertia; moments about the
    # root segment's origin, ground axes, in the order of ``COMPONENTS``
    before: Array
    after: Array


@dataclass(frozen=True, slots=True, eq=False)
class InertialIdentification:
    """The inertia that recordings and tables give together."""

    model: BodyModel  # with the identified inertia
    parameters: tuple[InertialParameter, ...]  # ten for each segment with mass
    combinations: tuple[Combination, ...]  # those that were free to move, best determined first
    fits: tuple[WrenchFit, ...]  # fitted and held-out recordings
    components: tuple[bool, ...]  # which components of the wrench were used
    # (6,), N and N m: standard deviation of the wrench's error that was assumed or found; NaN for components
    # not used
    noise: Array
    warnings: tuple[str, ...] = ()

    def relative_error(self, *, held_out: bool) -> float:
        """Error after over error before, of the used components, each counted in units of the noise.

        NaN where there is no such recording.
        """
        fits = [fit for fit in self.fits if fit.held_out == held_out]
        used = np.array(self.components)
        if not fits:
            return float("nan")
        before, after = (
            sum(f.frames * float(((value / self.noise)[used] ** 2).sum()) for f, value in pairs)
            for pairs in ([(f, f.before) for f in fits], [(f, f.after) for f in fits])
        )
        return float(np.sqrt(after / before))


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Where the parameters end, and how well the directions that moved are known."""

    change: Array  # (10 n,): of the parameters that forces are linear in
    directions: Array  # (10 n, k): unit vectors in z
    # gains, moves (k,): information of the recordings over the prior's, and how far z went
    gains: Array
    moves: Array
    noise: Array  # (6,), N and N m


def describe_parameters(
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


def describe_combinations(prior: InertialPrior, solution: Solution) -> tuple[Combination, ...]:
    """What moved, best determined first, each by its largest parts."""
    found = []
    for direction, gain, move in zip(solution.directions.T, solution.gains, solution.moves, strict=True):
        largest = np.argsort(-np.abs(direction))[:SHOWN]
        parts = tuple(
            Part(prior.segments[at // N_PARAMETERS], PARTS[at % N_PARAMETERS], float(direction[at]))
            for at in largest.tolist()
        )
        found.append(Combination(parts, float(gain), float(move), float(1.0 / np.sqrt(1.0 + gain))))
    return tuple(found)
