"""How large a hidden thing must be for its recordings to name it, people being the yardstick.

Of the same person, movements and noise with nothing hidden, at the levels learnt there: the size of which the
expected log odds against everything ordinary are the bar. What is no sum of columns is weighed by the product
once, as large as the bank's largest.
"""

from __future__ import annotations

import math
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from scaling_service.capabilities.discovery.effects.catalogue import propose_candidates
from scaling_service.capabilities.discovery.effects.sizes import (
    is_met,
    list_usual_deviations,
    look_up_usual_sizes,
)
from scaling_service.capabilities.discovery.evidence.fit import Fit, SearchContext, fit_recordings
from scaling_service.capabilities.discovery.laws.candidates import Candidate
from scaling_service.capabilities.discovery.options import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.discovery.ordinary.forces import WrenchTable
from scaling_service.capabilities.discovery.ordinary.loads import EVERYBODYS
from scaling_service.capabilities.discovery.run import USUAL
from scaling_service.capabilities.discovery.search.forces import Search
from scaling_service.capabilities.discovery.search.markers import BodyTable
from scaling_service.capabilities.discovery.search.naming import Origin
from scaling_service.capabilities.discovery.start import prepare
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.core.progress import Steps, show_nothing
from tests.blind.body import Array
from tests.blind.effects.wobbling_mass import DAMPING
from tests.blind.hidden import Effect, Hidden

LEAST, MOST = 2.0, 4.0
"""Times the smallest nameable size that cases are drawn from, as far as laboratories meet it."""

_GROWTH = {"marker_swap": 1.0, "skin_wobble": 4.0, "missing_dof": 2.0, "external_contact": 2.0}
"""Power of the size with which log odds grow: frames; the square of an amplitude that falls with the square
of the frequency; squares."""

_SEARCHED = np.geomspace(64.0, 0.5, 22)
"""Sizes among which the smallest is sought, of the bank's small one: a quarter apart, the largest first."""

_LONGEST_SWAP_S = 2.5  # so that it ends within the trial

Write = Callable[[tuple[Hidden, ...], Path], Path]
"""Writes a case with these things hidden into a folder, as the bank does; the subject's file."""


def find_range(effect: Effect, draw: Callable[[float], Hidden], write: Write) -> tuple[float, float] | None:
    """Sizes from twice to four times the smallest nameable, as far as they are met; None where twice is not.

    ``draw``: the same thing, that large.
    """
    smallest = (_weigh_once if effect.kind in _GROWTH else _solve)(effect, draw, write)
    step = 1.0 if effect.kind not in _GROWTH else 2.0 / _GROWTH[effect.kind]  # of evidence as of amplitudes
    if not math.isfinite(smallest.size):
        return None
    low, high = (smallest.size * times**step for times in (LEAST, MOST))
    met = [size for size in np.geomspace(low, high, 9).tolist() if smallest.is_met(draw(size))]
    return (low, max(met)) if met and met[0] == low else None


class _Smallest:
    """The smallest size that is nameable, and which sizes laboratories meet."""

    def __init__(self, size: float, fit: Fit, candidate: Candidate) -> None:
        self.size, self.fit, self.candidate = size, fit, candidate

    def is_met(self, thing: Hidden) -> bool:
        """Whether laboratories meet something that large."""
        parameters, model = thing.parameters, self.fit.model
        if thing.kind == "marker_swap":
            return parameters["end_s"] - parameters["start_s"] <= _LONGEST_SWAP_S
        if self.candidate.columns:
            size = _list_numbers(thing, self.candidate)
            together = self.candidate.together is None or self.candidate.together(size)
            return is_met(self.candidate, size, model) and together
        usual = look_up_usual_sizes(self.candidate, model)
        ranges = ((usual(name), value) for name, value in parameters.items())
        return all(r is None or r.low <= value <= r.high for r, value in ranges)


def _solve(effect: Effect, draw: Callable[[float], Hidden], write: Write) -> _Smallest:
    """Of what is a sum of columns: added to what nothing is hidden in, until it has the odds."""
    fit, thing = _open((), write).fit, draw(unit := effect.sizes[0])
    every = [c for c in propose_candidates(fit.scene, {effect.kind}) if _is_of(c, thing)]
    candidate = min(every, key=_how_far(thing))
    weigh = (_weigh_load if effect.needs == "forces" else _weigh_body)(fit, candidate)
    numbers = _list_numbers(thing, candidate) / unit
    return _Smallest(_find_crossing(lambda size: weigh(size * numbers), unit), fit, candidate)


