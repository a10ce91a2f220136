"""All named effects and everything that was free before, estimated together.

Variable projection (Golub & Pereyra 1973, SIAM J Numer Anal 10:413): the motion is solved anew for every
value of the shared numbers, whose steps come from columns that the pose cannot hide. A step that makes the
disagreement larger is shortened, and not taken where no part of it helps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from scaling_service.capabilities.discovery.evidence.fitting import (
    Account,
    Recording,
    account,
    reweighed,
    scene_of,
    squares,
)
from scaling_service.capabilities.discovery.evidence.forces import gather_forces
from scaling_service.capabilities.discovery.evidence.score import Evidence, deciding, gather
from scaling_service.capabilities.discovery.evidence.spots import JointSpot
from scaling_service.capabilities.discovery.laws.additions import Sized, freedom_name
from scaling_service.capabilities.discovery.laws.profiles import Following
from scaling_service.capabilities.discovery.laws.swings import shaped, stepped
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column, FreeMotion, Part
from scaling_service.capabilities.discovery.search.judging import inverse_of
from scaling_service.model.body import Vector
from scaling_service.numerics.multibody.laws import Array

_ROUNDS = 8
_SHARES = (1.0, 0.5, 0.25)  # of a step, tried in turn
_OWN = 0.05  # of the largest curvature; chosen: a direction that shows less is the joint's own
_SAME = np.cos(np.radians(0.2))  # chosen: a turn by less is below any axis's own deviation

SETTLED, ROUGHLY, SOON = 1e-4, 3e-3, 1e-2
"""Shares of the cost (chosen). The next step of a method that doubles its digits is far smaller than the one
that gained so little; roughly is enough to compare effects, not to tell their numbers, and soon to tell what
is left to the hundredth. Where numbers are not told, a step that took off what it promised, to that share,
was the last: it led where it was to lead."""

_WORTH = 0.1
"""Share of what ends the rounds that a step must promise, where numbers are not told (chosen)."""


def refined(
    start: Account,
    recordings: Sequence[Recording],
    added: Sequence[Sized],
    stretch_s: float,
    settled: float = SETTLED,
    *,
    of_forces: bool = False,
    hopeless: Callable[[Account], object] = lambda _: False,
) -> Account:
    """Estimate what is free and the effects, with some more of them, on the recordings that are to fit.

    Parameters
    ----------
    settled : float
        Share of the cost below which a round's gain ends the rounds.
    of_forces : bool
        Whether only what shows in the forces has changed: the motion does not follow from forces and stays.
    hopeless : callable
        Whether an account need not be brought to its end; it is returned as it is.
    """
    if of_forces:
        now = reweighed(replace(start, effects=(*start.effects, *added)), recordings)
    else:
        now = account(start.model, recordings, start.free, (*start.effects, *added), start)
    if _misfit(now, now, of_forces=False) > _misfit(start, now, of_forces=False):
        unsized = [s if s.candidate.of_forces else replace(s, size=0.0 * s.size) for s in added]
        now = account(start.model, recordings, start.free, (*start.effects, *unsized), start)
    for sort in (True,) if of_forces else (False, True):  # forces have no part in the motion: it comes first
        now = _settled(now, recordings, stretch_s, settled, hopeless, of_forces=sort)
    return now


def _settled(
    now: Account,
    recordings: Sequence[Recording],
    stretch_s: float,
    settled: float,
    hopeless: Callable[[Account], object],
    *,
    of_forces: bool,
) -> Account:
    """Everything that shows among the markers, or in the forces, estimated until little is gained."""
    reached = _misfit(now, now, of_forces=of_forces)
    for _round in range(_ROUNDS):
        if hopeless(now):
            break
        before = reached
        least = _WORTH * settled * before if settled > SETTLED else 0.0
        moved, missed = _stepped(now, recordings, stretch_s, least, of_forces=of_forces)
        now = moved if of_forces else _aligned(moved, recordings, stretch_s)
        turned = now is not moved
        reached = _misfit(now, now, of_forces=of_forces)
        kept = settled > SETTLED and not turned and missed < settled * before
        if kept or before - reached < settled * before:
            break
    return now


def taken_back(
    gone: Sequence[Sized], now: Account, recordings: Sequence[Recording], stretch_s: float
) -> Account:
    """Everything else estimated to the hundredth, with some of the effects taken back."""
    keys = {effect.candidate.key for effect in gone}
    bare = replace(now, effects=tuple(e for e in now.effects if e.candidate.key not in keys))
    of_forces = all(effect.candidate.of_forces for effect in gone)
    return refined(bare, recordings, [], stretch_s, SOON, of_forces=of_forces)


def _misfit(now: Account, of: Account, *, of_forces: bool) -> float:
    """Whitened squares of the trials that decide for an account: those to fit, those with own effects."""
    return squares(now, of_forces=of_forces, of=[e.candidate for e in of.effects])


def misfit(now: Account) -> float:
    """Whitened squares of markers and forces in the trials that decide."""
    return _misfit(now, now, of_forces=False) + _misfit(now, now, of_forces=True)


def _stepped(
    now: Account, recordings: Sequence[Recording], stretch_s: float, least: float, *, of_forces: bool
) -> tuple[Account, float]:
    """One step of everything shared that shows among the markers, or in the forces, if it promises enough.

    And by how much what it takes off differs from what it promises.
    """
    moving = [s for s in now.everything if s.candidate.columns and s.candidate.of_forces == of_forces]
    if not moving:
        return now, 0.0
    scene = scene_of(now)
    chosen = [shaped(s, scene) for s in moving]
    if of_forces:
        evidence = gather_forces(now.weighed, [], chosen, stretch_s, together=True)
    else:
        evidence = gather(now.watched, [], chosen, stretch_s, together=True)
    step, promised = _step(evidence, chosen)
    if promised < least:
        return now, promised
    before = _misfit(now, now, of_forces=of_forces)
    for share in _SHARES:
        sized = {
            id(s): stepped(s, scene, share * step[rows])
            for s, rows in zip(moving, evidence.groups, strict=True)
        }
        free = tuple(sized.get(id(s), s) for s in now.free)
        effects = tuple(sized.get(id(s), s) for s in now.effects)
        if of_forces:
            tried = reweighed(replace(now, free=free, effects=effects), recordings)
        else:
            tried = account(now.model, recordings, free, effects, now)
        left = _misfit(tried, tried, of_forces=of_forces)
        if left < before:
            return tried, abs(promised - (before - left))
    return now, promised


def _step(evidence: Evidence, chosen: Sequence[Candidate]) -> tuple[Array, float]:
    """Where everything fits best to first order, and what that takes off the squares."""
    decided = {c.trials: {id(s) for s in deciding(evidence.stretches, c)} for c in chosen}
    owners = [c.trials for c in chosen for _ in c.columns]
    curvature, score = np.zeros((len(owners),) * 2), np.zeros(len(owners))
    for stretch in evidence.stretches:
        counts = np.array([id(stretch) in decided[trials] for trials in owners], dtype=float)
        curvature += stretch.own * np.outer(counts, counts)
        score += stretch.scores * counts
    step = np.asarray(inverse_of(curvature, evidence.raw)[0] @ score)
    return step, float(step @ score)


def _aligned(now: Account, recordings: Sequence[Recording], stretch_s: float) -> Account:
    """Axes of free motions turned to where their residuals want them, if that helps.

    A turn by the angle a about u + d is, for small d, the turn about u and one by a about d.
    """
    turned = now
    for effect in now.effects:
        free = effect.candidate.change
        if isinstance(free, FreeMotion):
            axis = _better_axis(turned, effect.candidate, free, stretch_s)
            if np.dot(axis, free.axis) > _SAME:
                continue
            candidate = replace(effect.candidate, change=replace(free, axis=axis))
            other = replace(effect, candidate=candidate)
            turned = replace(turned, effects=tuple(other if e is effect else e for e in turned.effects))
    if turned is now:
        return now
    turned = account(now.model, recordings, now.free, turned.effects, now)
    return turned if _misfit(turned, turned, of_forces=False) < _misfit(now, now, of_forces=False) else now


def _better_axis(now: Account, candidate: Candidate, free: FreeMotion, stretch_s: float) -> Vector:
    course = Following(freedom_name(candidate))
    parts = [Part(JointSpot(free.segment, free.at, free.kind, k), course) for k in range(3)]
    columns = tuple(Column(f"axis_{k}", 1.0, (part,)) for k, part in enumerate(parts))
    evidence = gather(
        now.watched, [], [replace(candidate, columns=columns, change=None)], stretch_s, together=True
    )
    fitting = [s for s in evidence.stretches if s.role == "fit"]
    curvature, score = np.sum([s.own for s in fitting], axis=0), np.sum([s.scores for s in fitting], axis=0)
    step = inverse_of(curvature, evidence.raw)[0] @ score
    axis = np.array(free.axis) + step - np.array(free.axis) * float(step @ np.array(free.axis))
    value, vector = np.linalg.eigh(curvature)
    hidden = vector[:, value < _OWN * value[-1]]  # turns that the joint makes anyhow
    axis = axis - hidden @ (hidden.T @ axis)
    x, y, z = (float(v) for v in axis / np.linalg.norm(axis))
    return (x, y, z)
