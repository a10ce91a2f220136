"""What is assumed of the body and the recordings, and the motion and forces that follow from it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from scaling_service.capabilities.discovery.evidence.forces import weigh
from scaling_service.capabilities.discovery.evidence.resting import rested, swinging_markers
from scaling_service.capabilities.discovery.evidence.watched import Role, Watched
from scaling_service.capabilities.discovery.evidence.weighed import Footing, Weighed
from scaling_service.capabilities.discovery.laws.additions import Sized, corrected, with_effects
from scaling_service.capabilities.discovery.laws.at_once import each
from scaling_service.capabilities.discovery.laws.contact_points import wrench_of
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Contact
from scaling_service.model.body import GROUND, BodyModel
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.laws import Array

_STILL_RAD = np.radians(2.0)
"""A coordinate that spreads less drives nothing that could be told from a constant (chosen)."""


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
    both = (*free, *effects)

    def followed(recording: Recording) -> Watched:
        return _followed(model, recording, both, near.get(recording.trial.name))

    watched = tuple(each(followed, recordings))
    made = Account(model, tuple(free), tuple(effects), watched, starts.weighed if starts else ())
    return reweighed(made, recordings)


def _followed(
    model: BodyModel, recording: Recording, effects: Sequence[Sized], near: Watched | None
) -> Watched:
    trial = corrected(recording.trial, effects)
    known = with_effects(model, effects, trial.name)
    swings = swinging_markers(trial, effects)
    if near is None or not swings:
        near = Watched.of(known, trial, recording.role, near)

    def follow(changed: Trial, item: Watched) -> Watched:
        return Watched.of(known, changed, recording.role, item)

    return rested(trial, near, effects, follow) if swings else near


def reweighed(now: Account, recordings: Sequence[Recording]) -> Account:
    """The same motion with its forces as the effects have them by now, floors as they were."""
    noise = {item.name: item.covariance for item in now.weighed}
    weighed = tuple(
        _weighed(item, now, recording.footing, noise.get(item.name))
        for item, recording in zip(now.watched, recordings, strict=True)
        if recording.footing is not None
    )
    return replace(now, weighed=weighed)


def without(gone: Collection[str], now: Account, recordings: Sequence[Recording]) -> Account:
    """Followed without the effects of some keys, all others as they are."""
    kept = tuple(e for e in now.effects if e.candidate.key not in gone)
    if all(e.candidate.of_forces for e in now.effects if e.candidate.key in gone):
        return reweighed(replace(now, effects=kept), recordings)
    return account(now.model, recordings, now.free, kept, now)


def _weighed(item: Watched, now: Account, footing: Footing, noise: Array | None) -> Weighed:
    made = weigh(item, now.model_in(item.name), footing, now.everything)
    made = replace(made, known_covariance=noise)
    for effect in now.effects:
        contact = effect.candidate.change
        if isinstance(contact, Contact) and effect.candidate.holds_in(item.name):
            before = np.zeros((len(item.q), 6)) if made.touched is None else made.touched
            made = replace(made, touched=before + wrench_of(made, contact))
    return made


def squares(now: Account, *, of_forces: bool, of: Sequence[Candidate] = ()) -> float:
    """Whitened sum of squares of markers or of forces in the trials that decide.

    Those are the trials to fit, and all trials of what is in none of them.

    Parameters
    ----------
    of : sequence of Candidate
        What is to be decided.
    """
    items: Sequence[Watched | Weighed] = now.weighed if of_forces else now.watched
    fitting = {item.name for item in items if item.role == "fit"}
    alone = {trial for candidate in of if not fitting & set(candidate.trials) for trial in candidate.trials}
    deciding = [item for item in items if item.name in fitting | alone]
    return float(sum(each(lambda item: item.square, deciding)))


def unseen_squares(now: Account) -> float:
    """Whitened sum of squares of markers and forces together in what is held out, else in everything."""
    items: list[Watched | Weighed] = [*now.watched, *now.weighed]
    held_out = [item.square for item in items if item.role == "held_out"]
    return float(sum(held_out or (item.square for item in items)))


def scene_of(now: Account) -> Scene:
    """What the recordings show of the body."""
    model = now.model
    shown = {m for item in now.watched for m in item.markers}
    names = tuple(m for m in model.marker_names if m in shown)
    q = np.concatenate([item.q[:, : len(model.coordinates)] for item in now.watched])
    moved = [s for s in model.segments if s.parent == GROUND]
    roots = {t.coordinate for s in moved for j in s.joints for t in j.law.terms}
    moving = tuple(
        c.name
        for c, spread in zip(model.coordinates, q.std(axis=0), strict=True)
        if c.kind == "rotation" and c.name not in roots and spread > _STILL_RAD
    )
    plates = dict.fromkeys(name for item in now.weighed for name in _loaded(item))
    trials, weighed = (tuple(item.name for item in items) for items in (now.watched, now.weighed))
    return Scene(model, names, moving, trials, tuple(plates), weighed)


def _loaded(item: Weighed) -> list[str]:
    """The plates that bear something in a trial."""
    ground = item.footing.ground
    return [name for k, name in enumerate(ground.plates) if ground.in_contact()[:, k].any()]
