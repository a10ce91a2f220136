"""All named effects and everything that was free before, estimated together.

Variable projection (Golub & Pereyra 1973, SIAM J Numer Anal 10:413): the motion is solved anew for every
value of the shared numbers, whose steps come from columns that the pose cannot hide. A step that makes the
disagreement larger is shortened, and not taken where no part of it helps.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.markers import MARKERS
from scaling_service.capabilities.discovery.evidence.observation import Observation
from scaling_service.capabilities.discovery.evidence.sums import (
    Evidence,
    invert_curvature,
    select_fitting_blocks,
)
from scaling_service.capabilities.discovery.evidence.wrench import OBSERVATIONS, WRENCH
from scaling_service.capabilities.discovery.laws.candidates import (
    Candidate,
    Estimate,
    step_shape,
    with_shape_columns,
)
from scaling_service.numerics.multibody.laws import Array

_ROUNDS = 8
_SHARES = (1.0, 0.5, 0.25)  # of a step, tried in turn
SETTLED, ROUGHLY, SOON = 1e-4, 3e-3, 1e-2
"""Shares of the cost (chosen). The next step of a method that doubles its digits is far smaller than the one
that gained so little; roughly is enough to compare effects, not to tell their numbers, and soon to tell what
is left to the hundredth. Where numbers are not reported, a step that took off what it promised, to that
share, was the last: it led where it was to lead."""

_WORTH = 0.1
"""Share of what ends the rounds that a step must promise, where numbers are not reported (chosen)."""


def estimate(
    start: Fit,
    added: Sequence[Estimate] = (),
    tolerance: float = SETTLED,
    *,
    observations: Sequence[Observation[Any]] = OBSERVATIONS,
    hopeless: Callable[[Fit], object] = lambda _: False,
) -> Fit:
    """Estimate what is free and the effects, with some more of them, on the recordings that are to fit.

    Parameters
    ----------
    tolerance : float
        Share of the cost below which a round's gain ends the rounds.
    observations : sequence of Observation
        Those in which something has changed: the motion does not follow from forces.
    hopeless : callable
        Whether a fit need not be brought to its end; it is returned as it is.
    """
    fit = observations[0].refit(start, start.free, (*start.effects, *added))
    if _compute_fit_misfit(MARKERS, fit, fit) > _compute_fit_misfit(MARKERS, start, fit):
        unsized = [replace(s, size=0.0 * s.size) if MARKERS.shows(s.candidate) else s for s in added]
        fit = MARKERS.refit(start, start.free, (*start.effects, *unsized))
    for observation in observations:
        fit = _settle(fit, observation, tolerance, hopeless)
    return fit


def remove(fit: Fit, effects: Sequence[Estimate]) -> Fit:
    """Everything else estimated to the hundredth, with some of the effects taken back."""
    bare = fit.without({effect.candidate.key for effect in effects})
    return estimate(bare, (), SOON, observations=select_observations(effects))


def select_observations(effects: Sequence[Estimate]) -> tuple[Observation[Any], ...]:
    """Those in which something changes with some effects."""
    forces_only = all(WRENCH.shows(effect.candidate) for effect in effects)
    return (WRENCH,) if forces_only else OBSERVATIONS


def refit_without(fit: Fit, keys: Collection[str]) -> Fit:
    """Refitted without the effects of some keys, all others as they are."""
    gone = [e for e in fit.effects if e.candidate.key in keys]
    return select_observations(gone)[0].refit(fit, fit.free, fit.without(keys).effects)


def compute_misfit(fit: Fit) -> float:
    """Whitened squares of markers and forces in the trials that decide."""
    return _compute_fit_misfit(MARKERS, fit, fit) + _compute_fit_misfit(WRENCH, fit, fit)


def _compute_fit_misfit(observation: Observation[Any], fit: Fit, of: Fit) -> float:
    """Whitened squares of the trials that decide for a fit: those to fit, those with own effects."""
    return observation.squares(fit, [e.candidate for e in of.effects])


def _settle(
    fit: Fit, observation: Observation[Any], tolerance: float, hopeless: Callable[[Fit], object]
) -> Fit:
    """Everything that shows in an observation, estimated until little is gained."""
    reached = _compute_fit_misfit(observation, fit, fit)
    for _round in range(_ROUNDS):
        if hopeless(fit):
            break
        before = reached
        least = _WORTH * tolerance * before if tolerance > SETTLED else 0.0
        fit, gain, missed = _take_step(fit, observation, least)
        reached = _compute_fit_misfit(observation, fit, fit)
        kept = tolerance > SETTLED and missed < tolerance * before
        if kept or gain < tolerance * before:
            break
    return fit


def _take_step(fit: Fit, observation: Observation[Any], least: float) -> tuple[Fit, float, float]:
    """One step of everything shared that shows in an observation, if it promises enough.

    Also what it takes off the squares, and by how much that differs from what it promises; less what it takes
    off by chance: steps are corrected for that, too, and would seem to make the fit worse.
    """
    moving = observation.list_known(fit)
    if not moving:
        return fit, 0.0, 0.0
    chosen = [with_shape_columns(s) for s in moving]
    items, block_s = observation.items(fit), fit.settings.block_s
    evidence = observation.gather(items, [], chosen, block_s, together=True, known=moving)
    sums = _Sums.of(evidence, chosen)
    step = sums.best_step(evidence)
    promised = float(step @ sums.score)
    if promised < least:
        return fit, 0.0, promised
    before = _compute_fit_misfit(observation, fit, fit)
    for share in _SHARES:
        pairs = zip(moving, evidence.groups, strict=True)
        sized = {id(s): step_shape(s, share * step[rows]) for s, rows in pairs}
        free, effects = (tuple(sized.get(id(s), s) for s in some) for some in (fit.free, fit.effects))
        tried = observation.refit(fit, free, effects)
        gain = (
            before - _compute_fit_misfit(observation, tried, tried) - sums.compute_chance_gain(share * step)
        )
        if gain > 0.0:
            return tried, gain, abs(promised - gain)
    return fit, 0.0, promised


class _Sums(NamedTuple):
    """Products and scores of all columns in the blocks that decide, and those that noise alone makes."""

    curvature: Array  # (k, k)
    score: Array  # (k,)
    stray_curvature: Array
    stray_score: Array

    @classmethod
    def of(cls, evidence: Evidence, chosen: Sequence[Candidate]) -> _Sums:
        """Of blocks in which the candidates are fitted."""
        decided = {c.trials: {id(s) for s in select_fitting_blocks(evidence.blocks, c)} for c in chosen}
        owners = [c.trials for c in chosen for _ in c.columns]
        count = len(owners)
        curvature, score, stray_curvature, stray_score = (
            np.zeros(shape) for shape in 2 * ((count, count), (count,))
        )
        for block in evidence.blocks:
            counts = np.array([id(block) in decided[trials] for trials in owners], dtype=float)
            both = np.outer(counts, counts)
            curvature += block.own * both
            score += block.scores * counts
            if block.chance is not None:
                stray_score += block.chance[0] * counts
                stray_curvature += block.chance[1] * both
        return cls(curvature, score, stray_curvature, stray_score)

    def best_step(self, evidence: Evidence) -> Array:
        """Where everything fits best to first order."""
        return np.asarray(invert_curvature(self.curvature, evidence.raw)[0] @ self.score)

    def compute_chance_gain(self, step: Array) -> float:
        """What a step takes off the squares that noise alone makes."""
        return float(2.0 * step @ self.stray_score - step @ self.stray_curvature @ step)
