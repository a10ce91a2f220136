"""What is assumed of the body and the recordings, and the motion and forces that follow from it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.laws import apply
from scaling_service.capabilities.discovery.laws.candidates import Contact, Estimate, list_loads
from scaling_service.capabilities.discovery.laws.contacts import compute_wrench
from scaling_service.capabilities.discovery.laws.loads import Wobbling
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.laws.swinging import still_skin
from scaling_service.capabilities.discovery.observations.tracked import MotionFit, Role
from scaling_service.capabilities.discovery.observations.wrench import ContactAssignment, WrenchFit
from scaling_service.core.progress import report_nothing
from scaling_service.core.threads import map_parallel
from scaling_service.model.body import GROUND, BodyModel
from scaling_service.model.trial import Trial


@dataclass(frozen=True, slots=True, eq=False)
class SearchTrial:
    """A trial, what it is for, and the ground's forces in it."""

    trial: Trial
    role: Role
    contacts: ContactAssignment | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SearchContext:
    """What a search is about, and what it keeps: the model it started from, recordings, settings.

    ``advance`` is called whenever a part of the work is done.
    """

    model: BodyModel
    recordings: Sequence[SearchTrial] = ()
    settings: DiscoverySettings = field(default_factory=DiscoverySettings)
    advance: Callable[[], None] = report_nothing


@dataclass(frozen=True, eq=False, kw_only=True)
class Fit:
    """What is assumed of the body and the recordings, and how well it follows them."""

    context: SearchContext
    effects: tuple[Estimate, ...] = ()
    tracked: tuple[MotionFit, ...] = ()  # the recordings, tracked with all of these
    wrenches: tuple[WrenchFit, ...] = ()  # those of them with forces
    astray: Mapping[str, float] = field(default_factory=dict)  # markers that draw the pose the less

    @property
    def model(self) -> BodyModel:
        """What the search started from."""
        return self.context.model

    @property
    def settings(self) -> DiscoverySettings:
        """How strict the search is."""
        return self.context.settings

    @property
    def by_key(self) -> dict[str, Estimate]:
        """Effects by their candidates' keys."""
        return {e.candidate.key: e for e in self.effects}

    def without(self, keys: Collection[str]) -> Fit:
        """The same tracking, no longer with effects of some keys; not estimated anew."""
        return replace(self, effects=tuple(e for e in self.effects if e.candidate.key not in keys))

    @cached_property
    def scene(self) -> Scene:
        """What the recordings show of the body."""
        model = self.model
        shown = {m for item in self.tracked for m in item.markers}
        names = tuple(m for m in model.marker_names if m in shown)
        q = np.concatenate([item.q[:, : len(model.coordinates)] for item in self.tracked])
        moved = [s for s in model.segments if s.parent == GROUND]
        roots = {t.coordinate for s in moved for j in s.joints for t in j.law.terms}
        moving = tuple(
            c.name
            for c, spread in zip(model.coordinates, q.std(axis=0), strict=True)
            if c.kind == "rotation" and c.name not in roots and spread > self.settings.moving_rad
        )
        grounds = [item.contacts.ground for item in self.wrenches]
        plates = dict.fromkeys(  # that bear something
            name for g in grounds for k, name in enumerate(g.plates) if g.in_contact()[:, k].any()
        )
        trials, wrenches = (tuple(item.name for item in items) for items in (self.tracked, self.wrenches))
        return Scene(
            model=model,
            markers=names,
            moving=moving,
            trials=trials,
            plates=tuple(plates),
            wrenches=wrenches,
            loaded={p: tuple(item.name for item in self.wrenches if item.tells_of(p)) for p in plates},
        )


def fit_recordings(context: SearchContext, effects: Sequence[Estimate] = (), near: Fit | None = None) -> Fit:
    """Track the recordings with effects of known size added to the model, from where another fit is."""
    starts = {item.name: item for item in near.tracked} if near else {}
    astray = near.astray if near else {}

    def track_again(recording: SearchTrial) -> MotionFit:
        trial, start = apply.correct_trial(recording.trial, effects), starts.get(recording.trial.name)
        if start is not None:
            trial = still_skin(trial, start, effects)
        known = apply.with_effects(context.model, effects, trial.name)
        return MotionFit.of(known, trial, recording.role, start, astray)

    found = tuple(map_parallel(track_again, context.recordings))
    context.advance()
    return fit_wrenches(
        Fit(
            context=context,
            effects=tuple(effects),
            tracked=found,
            wrenches=near.wrenches if near else (),
            astray=astray,
        )
    )


def fit_wrenches(fit: Fit) -> Fit:
    """The same motion with its forces as the effects have them by now."""
    wrenches = tuple(
        _fit_wrench(item, fit, recording.contacts)
        for item, recording in zip(fit.tracked, fit.context.recordings, strict=True)
        if recording.contacts is not None
    )
    return replace(fit, wrenches=wrenches)


def _fit_wrench(item: MotionFit, fit: Fit, contacts: ContactAssignment) -> WrenchFit:
    """Bring a tracked trial and its forces together, effects of known size taken into account."""
    here = [s for s in fit.effects if s.candidate.holds_in(item.name)]
    made = WrenchFit(
        tracked=item,
        model=apply.with_inertial_changes(apply.with_effects(fit.model, here, item.name), here, item.name),
        contacts=replace(contacts, ground=apply.correct_forces(contacts.ground, item.trial.times, here)),
        gravity=apply.tilt_gravity(here),
        oscillating=tuple(list_loads(here, Wobbling)),
    )
    for effect in fit.effects:
        contact = effect.candidate.change
        if isinstance(contact, Contact) and effect.candidate.holds_in(item.name):
            before = np.zeros((len(item.q), 6)) if made.touched is None else made.touched
            made = replace(made, touched=before + compute_wrench(made, contact))
    return made
