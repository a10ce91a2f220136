"""What the plates say the person weighs: the momentum balance of whole recordings.

Vertical force equals mass times gravity and the acceleration of the centre of mass, whatever the person does:
so flight counts for nothing, and neither does the push of a jump. The median over blocks of time passes over
the part of a recording in which a chair, or a foot beside the plates, bears some of the weight.
"""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.kinetics.inverse_dynamics import InverseDynamics
from scaling_service.core.arrays import Array
from scaling_service.core.errors import TrialUnusable
from scaling_service.core.text import list_few

BLOCK_S = 0.5  # chosen: about a step; what the model misses of the acceleration alternates within one
PLATES_SHARE = 0.003
"""Standard deviation of a plate's gain (chosen: makers state 0.2 % of full scale for non-linearity and as
much for hysteresis)."""

FAR_OFF = 1.5
"""Ratio of the masses beyond which one of them must be wrong (chosen: no person errs so about a weight)."""

NOTICED = 0.015
"""Share of the mass by which plates and declaration must differ to be noted (chosen: clothes and shoes)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Weight:
    """Mass by the plates beside the declared one."""

    declared_kg: float  # the model's
    plates_kg: float
    sd_kg: float  # of plates_kg: spread of blocks of time, disagreement of recordings, the plates' gain
    by_trial: abc.Mapping[str, float]  # kg, by the recordings' names

    @property
    def factor(self) -> float:
        """True over declared mass."""
        return self.plates_kg / self.declared_kg

    def check(self) -> None:
        """Refuse a model or forces of which one must be wrong: the residual would mean nothing."""
        if not 1 / FAR_OFF <= self.factor <= FAR_OFF:
            raise TrialUnusable(
                f"the plates bear {self.plates_kg:.1f} kg, the model weighs {self.declared_kg:.1f} kg",
                file=next(iter(self.by_trial)),
                field="subject.mass_kg",
                remedy="Declare the right mass, use a model of the whole body, and give forces in N",
            )

    @property
    def differs(self) -> bool:
        """Whether the declared mass is wrong beyond what plates and clothes explain."""
        return self.differs_from(self.declared_kg)

    def differs_from(self, declared_kg: float) -> bool:
        """Whether a declared mass is wrong beyond what plates and clothes explain."""
        return abs(self.plates_kg - declared_kg) > max(NOTICED * declared_kg, 1.96 * self.sd_kg)

    @property
    def disagree(self) -> bool:
        """Whether recordings differ among themselves by more than clothes."""
        kilograms = self.by_trial.values()
        return max(kilograms) - min(kilograms) > 2 * NOTICED * self.declared_kg

    @property
    def sentences(self) -> tuple[str, ...]:
        """What a person should know; none where declaration, plates and recordings agree."""
        said = []
        if self.differs:
            said.append(
                f"The plates bear {self.plates_kg:.1f} kg (standard deviation {self.sd_kg:.1f}), the model "
                f"weighs {self.declared_kg:.1f} kg: check the mass that is given, shoes and what the "
                "person carried."
            )
        if self.disagree:
            each = list_few([f"{kg:.1f} kg in {name}" for name, kg in self.by_trial.items()])
            said.append(f"Recordings disagree about the weight: the plates bear {each}.")
        return tuple(said)


def weigh(declared_kg: float, blocks: abc.Mapping[str, abc.Iterable[tuple[Array, Array]]]) -> Weight | None:
    """Mass from vertical forces; None where no frame counts.

    ``declared_kg``: the model's. ``blocks``: by recording, for each block of time, the vertical force
    measured and the one that the model's motion needs, of the frames that count (n,), N.
    """
    sums = {
        name: np.array([(m.sum(), n.sum()) for m, n in some if len(m)]).reshape(-1, 2)
        for name, some in blocks.items()
    }
    sums = {name: table[table[:, 1] > 0.0] for name, table in sums.items()}
    sums = {name: table for name, table in sums.items() if len(table)}
    if not sums:
        return None
    every = np.concatenate(list(sums.values()))
    ratio, weight = every[:, 0] / every[:, 1], every[:, 1]
    low, middle, high = compute_quantiles(ratio, weight, (0.16, 0.5, 0.84))
    spread = (high - low) / 2.0  # a standard deviation, of normal blocks
    counting = weight.sum() ** 2 / (weight**2).sum()
    standing = spread * np.sqrt(np.pi / 2.0 / counting)  # of a median, near a normal distribution
    each = {name: compute_quantiles(t[:, 0] / t[:, 1], t[:, 1], (0.5,))[0] for name, t in sums.items()}
    shares = np.array([table[:, 1].sum() for table in sums.values()]) / weight.sum()
    among = float(shares**2 @ np.square(np.array(list(each.values())) - middle))
    sd = float(np.sqrt(standing**2 + among + PLATES_SHARE**2))
    return Weight(
        declared_kg=declared_kg,
        plates_kg=middle * declared_kg,
        sd_kg=sd * declared_kg,
        by_trial={n: r * declared_kg for n, r in each.items()},
    )


def weigh_motions(found: abc.Mapping[str, tuple[InverseDynamics, NDArray[np.bool_]]]) -> Weight | None:
    """Mass from the dynamics of recordings with the frames (n,) that count in each; see :func:`weigh`."""
    blocks = {}
    for name, (dynamics, frames) in found.items():
        borne = dynamics.external[:, 1]
        needed = borne + dynamics.residual[:, 1]
        spans = split_into_blocks(dynamics.find_used(frames), dynamics.motion.times, BLOCK_S)
        blocks[name] = [(borne[rows], needed[rows]) for rows in spans]
    first = next(iter(found.values()), None)
    return None if first is None else weigh(first[0].mass, blocks)


def split_into_blocks(
    used: NDArray[np.bool_], times: Array, length_s: float
) -> abc.Iterator[NDArray[np.intp]]:
    """The frames that are used (n,), by blocks of time."""
    number = np.floor((times - times[0]) / length_s)
    for k in np.unique(number[used]):
        yield np.flatnonzero(used & (number == k))


def compute_quantiles(values: Array, weights: Array, shares: abc.Sequence[float]) -> list[float]:
    """Weighted quantiles."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return [float(values[order][np.searchsorted(total, share * total[-1])]) for share in shares]
