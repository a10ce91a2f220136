"""A marker that moves independently: what it shows follows no law of the catalogue.

A marker that came off half way, or that the cameras confuse with another, pulls the pose with it, and the
nearest effects that the catalogue has would be named in its stead. So every marker is also allowed any
course. Where that explains clearly more than any law, the marker is left out of the search, and what it shows
is reported as unexplained.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from scaling_service.capabilities.discovery.evidence.courses import FreeCourse, solve_courses
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.markers import MARKERS
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidates
from scaling_service.capabilities.discovery.evidence.settings import IDENTIFIABLE
from scaling_service.capabilities.discovery.evidence.statistics import Fitted, assess_above_zero, assess_share
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Masked
from scaling_service.capabilities.discovery.laws.spots import MarkerSpot
from scaling_service.core.threads import map_parallel
from scaling_service.numerics.multibody.laws import Array

KIND = "own_way"
_MOST_OF_IT = 0.8  # of what stands above the noise (chosen: as for effects on held-out recordings)


@dataclass(frozen=True, slots=True)
class FreeMarker:
    """A marker that seems to move independently: left out, and what a free course explains (expected)."""

    candidate: Candidate
    expected: float


def find_free_marker(fit: Fit, scored: ScoredCandidates) -> FreeMarker | None:
    """A marker that moves independently, if that explains clearly more than any law, be it sure or not.

    One of a segment at most: where two do, it is the segment that the model does not follow. None that has an
    effect of its own: what is left there is a remainder.
    """
    model, settings = fit.model, fit.settings
    laws = [o for o in scored.best if MARKERS.shows(o.candidate)]
    unseen = {item.name for item in fit.tracked if item.role == "held_out"}
    square = sum(item.square for item in fit.tracked if item.name in unseen)
    changes = [e.candidate.change for e in fit.effects]
    known = {model.marker(c.marker).segment for c in changes if isinstance(c, Masked)}
    lawful = {name for e in fit.effects for name in e.candidate.where}
    odd = [
        FreeMarker(candidate, fitted.expected)
        for candidate, fitted in _fit_markers(fit)
        if fitted.p * scored.count <= settings.level
        and model.marker(candidate.where[0]).segment not in known
        and candidate.where[0] not in lawful
    ]
    best = max(odd, key=lambda one: one.expected, default=None)
    if best is None:
        return None
    here = unseen.issuperset(best.candidate.trials) and bool(best.candidate.trials)
    explained = [
        o.held_out.gain * square if here and not o.candidate.trials else o.fitted.expected for o in laws
    ]
    return best if best.expected > settings.free_marker_lead * max(explained, default=0.0) else None


def _fit_markers(fit: Fit) -> Iterator[tuple[Candidate, Fitted]]:
    """Every marker in all trials that are to fit, and in each trial by itself."""
    markers, block_s = fit.scene.markers, fit.settings.block_s
    spots = [MarkerSpot(marker, k) for marker in markers for k in range(3)]
    shown = [item for item in fit.tracked if set(markers) <= set(item.markers)]
    courses = [found for found, _ in map_parallel(partial(solve_courses, spots=spots), shown)]
    for m, marker in enumerate(markers):
        by_trial = {
            item.name: [course[m].cut(rows) for rows in item.blocks(block_s)]
            for item, course in zip(shown, courses, strict=True)
        }
        fitting = [by_trial[item.name] for item in shown if item.role == "fit"]
        for trials, parts in (((), fitting), *(((name,), [own]) for name, own in by_trial.items())):
            if any(parts):
                candidate = Candidate(
                    kind=KIND, where=(marker,), columns=(), trials=trials, change=Masked(marker)
                )
                yield candidate, _fit_course(parts)


def _fit_course(trials: Sequence[Sequence[FreeCourse]]) -> Fitted:
    """Blocks of some trials, from their start on or from the moment at which a marker came off.

    Where it takes off most of what stands above the noise, the whole is asked, too, as if each block were one
    frame: in a walk of a second there are too few to tell how they stray.
    """
    parts = [part for trial in trials for part in trial]
    own = np.array([_sum_explained(p.slope, p.curvature) for p in parts])
    square = np.array([p.square.sum() for p in parts])
    freedom = np.array([p.freedom.sum() for p in parts])
    count = np.array([3.0 * p.frames for p in parts])
    chance = (square - own) / np.maximum(freedom - count, 1.0) * count
    ratio = np.log(np.maximum(own, 1e-300) / np.maximum(chance, 1e-300))
    gain, by_chance = float(own.sum()), float(chance.sum())
    into = np.concatenate([np.arange(len(trial)) for trial in trials])
    moments = range(max(int(into.max()) - 1, 1))
    p = min(1.0, len(moments) * min(assess_above_zero(ratio[into >= moment]) for moment in moments))
    if gain - by_chance > _MOST_OF_IT * max(float((square - freedom).sum()), 0.0):
        p = min(1.0, 2.0 * min(p, assess_share(gain, by_chance, 3.0 * len(parts))))
    return Fitted.of_any_course(gain, by_chance, p)


def _sum_explained(slope: Array, curvature: Array) -> float:
    """Squares that a free course of the marker takes off."""
    ridge = IDENTIFIABLE * np.trace(curvature, axis1=1, axis2=2) + 1e-12
    bend = curvature + ridge[:, None, None] * np.eye(3)
    return float(np.einsum("nk,nk->", slope, np.linalg.solve(bend, slope[:, :, None])[:, :, 0]))
