"""Effects that are named along with the best one: those of other places, and no shadows of it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from scaling_service.capabilities.discovery.evidence.fit import SearchContext, fit_recordings
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate, ScoredCandidates
from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.evidence.statistics import Fitted, HeldOut
from scaling_service.capabilities.discovery.laws.apply import with_effects
from scaling_service.capabilities.discovery.laws.candidates import Candidate
from scaling_service.capabilities.discovery.search.selection import _put_usual_first, score_all, select
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin
from tests.discovery.hidden import hide, person, recorded, sized
from tests.jobs.hand_made import LOAD


def names(truth: BodyModel) -> list[str]:
    someone = person()
    now = fit_recordings(SearchContext(model=someone.model, recordings=recorded(someone, truth)))
    options = score_all(now)
    return [n.effect.candidate.name for n in select(now, options, [], ()).named]


def test_effects_of_two_places_are_named_at_once() -> None:
    two = [
        sized("marker_offset", "RFH", numbers=(6.0, 10.0, 0.0)),
        sized("marker_offset", "LASIS", numbers=(0.0, -9.0, 6.0)),
    ]
    truth = with_effects(person().model, two, "")
    assert set(names(truth)) == {"marker_offset at RFH", "marker_offset at LASIS"}


def test_a_large_effect_casts_no_shadow() -> None:
    """Offsets of the markers beyond a moved joint's centre explain much of it, and nothing beside it."""
    _, truth = hide("joint_centre_offset", "knee_r", numbers=(18.0, -8.0, 5.0))
    assert names(truth) == ["joint_centre_offset at knee_r"]


def test_of_likes_the_one_of_a_usual_size_is_named() -> None:
    """A foot three times as heavy explains no more than a load that it carries."""
    model = load_builtin("full_body_35dof")
    now: Any = SimpleNamespace(model=model, settings=DiscoverySettings())
    heavy = replace(LOAD.candidate, kind="segment_mass", columns=LOAD.candidate.columns[:1])
    gains, held = np.array([9.0, 11.0, 10.0, 12.0]), HeldOut(0.5, 1e-3, folds=False)
    mass = model.segment(LOAD.candidate.where[0]).mass

    def scored(candidate: Candidate, size: list[float], more: float) -> ScoredCandidate:
        fitted = Fitted(
            size=np.array(size),
            covariance=1e-6 * np.eye(len(size)),
            gain=float(gains.sum()),
            by_chance=1.0,
            p=1e-9,
            identifiable=1.0,
            freedom=3.0,
        )
        return ScoredCandidate(
            candidate=candidate,
            fitted=fitted,
            gains=gains + more * np.array([1.0, -0.5, 1.0, -1.0]),
            held_out=held,
        )

    load = scored(LOAD.candidate, [0.5, 0.0, 0.0, 0.0], 0.0)
    for factor, first in ((2.0, load.candidate), (0.1, heavy)):
        best = scored(heavy, [factor * mass], 0.5)
        among = ScoredCandidates([best, load], 2, ((), ()), ())
        assert _put_usual_first([best, load], among, now)[0].candidate == first
