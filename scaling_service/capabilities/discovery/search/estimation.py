"""All named effects and everything that was free before, estimated together.

Variable projection (Golub & Pereyra 1973, SIAM J Numer Anal 10:413): the motion is solved anew for every
value of the shared numbers, whose steps come from columns that the pose cannot hide. A step that makes the
disagreement larger is shortened, and not taken where no part of it helps.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.markers import MARKERS
from scaling_service.capabilities.discovery.evidence.observation import Observation
from scaling_service.capabilities.discovery.evidence.sums import Evidence, fitting_blocks, inverse_of
from scaling_service.capabilities.discovery.evidence.wrench import OBSERVATIONS, WRENCH
from scaling_service.capabilities.discovery.laws.apply import freedom_name
from scaling_service.capabilities.discovery.laws.candidates import (
    Candidate,
    Column,
    Estimate,
    FreeMotion,
    Part,
    stepped,
    with_shape_columns,
)
from scaling_service.capabilities.discovery.laws.profiles import Following
from scaling_service.capabilities.discovery.laws.spots import JointSpot
from scaling_service.model.body import Vector
from scaling_service.numerics.multibody.laws import Array

_ROUNDS = 8
_SHARES = (1.0, 0.5, 0.25)  # of a step, tried in turn
_OWN = 0.05  # of the largest curvature; chosen: a direction that shows less is the joint's own
_SAME = np.cos(np.radians(0.2))  # chosen: a turn by less is below any axis's own deviation
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
    if _misfit(MARKERS, fit, fit) > _misfit(MARKERS, start, fit):
        unsized = [replace(s, size=0.0 * s.size) if MARKERS.shows(s.candidate) else s for s in added]
        fit = MARKERS.refit(start, start.free, (*start.effects, *unsized))
    for observation in observations:
        fit = _settle(fit, observation, tolerance, hopeless)
    return fit


def remove(fit: Fit, effects: Sequence[Estimate]) -> Fit:
    """Everything else estimated to the hundredth, with some of the effects taken back."""
    bare = fit.without({effect.candidate.key for effect in effects})
    return estimate(bare, (), SOON, observations=observations_of(effects))


def observations_of(effects: Sequence[Estimate]) -> tuple[Observation[Any], ...]:
    """Those in which something changes with some effects."""
    forces_only = all(WRENCH.shows(effect.candidate) for effect in effects)
    return (WRENCH,) if forces_only else OBSERVATIONS


def refit_without(fit: Fit, keys: Collection[str]) -> Fit:
    """Refitted without the effects of some keys, all others as they are."""
    gone = [e for e in fit.effects if e.candidate.key in keys]
    return observations_of(gone)[0].refit(fit, fit.free, fit.without(keys).effects)


def misfit(fit: Fit) -> float:
    """Whitened squares of markers and forces in the trials that decide."""
    return _misfit(MARKERS, fit, fit) + _misfit(WRENCH, fit, fit)


def _misfit(observation: Observation[Any], fit: Fit, of: Fit) -> float:
    """Whitened squares of the trials that decide for a fit: those to fit, those with own effects."""
    return observation.squares(fit, [e.candidate for e in of.effects])


def _settle(
    fit: Fit, observation: Observation[Any], tolerance: float, hopeless: Callable[[Fit], object]
) -> Fit:
    """Everything that shows in an observation, estimated until little is gained."""
    reached = _misfit(observation, fit, fit)
    for _round in range(_ROUNDS):
        if hopeless(fit):
            break
        before = reached
        least = _WORTH * tolerance * before if tolerance > SETTLED else 0.0
        moved, missed = _step(fit, observation, least)
        fit = _aligned(moved) if observation is MARKERS else moved
        turned = fit is not moved
        reached = _misfit(observation, fit, fit)
        kept = tolerance > SETTLED and not turned and missed < tolerance * before
        if kept or before - reached < tolerance * before:
            break
    return fit


def _step(fit: Fit, observation: Observation[Any], least: float) -> tuple[Fit, float]:
    """One step of everything shared that shows in an observation, if it promises enough.

    And by how much what it takes off differs from what it promises.
    """
    moving = observation.known(fit)
    if not moving:
        return fit, 0.0
    chosen = [with_shape_columns(s) for s in moving]
    items, block_s = observation.items(fit), fit.settings.block_s
    evidence = observation.gather(items, [], chosen, block_s, together=True)
    step, promised = _best_step(evidence, chosen)
    if promised < least:
        return fit, promised
    before = _misfit(observation, fit, fit)
    for share in _SHARES:
        pairs = zip(moving, evidence.groups, strict=True)
        sized = {id(s): stepped(s, share * step[rows]) for s, rows in pairs}
        free, effects = (tuple(sized.get(id(s), s) for s in some) for some in (fit.free, fit.effects))
        tried = observation.refit(fit, free, effects)
        left = _misfit(observation, tried, tried)
        if left < before:
            return tried, abs(promised - (before - left))
    return fit, promised


def _best_step(evidence: Evidence, chosen: Sequence[Candidate]) -> tuple[Array, float]:
    """Where everything fits best to first order, and what that takes off the squares."""
    decided = {c.trials: {id(s) for s in fitting_blocks(evidence.blocks, c)} for c in chosen}
    owners = [c.trials for c in chosen for _ in c.columns]
    curvature, score = np.zeros((len(owners),) * 2), np.zeros(len(owners))
    for block in evidence.blocks:
        counts = np.array([id(block) in decided[trials] for trials in owners], dtype=float)
        curvature += block.own * np.outer(counts, counts)
        score += block.scores * counts
    step = np.asarray(inverse_of(curvature, evidence.raw)[0] @ score)
    return step, float(step @ score)


def _aligned(fit: Fit) -> Fit:
    """Axes of free motions turned to where their residuals want them, if that helps.

    A turn by the angle a about u + d is, for small d, the turn about u and one by a about d.
    """
    effects = list(fit.effects)
    for k, effect in enumerate(effects):
        free = effect.candidate.change
        if isinstance(free, FreeMotion):
            axis = _better_axis(fit, effect.candidate, free)
            if np.dot(axis, free.axis) <= _SAME:
                candidate = replace(effect.candidate, change=replace(free, axis=axis))
                effects[k] = replace(effect, candidate=candidate)
    if all(one is other for one, other in zip(effects, fit.effects, strict=True)):
        return fit
    turned = MARKERS.refit(fit, fit.free, effects)
    return turned if _misfit(MARKERS, turned, turned) < _misfit(MARKERS, fit, fit) else fit


def _better_axis(fit: Fit, candidate: Candidate, free: FreeMotion) -> Vector:
    course = Following(freedom_name(candidate))
    parts = [Part(JointSpot(free.segment, free.at, free.kind, k), course) for k in range(3)]
    columns = tuple(Column(f"axis_{k}", 1.0, (part,)) for k, part in enumerate(parts))
    turn = replace(candidate, columns=columns, change=None)
    evidence = MARKERS.gather(fit.tracked, [], [turn], fit.settings.block_s, together=True)
    fitting = [s for s in evidence.blocks if s.role == "fit"]
    curvature, score = np.sum([s.own for s in fitting], axis=0), np.sum([s.scores for s in fitting], axis=0)
    step = inverse_of(curvature, evidence.raw)[0] @ score
    axis = np.array(free.axis) + step - np.array(free.axis) * float(step @ np.array(free.axis))
    value, vector = np.linalg.eigh(curvature)
    hidden = vector[:, value < _OWN * value[-1]]  # turns that the joint makes anyhow
    axis = axis - hidden @ (hidden.T @ axis)
    x, y, z = (float(v) for v in axis / np.linalg.norm(axis))
    return (x, y, z)
