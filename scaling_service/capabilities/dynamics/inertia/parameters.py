"""What is known of a body's inertial parameters before and after forces are measured, in units of its spread.

A segment's mass is described by how much there is, where its centre is, and how it is spread about it: its
second moments, which are lengths squared times mass. A whitened vector ``z`` has these ten numbers for each
segment, each change over its prior standard deviation. A thin segment then stays thin: lengths change by
shares of themselves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space

from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel
from scaling_service.model.inertia import gather_inertias
from scaling_service.numerics.multibody import motion

MASS_SD = 0.10
"""Of a segment's mass, relative. The standard deviation between Dumas 2007, Dumas & Wojtusch 2018, de Leva
1996 and Winter 2009 on the whole-body model, median over segments and sexes (0.099), is taken for that of a
person about a table."""

COM_SD = 0.18
"""Of the centre of mass along each axis, over the root mean square distance of the segment's mass from it
along that axis. Between tables: 0.18, as above."""

LENGTH_SD = 0.10
"""Of that root mean square distance, relative. Between tables: 0.094, as above."""

PARTS = ("mass", "com_x", "com_y", "com_z", "Sxx", "Syy", "Szz", "Sxy", "Sxz", "Syz")
"""The ten numbers of ``z``: S are the second moments about the centre of mass."""

MIRRORED = np.array([1.0, 1.0, 1.0, -1.0, 1.0, 1.0, 1.0, 1.0, -1.0, -1.0])
"""Signs of the ten numbers seen in the sagittal plane: z, xz and yz turn round."""

QUANTITIES = ("mass", "com_x", "com_y", "com_z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
"""kg, m in the segment's frame, kg m2 about the centre of mass in the segment's axes."""

SHOWN = 4
"""Parts of a combination that are named (chosen)."""

_REPORTED = np.eye(motion.N_PARAMETERS)


@dataclass(frozen=True, slots=True)
class PriorSpread:
    """Standard deviations of the prior; see ``MASS_SD``, ``COM_SD`` and ``LENGTH_SD``."""

    mass: float = MASS_SD
    com: float = COM_SD
    length: float = LENGTH_SD


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class InertialPrior:
    """A Gaussian prior of all inertial parameters."""

    segments: tuple[str, ...]  # length n
    mean: Array  # (n, 10): the parameters that forces are linear in; see ``Inertias.parameters``
    # (n, 10): standard deviations of ``PARTS``: kg, m, kg m2. Zero for a segment without mass: it keeps none.
    sd: Array
    scale: Array  # (10 n, 10 n): ``mean + scale @ z`` are parameters, to first order about the mean
    basis: Array  # (10 n, k), orthonormal: the directions of z that may move


def make_inertial_prior(
    model: BodyModel, spread: PriorSpread, *, mass_known: bool, symmetric: bool
) -> InertialPrior:
    """The prior around a model's own inertia, its total mass kept where known.

    Symmetric: segments ``…_r`` and ``…_l`` change alike, each in units of its own spread, mirrored.
    """
    inertias = gather_inertias(model)
    # Standard deviations of `PARTS`, (n, 10).
    mass, tensor = inertias.mass, inertias.tensor
    squares = 0.5 * np.trace(tensor, axis1=1, axis2=2)[:, None] - np.diagonal(tensor, axis1=1, axis2=2)
    sizes = np.sqrt(np.clip(squares, 0.0, None))  # length times root of mass
    lengths = np.divide(sizes, np.sqrt(mass)[:, None], out=np.zeros_like(sizes), where=mass[:, None] > 0)
    # The square of a length has twice its relative deviation; a product of two has root two of it.
    second = [
        (2.0 if i == j else np.sqrt(2.0)) * spread.length * sizes[:, i] * sizes[:, j]
        for i, j in motion.TENSOR
    ]
    sd = np.stack([spread.mass * mass, *(spread.com * lengths).T, *second], axis=1)
    scale = np.zeros((sd.size, sd.size))
    for k, slopes in enumerate(_differentiate_parameters(inertias)):
        rows = slice(motion.N_PARAMETERS * k, motion.N_PARAMETERS * (k + 1))
        scale[rows, rows] = slopes * sd[k]
    # Orthonormal directions of z that may move, whatever the total mass does
    columns = []
    for row, name in enumerate(model.segment_names):
        twin = {"_r": f"{name[:-2]}_l", "_l": f"{name[:-2]}_r"}.get(name[-2:])
        other = model.segment_names.index(twin) if symmetric and twin in model.segment_names else None
        if other is not None and name.endswith("_l"):
            continue
        for j in np.flatnonzero(sd[row]).tolist():
            column = np.zeros(sd.size)
            column[motion.N_PARAMETERS * row + j] = 1.0
            if other is not None and sd[other, j]:
                column[motion.N_PARAMETERS * other + j] = MIRRORED[j]
            columns.append(column / np.linalg.norm(column))
    basis = np.array(columns).T
    if mass_known:
        basis = basis @ null_space((scale[:: motion.N_PARAMETERS].sum(axis=0) @ basis)[None, :])
    return InertialPrior(
        segments=model.segment_names, mean=inertias.parameters(), sd=sd, scale=scale, basis=basis
    )


def _differentiate_parameters(inertias: motion.Inertias) -> Array:
    """Derivatives of the parameters in ``PARTS``, (n, 10, 10)."""
    mass, com = inertias.mass, inertias.com
    slopes = np.zeros((len(mass), motion.N_PARAMETERS, motion.N_PARAMETERS))
    slopes[:, 0, 0] = 1.0
    slopes[:, 1:4, 0] = com
    slopes[:, (1, 2, 3), (1, 2, 3)] = mass[:, None]
    slopes[:, 4:, 4:] = convert_second_moments()
    squares = (com**2).sum(axis=1)
    for row, (i, j) in enumerate(motion.TENSOR, start=4):
        slopes[:, row, 0] = (i == j) * squares - com[:, i] * com[:, j]
        for axis in range(3):
            change = 2.0 * (i == j) * com[:, axis] - (axis == i) * com[:, j] - (axis == j) * com[:, i]
            slopes[:, row, 1 + axis] = mass * change
    return slopes


def convert_second_moments() -> Array:
    """The matrix (6, 6) that makes an inertia tensor of second moments: ``tr(S) 1 - S``."""
    matrix = np.zeros((6, 6))
    for column, (i, j) in enumerate(motion.TENSOR):
        if i == j:
            matrix[:3, column] = 1.0
            matrix[column, column] = 0.0
        else:
            matrix[column, column] = -1.0
    return matrix


_REPORTED[4:, 4:] = convert_second_moments()


@dataclass(frozen=True, slots=True, kw_only=True)
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


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WrenchError:
    """How well the ground wrench of one recording is explained."""

    trial: str
    held_out: bool  # whether it was not used to fit
    frames: int
    # before, after (6,), N and N m: RMS error with the prior's and the identified inertia; moments about the
    # root segment's origin, ground axes, in the order of ``COMPONENTS``
    before: Array
    after: Array


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class InertialIdentification:
    """The inertia that recordings and tables give together."""

    model: BodyModel  # with the identified inertia
    parameters: tuple[InertialParameter, ...]  # ten for each segment with mass
    combinations: tuple[Combination, ...]  # those that were free to move, best determined first
    fits: tuple[WrenchError, ...]  # fitted and held-out recordings
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


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
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
    old, new = _list_numbers(before), _list_numbers(after)
    informed = solution.directions * np.sqrt(solution.gains / (1.0 + solution.gains))
    found = []
    for k, segment in enumerate(prior.segments):
        rows = slice(motion.N_PARAMETERS * k, motion.N_PARAMETERS * (k + 1))
        to_numbers = _REPORTED * prior.sd[k]
        alone, possible, learnt = (
            (part**2).sum(axis=1)
            for part in (to_numbers, to_numbers @ prior.basis[rows], to_numbers @ informed[rows])
        )
        sd = np.sqrt(np.clip(possible - learnt, 0.0, None))
        known = learnt > 0.5 * possible  # the variance is more than halved: the recordings outweigh the prior
        found += [
            InertialParameter(
                segment=segment,
                quantity=QUANTITIES[j],
                before=float(old[k, j]),
                after=float(new[k, j]),
                prior_sd=float(np.sqrt(alone[j])),
                sd=float(sd[j]),
                identifiable=bool(known[j]),
            )
            for j in np.flatnonzero(alone > 0.0).tolist()
        ]
    return tuple(found)


def _list_numbers(model: BodyModel) -> Array:
    """Mass, centre of mass and tensor about it, (n, 10)."""
    inertias = gather_inertias(model)
    tensors = np.stack([inertias.tensor[:, i, j] for i, j in motion.TENSOR], axis=1)
    return np.concatenate([inertias.mass[:, None], inertias.com, tensors], axis=1)


def describe_combinations(prior: InertialPrior, solution: Solution) -> tuple[Combination, ...]:
    """What moved, best determined first, each by its largest parts."""
    found = []
    for direction, gain, move in zip(solution.directions.T, solution.gains, solution.moves, strict=True):
        largest = np.argsort(-np.abs(direction))[:SHOWN]
        parts = tuple(
            Part(
                prior.segments[at // motion.N_PARAMETERS],
                PARTS[at % motion.N_PARAMETERS],
                float(direction[at]),
            )
            for at in largest.tolist()
        )
        found.append(Combination(parts, float(gain), float(move), float(1.0 / np.sqrt(1.0 + gain))))
    return tuple(found)