def _find_crossing(weigh: Callable[[float], float], unit: float) -> float:
    """The size from which on the log odds reach the bar; infinite where no size sought does."""
    above = (math.inf, math.inf)
    for size in (unit * _SEARCHED).tolist():
        odds = weigh(size)
        if odds < USUAL.odds:
            share = (USUAL.odds - odds) / (above[1] - odds)  # of the way, in the logarithm of the size
            return size * (above[0] / size) ** share if math.isfinite(above[0]) else math.inf
        above = size, odds
    return above[0]


def _weigh_body(fit: Fit, candidate: Candidate) -> Callable[[Array], float]:
    """Log odds of a candidate of the body by how large it is (SI)."""
    body = BodyTable.of(fit, given=True, placed=True)
    own = next(c for c, _ in body.candidates if c.key == candidate.key)
    places = Counter(c.kind for c, _ in body.candidates)[candidate.kind]

    def weigh(size: Array) -> float:
        moved = body.base.expand(own) @ size
        sums = [
            replace(
                s,
                scores=s.scores + s.products @ moved,
                square=s.square + float(moved @ (2.0 * s.scores + s.products @ moved)),
            )
            for s in body.table.sums
        ]
        return replace(body, table=replace(body.table, sums=sums)).weigh(own, places).odds

    return weigh


def _weigh_load(fit: Fit, candidate: Candidate) -> Callable[[Array], float]:
    """The same of the wrench."""
    table, sd = WrenchTable(fit, [candidate]), list_usual_deviations(candidate, fit.model)
    places = sum(c.kind == candidate.kind for c in propose_candidates(fit.scene, {candidate.kind}))
    gap, (own,) = table.gap, table.numbers
    nothing = np.zeros((table.columns.shape[2], 0))
    assert sd is not None

    def weigh(size: Array) -> float:
        table.gap = gap + table.explain(own, size)
        none = table.weigh(nothing, nothing, np.zeros(0))
        odds = table.weigh(nothing, table.expand(own), sd).value - none.value - math.log(places)
        return odds - (table.score_livelier(none, own, 0.5 * sd) if candidate.kind in EVERYBODYS else 0.0)

    return weigh


def _weigh_once(effect: Effect, draw: Callable[[float], Hidden], write: Write) -> _Smallest:
    """From the log odds of what is there, as large as the bank's largest, and of where nothing is."""
    thing, odds = draw(effect.sizes[2]), []
    for hidden in ((thing,), ()):
        search = _open(hidden, write)
        if effect.kind == "marker_swap":
            search.find_labels()
            ranked = list(search.named)
        elif effect.needs == "forces":
            ranked = search._rank_forces()[1]
        else:
            ranked = BodyTable.of(search.fit, given=True, placed=True).rank()
        own = [r for r in ranked if _is_of(r.candidate, thing)]
        odds.append(max((r.odds for r in own), default=0.0))
        candidate = own[0].candidate if own else Candidate(effect.kind, thing.where, ())
    there, none = odds
    share = (USUAL.odds - none) / max(there - none, 1e-9)
    return _Smallest(effect.sizes[2] * share ** (1.0 / _GROWTH[effect.kind]), search.fit, candidate)


def _open(hidden: tuple[Hidden, ...], write: Write) -> Search:
    """The product's search before it has named anything."""
    with tempfile.TemporaryDirectory() as folder:
        loaded = open_subject(write(hidden, Path(folder)), AS_MEASURED, facing=True)
        prepared = prepare(loaded, DiscoverSettings(start="none"), AS_MEASURED)
    context = SearchContext(model=prepared.model, recordings=prepared.recordings, settings=USUAL)
    origin = Origin(given=True, declared_kg=prepared.subject.mass_kg)
    return Search(fit=fit_recordings(context), origin=origin, steps=Steps(report=show_nothing))


def _is_of(candidate: Candidate, thing: Hidden) -> bool:
    alike = candidate.kind == thing.kind and set(candidate.where) == set(thing.where)
    if thing.kind in _GROWTH:
        return alike
    return alike and candidate.driver == thing.driver and not candidate.trials


def _how_far(thing: Hidden) -> Callable[[Candidate], float]:
    """How much a candidate's form differs from a thing's: what swings at another frequency, other columns."""

    def measure(candidate: Candidate) -> float:
        if candidate.oscillation is not None:
            frequency, damping = candidate.oscillation
            apart = abs(math.log(frequency / thing.parameters["frequency_hz"]))
            return apart + abs(math.log(damping / DAMPING))
        lacking = [c for c in candidate.columns if c.name not in thing.parameters]
        return float(len(lacking))

    return measure


def _list_numbers(thing: Hidden, candidate: Candidate) -> Array:
    """A hidden thing as a candidate's numbers (SI)."""
    told = dict(thing.parameters)
    told |= {f"{a}_kgmm": told["kg"] * told[f"{a}_mm"] for a in "xyz" if {"kg", f"{a}_mm"} <= set(told)}
    return np.array([(told[c.name] - c.neutral) / c.unit for c in candidate.columns])
