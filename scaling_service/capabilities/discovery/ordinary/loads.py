"""Candidates of the wrench, touches and the body's mass against what is ordinary."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate
from scaling_service.capabilities.discovery.ordinary.forces import (
    OF_MOVEMENT,
    ForceEvidence,
    Touch,
    WrenchTable,
    measure_noise,
)
from scaling_service.capabilities.discovery.ordinary.odds import Scored
from scaling_service.core.arrays import Array

EVERYBODYS = ("wobbling_mass",)
"""What every living body has, so that only much more of it, or of a body that is quiet elsewhere, is named:
most of a thigh and of a trunk is soft (Gruber 1998, Pain and Challis 2006). Half of what is met is
everybody's."""

_AGAIN = 16  # of the likeliest, for which levels are learnt anew (chosen: the lead is among them)


class Touched(NamedTuple):
    """Of a touch, alone or as one of all of the same segment, whichever is likelier."""

    bayes: float  # log Bayes factor against nothing
    beyond: float  # the same against forces that disagree more in its frames, of whatever course, too
    together: float  # log Bayes factor of all of them


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Loads:
    """Candidates of the wrench against what is ordinary."""

    table: WrenchTable
    none: ForceEvidence  # without any of them
    scored: Sequence[Scored]  # each by itself beside what is named, everybody's share of it taken off
    mass: float  # log Bayes factor of the body's mass
    touched: Sequence[Touched]
    named: Sequence[tuple[Estimate, Array]]  # estimated together, with the covariance of their sizes
    keys: Sequence[str]  # of candidates, as the table numbers them

    def number(self, candidate: Candidate) -> Sequence[int]:
        """The table's columns of a candidate."""
        return self.table.numbers[self.keys.index(candidate.key)]

    def score_drift(self, effect: Estimate, sd: Array) -> float:
        """Log Bayes factor of a named effect's changing in the course of recordings, beside itself.

        ``sd``: of what it changes by. Against a change by a share of itself, by which persons and models
        disagree with any size.
        """
        numbers = self.number(effect.candidate)
        explained = self.table.scale(self.none.levels) * self.table.explain(numbers, effect.size)
        courses = self.table.list_courses(explained)
        large, everyday = (
            [self.table.score_roughly(self.none, [numbers], [by], way)[0].bayes for way in courses]
            for by in (sd, OF_MOVEMENT * np.abs(effect.size))
        )
        return float(scipy.special.logsumexp(large) - scipy.special.logsumexp(everyday))

    @property
    def square(self) -> float:
        """Whitened sum of squares of all rows."""
        scale = self.table.scale(self.none.levels)
        return max(float(np.square(self.table.gap * scale).sum()), np.finfo(float).tiny)


def score_loads(
    fit: Fit,
    choice: Sequence[tuple[Candidate, Array]],
    named: Sequence[tuple[Estimate, Array]],
    misread: Sequence[tuple[Candidate, Array]] = (),
    *,
    mass_sd: float,
    weighed: bool,
    each: bool,
    touching: Sequence[Touch],
    touches: Callable[[Mapping[str, Array]], Sequence[Touch]],
) -> Loads:
    """Candidates of the wrench; those that are likely with all levels learnt beside them.

    Parameters
    ----------
    choice, named : sequence
        With the prior deviations of their numbers.
    misread : sequence
        Plates whose readings are off, as named ones are taken into account.
    mass_sd : float
        Of the body's mass, a share, where it is wrong; ``weighed``: whether it is known to be; ``each``:
        whether recordings disagree about it.
    touching : sequence of Touch
        Those that are named.
    touches : callable
        By what is ordinary of each component (6,) in each recording, those to be weighed.
    """
    every = [c for c, _ in (*choice, *((e.candidate, sd) for e, sd in named), *misread)]
    table, keys = WrenchTable(fit, every), [c.key for c in every]
    own = table.numbers[len(choice) :]  # of what is named, then of plates that misread
    for (effect, _), numbers in zip(named, own, strict=False):
        # the prior is about zero, not about the estimate
        table.add_back(numbers, effect.size)
    columns = table.expand([n for numbers in own for n in numbers])
    sd = np.concatenate([np.zeros(0), *(sd for _, sd in (*named, *misread))])
    whole = table.weigh_body(each=each)
    known = np.concatenate([columns * sd, whole * mass_sd], axis=1) if weighed else columns * sd
    nothing = np.zeros((len(columns), 0))
    none = table.weigh(whole * mass_sd if weighed else nothing, columns, sd, touching)
    places, sds = table.numbers[: len(choice)], [sd for _, sd in choice]
    scored = table.score_roughly(none, places, sds)
    for k in sorted(range(len(scored)), key=lambda k: -scored[k].bayes)[:_AGAIN]:
        one = table.weigh(known, table.expand(places[k]), sds[k], touching)
        bayes = one.value - none.value
        if choice[k][0].kind in EVERYBODYS:
            bayes -= table.score_livelier(none, places[k], 0.5 * sds[k])
        scored[k] = replace(scored[k], bayes=bayes, size=one.size, covariance=one.covariance)
    of_mass = table.weigh(known, whole, np.full(whole.shape[1], mass_sd), touching).value - none.value
    noise = measure_noise(table, np.minimum(none.levels, 1.0))
    tried = touches({item.name: row for item, row in zip(fit.wrenches, noise, strict=True)})

    def weigh_touches(chosen: Sequence[Touch]) -> Touched:
        value = table.weigh(known, nothing, np.zeros(0), [*touching, *chosen]).value - none.value
        lively = table.weigh_livelier(none, known, chosen, touching) - none.value if value > 0.0 else 0.0
        return Touched(value / len(chosen), (value - max(lively, 0.0)) / len(chosen), value)

    by_segment = {
        segment: weigh_touches([t for t in tried if t.segment == segment])
        for segment in dict.fromkeys(t.segment for t in tried)
    }
    of_touch = [max(weigh_touches([t]), by_segment[t.segment]) for t in tried]
    ends = np.cumsum([0, *map(len, own)]).tolist()
    estimated = [
        (Estimate(effect.candidate, none.size[a:b]), none.covariance[a:b, a:b])
        for (effect, _), a, b in zip(named, ends[:-1], ends[1:], strict=False)
    ]
    return Loads(
        table=table, none=none, scored=scored, mass=of_mass, touched=of_touch, named=estimated, keys=keys
    )
