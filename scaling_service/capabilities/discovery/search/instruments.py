"""A plate whose readings are off as no fault of the catalogue has it: as an instrument's may be.

Its readings may take shares of each other, bend under load, and come late by themselves (the crosstalk,
linearity and timing that makers state), in all recordings: it is one instrument. What fits such a plate best
says where the fault is, not what it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column, Estimate
from scaling_service.capabilities.discovery.laws.loads import PlateLate, PlateMisreading
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS, Load
from scaling_service.capabilities.discovery.ordinary.forces import Touch, WrenchTable
from scaling_service.core.arrays import Array

_LATE_S = 0.02  # SD (chosen: a few frames)
_SLIGHTLY, _WRONGLY, _BENT = 0.03, 0.3, 0.1
"""SD of shares (chosen): of crosstalk (makers allow 2 %), of channels that are wrong, and of what bends."""

Prior = tuple[Candidate, Array]
"""With the deviations of its numbers."""


def find_misreading(
    fit: Fit, named: Sequence[tuple[Estimate, Array]], known: Sequence[Prior], touching: Sequence[Touch]
) -> tuple[float, Prior, str] | None:
    """The likeliest plate that misreads: log odds, the columns of that, and in words; None without plates.

    Parameters
    ----------
    named : sequence
        Effects of the wrench, with the prior deviations of their numbers; ``touching``: touches that are.
    known : sequence
        Plates found before.
    """
    taken = {candidate.where for candidate, _ in known}
    rivals = [one for one in _propose_misreadings(fit.scene.plates) if one[0].where not in taken]
    if not rivals:
        return None
    others = [*((effect.candidate, sd) for effect, sd in named), *known]
    table = WrenchTable(fit, [candidate for candidate, _ in (*rivals, *others)])
    own = table.numbers[len(rivals) :]
    for (effect, _), numbers in zip(named, own, strict=False):
        table.add_back(numbers, effect.size)
    sd = np.concatenate([np.zeros(0), *(sd for _, sd in others)])
    beside = table.expand([n for numbers in own for n in numbers]) * sd
    without = table.weigh(beside, table.expand([]), np.zeros(0), touching).value
    best: tuple[float, Prior, Array] | None = None
    for one, numbers in zip(rivals, table.numbers, strict=False):
        found = table.weigh(beside, table.expand(numbers), one[1], touching)
        odds = found.value - without - math.log(len(rivals))
        if best is None or odds > best[0]:
            best = odds, one, found.size
    assert best is not None
    return best[0], best[1], _describe(best[1][0], best[2])


def _propose_misreadings(plates: Sequence[str]) -> Iterator[Prior]:
    numbers = range(len(COMPONENTS))
    for plate in plates:
        yield _make(plate, "late", [PlateLate(plate)], _LATE_S)
        every = [PlateMisreading(plate, k, of) for k in numbers for of in numbers]
        yield _make(plate, "slightly", every, _SLIGHTLY)
        yield _make(plate, "wrongly", every, _WRONGLY)
        yield _make(plate, "bent", [PlateMisreading(plate, k, 1, bent=True) for k in numbers], _BENT)
        for k in numbers:
            yield _make(plate, COMPONENTS[k], [one for one in every if one.component == k], _WRONGLY)


def _make(plate: str, note: str, loads: Sequence[Load], sd: float) -> Prior:
    columns = tuple(Column(str(k), 1.0, load=load) for k, load in enumerate(loads))
    return Candidate("plate_readings", (plate,), columns, note=note), np.full(len(loads), sd)


def _describe(candidate: Candidate, size: Array) -> str:
    """The largest number of it."""
    k = int(np.abs(size).argmax())
    load = candidate.columns[k].load
    if not isinstance(load, PlateMisreading):
        return f"they come {1e3 * size[k]:.0f} ms late"
    own = "itself" if load.of == load.component else COMPONENTS[load.of]
    bent = ", more under load" if load.bent else ""
    return f"{COMPONENTS[load.component]} is off by {abs(size[k]):.0%} of {own}{bent}"
