"""A marker that goes its own way: what it shows follows no law of the catalogue.

A marker that came off half way, or that the cameras confuse with another, pulls the pose with it, and the
nearest effects that the catalogue has would be named in its stead. So every marker is also allowed any
course. Where that explains clearly more than any law, the marker is left out of the search, and what it shows
is told as unexplained.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from scaling_service.capabilities.discovery.evidence.fitting import Account, scene_of
from scaling_service.capabilities.discovery.evidence.score import stretches_of
from scaling_service.capabilities.discovery.evidence.spots import MarkerSpot
from scaling_service.capabilities.discovery.evidence.watched import Watched
from scaling_service.capabilities.discovery.laws.at_once import each
from scaling_service.capabilities.discovery.laws.freedoms import Course, above, courses_of, cut
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Masked
from scaling_service.capabilities.discovery.search.judging import HIDDEN, Fitted
from scaling_service.capabilities.discovery.search.options import Options
from scaling_service.capabilities.discovery.search.strictness import DiscoverySettings
from scaling_service.numerics.multibody.laws import Array

KIND = "own_way"

CLEARLY = 1.3
"""How much more a free course of one marker must explain than a law (chosen: a law that is right explains all
but noise, and the free course takes that too)."""


@dataclass(frozen=True, slots=True)
class Odd:
    """A marker that seems to go its own way.

    Parameters
    ----------
    candidate : Candidate
        The marker left out, where it does.
    expected : float
        What a free course of it explains, as ``Fitted.expected``.
    """

    candidate: Candidate
    expected: float


def stranger(now: Account, options: Options, settings: DiscoverySettings) -> Odd | None:
    """A marker that goes its own way, if that explains clearly more than any law, be it sure or not.

    One of a segment at most: where two do, it is the segment that the model does not follow. None that has an
    effect of its own: what is left there is a remainder.
    """
    laws = [o.fitted.expected for o in options.best if not o.candidate.of_forces]
    model = now.model
    known = {
        model.marker(e.candidate.change.marker).segment
        for e in now.effects
        if isinstance(e.candidate.change, Masked)
    }
    lawful = {name for e in now.effects for name in e.candidate.where}
    odd = [
        Odd(candidate, fitted.expected)
        for candidate, fitted in _strange(scene_of(now), now.watched, settings.stretch_s)
        if fitted.p * options.count <= settings.level
        and model.marker(candidate.where[0]).segment not in known
        and candidate.where[0] not in lawful
    ]
    best = max(odd, key=lambda one: one.expected, default=None)
    return best if best is not None and best.expected > CLEARLY * max(laws, default=0.0) else None


def _strange(scene: Scene, watched: Sequence[Watched], stretch_s: float) -> list[tuple[Candidate, Fitted]]:
    """Every marker in all trials that are to fit, and in each trial by itself."""
    spots = [MarkerSpot(marker, k) for marker in scene.markers for k in range(3)]
    shown = [item for item in watched if set(scene.markers) <= set(item.markers)]
    courses = [found for found, _ in each(partial(courses_of, spots=spots), shown)]
    found = []
    for m, marker in enumerate(scene.markers):
        by_trial = {
            item.name: [cut(course[m], rows) for rows in stretches_of(item, stretch_s)]
            for item, course in zip(shown, courses, strict=True)
        }
        fitting = [by_trial[item.name] for item in shown if item.role == "fit"]
        for trials, parts in (((), fitting), *(((name,), [own]) for name, own in by_trial.items())):
            if any(parts):
                candidate = Candidate(KIND, (marker,), (), trials=trials, change=Masked(marker))
                found.append((candidate, _fitted(parts)))
    return found


def _fitted(trials: Sequence[Sequence[Course]]) -> Fitted:
    """Stretches of some trials, from their start on or from the moment at which a marker came off."""
    parts = [part for trial in trials for part in trial]
    own = np.array([_taken(p.slope, p.curvature) for p in parts])
    square = np.array([p.square.sum() for p in parts])
    freedom = np.array([p.freedom.sum() for p in parts])
    count = np.array([3.0 * len(p.square) for p in parts])
    chance = (square - own) / np.maximum(freedom - count, 1.0) * count
    ratio = np.log(np.maximum(own, 1e-300) / np.maximum(chance, 1e-300))
    into = np.concatenate([np.arange(len(trial)) for trial in trials])
    moments = range(max(int(into.max()) - 1, 1))
    p = min(1.0, len(moments) * min(above(ratio[into >= moment]) for moment in moments))
    return Fitted(np.zeros(0), np.zeros((0, 0)), float(own.sum()), float(chance.sum()), p, 1.0)


def _taken(slope: Array, curvature: Array) -> float:
    """Squares that a free course of the marker takes off."""
    ridge = HIDDEN * np.trace(curvature, axis1=1, axis2=2) + 1e-12
    bend = curvature + ridge[:, None, None] * np.eye(3)
    return float(np.einsum("nk,nk->", slope, np.linalg.solve(bend, slope[:, :, None])[:, :, 0]))
