"""All named effects and everything that was free before, estimated together.

Variable projection (Golub & Pereyra 1973, SIAM J Numer Anal 10:413): the motion is solved anew for every
value of the shared numbers, whose steps come from columns that the pose cannot hide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scaling_service.discovery.additions import Sized, corrected, freedom_name, still, with_effects
from scaling_service.discovery.candidates import Candidate, Column, Contact, FreeMotion, Part
from scaling_service.discovery.contacts import wrench_of
from scaling_service.discovery.evidence import Evidence, gather
from scaling_service.discovery.forces import gather_forces, weigh
from scaling_service.discovery.judging import inverse_of
from scaling_service.discovery.profiles import Following
from scaling_service.discovery.spots import At, JointSpot
from scaling_service.discovery.watched import Role, Watched
from scaling_service.discovery.weighed import Footing, Weighed
from scaling_service.models.body import BodyModel, Vector
from scaling_service.models.trial import Trial

_ROUNDS = 8
_OWN = 0.05  # of the largest curvature; chosen: a direction that shows less is the joint's own
_SETTLED = 1e-4  # of the cost, chosen: steps below are far smaller than a parameter's own deviation


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A trial, what it is for, and the ground's forces in it."""

    trial: Trial
    role: Role
    footing: Footing | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Account:
    """What is assumed of the body and the recordings, and how well it follows them.

    Parameters
    ----------
    model : BodyModel
        What the search started from.
    free : tuple of Sized
        What may take any value beside the effects: the calibration's own parameters.
    effects : tuple of Sized
    watched : tuple of Watched
        The recordings, followed with all of these.
    weighed : tuple of Weighed
        Those of them with forces.
    """

    model: BodyModel
    free: tuple[Sized, ...]
    effects: tuple[Sized, ...]
    watched: tuple[Watched, ...]
    weighed: tuple[Weighed, ...] = ()

    @property
    def everything(self) -> tuple[Sized, ...]:
        """What is free and the effects."""
        return self.free + self.effects

    def model_in(self, trial: str) -> BodyModel:
        """The model as it is in one trial."""
        return with_effects(self.model, self.everything, trial)


def account(
    model: BodyModel,
    recordings: Sequence[Recording],
    free: Sequence[Sized] = (),
    effects: Sequence[Sized] = (),
    starts: Account | None = None,
) -> Account:
    """Follow the recordings with a model to which effects of known size are added."""
    near = {item.name: item for item in starts.watched} if starts else {}
    floors = {item.name: item.floor for item in starts.weighed} if starts else {}
    both = (*free, *effects)
    watched, weighed = [], []
    for recording in recordings:
        trial = corrected(recording.trial, both)
        known = with_effects(model, both, trial.name)
        item = Watched.of(known, trial, recording.role, near.get(trial.name))
        rested = still(item, both)
        if rested is not trial:
            item = Watched.of(known, rested, recording.role, item)
        watched.append(item)
        if recording.footing is not None:
            made = _weighed(item, known, recording.footing, both)
            weighed.append(replace(made, known_floor=floors.get(item.name)))
    return Account(model, tuple(free), tuple(effects), tuple(watched), tuple(weighed))


def _weighed(item: Watched, known: BodyModel, footing: Footing, effects: Sequence[Sized]) -> Weighed:
    made = weigh(item, known, footing, effects)
    for effect in effects:
        contact = effect.candidate.change
        if isinstance(contact, Contact) and effect.candidate.trial in (None, item.name):
            before = np.zeros((len(item.q), 6)) if made.touched is None else made.touched
            made = replace(made, touched=before + wrench_of(made, contact))
    return made


def refined(
    start: Account, recordings: Sequence[Recording], added: Sequence[Sized], stretch_s: float
) -> Account:
    """Estimate what is free and the effects, with some more of them, on the recordings that are to fit."""
    now = account(start.model, recordings, start.free, (*start.effects, *added), start)
    best = _concerned(now)
    for _round in range(_ROUNDS):
        trial = _stepped(now, recordings, stretch_s)
        if any(isinstance(e.candidate.change, FreeMotion) for e in trial.effects):
            trial = _aligned(trial, recordings, stretch_s)
        reached = _concerned(trial)
        if reached >= best:
            break
        now, best, before = trial, reached, best
        if before - best < _SETTLED * before:
            break
    return now


def cost(now: Account, *, role: Role = "fit") -> float:
    """Whitened sum of squares of the recordings of a role, markers and wrenches."""
    markers = sum(item.square for item in now.watched if item.role == role)
    return float(markers + sum(item.square for item in now.weighed if item.role == role))


def _concerned(now: Account) -> float:
    """Whitened squares of the trials that decide: those to fit, and those with effects of their own."""
    alone = {e.candidate.trial for e in now.effects}
    items: list[Watched | Weighed] = [*now.watched, *now.weighed]
    return float(sum(item.square for item in items if item.role == "fit" or item.name in alone))


def _stepped(now: Account, recordings: Sequence[Recording], stretch_s: float) -> Account:
    """One step of everything that is shared."""
    moved: dict[int, Sized] = {}
    for of_forces in (False, True):
        moving = [s for s in now.everything if s.candidate.columns and s.candidate.of_forces == of_forces]
        if moving:
            chosen = [s.candidate for s in moving]
            if of_forces:
                evidence = gather_forces(now.weighed, [], chosen, stretch_s, together=True)
            else:
                evidence = gather(now.watched, [], chosen, stretch_s, together=True)
            moved |= {id(old): new for old, new in zip(moving, _moved(evidence, moving), strict=True)}
    free = tuple(moved.get(id(s), s) for s in now.free)
    effects = tuple(moved.get(id(s), s) for s in now.effects)
    return account(now.model, recordings, free, effects, now)


def _moved(evidence: Evidence, moving: Sequence[Sized]) -> list[Sized]:
    owners = [s.candidate.trial for s in moving for _ in s.candidate.columns]
    curvature, score = np.zeros((len(owners),) * 2), np.zeros(len(owners))
    for stretch in evidence.stretches:
        counts = np.array([t == stretch.trial if t else stretch.role == "fit" for t in owners], dtype=float)
        curvature += stretch.own * np.outer(counts, counts)
        score += stretch.scores * counts
    step = inverse_of(curvature, evidence.raw)[0] @ score
    return [replace(s, size=s.size + step[rows]) for s, rows in zip(moving, evidence.groups, strict=True)]


def _aligned(now: Account, recordings: Sequence[Recording], stretch_s: float) -> Account:
    """Axes of free motions turned to where their residuals want them.

    A turn by the angle a about u + d is, for small d, the turn about u and one by a about d.
    """
    for effect in now.effects:
        free = effect.candidate.change
        if isinstance(free, FreeMotion):
            axis = _better_axis(now, effect.candidate, free, stretch_s)
            candidate = replace(effect.candidate, change=replace(free, axis=axis))
            turned = replace(effect, candidate=candidate)
            now = replace(now, effects=tuple(turned if e is effect else e for e in now.effects))
    return account(now.model, recordings, now.free, now.effects, now)


def _better_axis(now: Account, candidate: Candidate, free: FreeMotion, stretch_s: float) -> Vector:
    at: At = "before" if free.kind == "rotation" else "start"
    course = Following(freedom_name(candidate))
    parts = [Part(JointSpot(free.segment, at, free.kind, k), course) for k in range(3)]
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
