"""The first question about forces: whether the declared mass is right.

The momentum balance answers it from the vertical forces of all recordings, whatever else is wrong with the
model. It is asked before the search, which would otherwise share the missing weight out among segments and
plates. Its answer is not fitted with the rest; it is asked again, without it, once all is named.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy

from scaling_service.capabilities.discovery.effects.catalogue import Effect
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate
from scaling_service.capabilities.discovery.evidence.statistics import Fitted, HeldOut
from scaling_service.capabilities.discovery.evidence.wrench import WRENCH
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate, Reweighed
from scaling_service.capabilities.dynamics.weight import BLOCK_S, Weight, split_into_blocks, weigh


def question_mass(fit: Fit, scored: Sequence[ScoredCandidate]) -> ScoredCandidate | None:
    """The declared mass as an effect, if the plates clearly contradict it and no other effect is the cause.

    Another one is, where it explains nearly all that the forces disagree by, and the mass leaves something of
    which it leaves clearly less: a load in the hand weighs as much as a heavier body, but its moments tell
    where it is; one in the trunk explains a heavier body as well, and is its class then. Where recordings
    disagree about the weight, each is taken with its own from then on: what plates miss in one of them is no
    load of the body.
    """
    weight = balance_weight(fit)
    if weight is None or not (weight.differs and weight.lasting):
        return None
    own = weight.by_trial if weight.disagree else {}
    factors = tuple((trial, kg / weight.declared_kg) for trial, kg in own.items())
    change = Reweighed(weight.factor, weight.sd_kg / weight.declared_kg, factors)
    note = ", ".join(f"{kg:.1f} kg in {trial}" for trial, kg in own.items())
    candidate = Candidate(kind="body_mass", where=("world",), columns=(), note=note, change=change)
    after = WRENCH.refit(fit, fit.free, (*fit.effects, Estimate(candidate, np.zeros(0))))
    gain = WRENCH.squares(fit) - WRENCH.squares(after)
    above, settings = WRENCH.above_noise(fit), fit.settings
    left = above - gain
    least = above - min((1.0 - settings.whole_cause) * above, settings.mass_left * left)
    loads = [one for one in scored if WRENCH.shows(one.candidate)]
    stands = left > settings.mass_stands * WRENCH.squares(after)
    if stands and any(one.fitted.gain > least for one in loads):
        return None
    chance = 2.0 * float(scipy.stats.norm.sf(abs(weight.factor - 1.0) / change.sd))
    nothing_held_out = HeldOut(float("nan"), float("nan"), folds=False)  # the balance took all recordings
    enough = above - settings.mass_alike * left
    as_good = () if weight.disagree else (one for one in loads if one.fitted.gain >= enough)
    alike = tuple(one.candidate for one in as_good if _is_weight_explained(one, fit))
    return ScoredCandidate(
        candidate=candidate,
        fitted=Fitted.of_any_course(gain, 0.0, chance),
        gains=None,
        held_out=nothing_held_out,
        equivalents=alike,
    )


def _is_weight_explained(one: ScoredCandidate, fit: Fit) -> bool:
    """Whether an effect of all recordings makes the declared mass right."""
    if one.candidate.trials or not one.candidate.columns:
        return False
    weight = balance_weight(
        WRENCH.refit(fit, fit.free, (*fit.effects, Estimate(one.candidate, one.fitted.size)))
    )
    return weight is not None and not weight.differs


def balance_weight(fit: Fit) -> Weight | None:
    """What the plates bear in all recordings with forces; None without any."""
    blocks = {}
    for item in fit.wrenches:
        borne, needed = (item.filter(wrench)[:, 1] for wrench in (item.measured, item.needed))
        spans = split_into_blocks(item.usable, item.times, BLOCK_S)
        blocks[item.name] = [(borne[rows], needed[rows]) for rows in spans]
    return weigh(fit.wrenches[0].mass, blocks) if blocks else None


def _find_factor(effect: Estimate, _after: Fit) -> Mapping[str, float]:
    assert isinstance(effect.candidate.change, Reweighed)
    return {"factor": effect.candidate.change.factor}


def _spread(effect: Estimate, _after: Fit) -> Mapping[str, float]:
    assert isinstance(effect.candidate.change, Reweighed)
    return {"factor": effect.candidate.change.sd}


EFFECTS = (
    Effect(
        kind="body_mass",
        meaning="the person is heavier or lighter than declared",
        question=question_mass,
        seen_in="wrench",
        details=_find_factor,
        spreads=_spread,
    ),
)
