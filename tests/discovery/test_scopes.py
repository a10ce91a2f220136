"""What is not in all recordings: named in those in which it is, whatever else is free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.discovery.effects.catalogue import propose_candidates
from scaling_service.capabilities.discovery.evidence.fit import Recording
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate
from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.evidence.statistics import NOTHING, HeldOut
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.discover import discover
from scaling_service.capabilities.discovery.search.selection import keep_widest
from tests.discovery.hidden import candidate, hide, person, recorded

MOVED_MM = (10.0, 0.0, 10.0)
STUCK = "RFH"


def moved(*trials: str) -> list[Recording]:
    """The person's recordings, a marker elsewhere on its segment in some of them."""
    _, truth = hide("marker_offset", STUCK, numbers=MOVED_MM)
    pairs = zip(recorded(person(), person().model), recorded(person(), truth), strict=True)
    return [after if after.trial.name in trials else before for before, after in pairs]


@pytest.mark.parametrize("trials", [("gait_1", "gait_2"), ("gait_1",), ("gait_2",)])
def test_a_marker_that_was_stuck_on_again_is_found_in_its_recordings(trials: tuple[str, ...]) -> None:
    (named,) = discover(person().model, moved(*trials)).findings.named
    assert named.effect.candidate.where == (STUCK,)
    assert named.effect.candidate.trials == trials
    assert 1e3 * np.linalg.norm(named.effect.size) == pytest.approx(np.linalg.norm(MOVED_MM), rel=0.05)


def test_a_place_that_is_free_does_not_hide_that_it_changed() -> None:
    """A calibration takes the mean; the other recordings tell what is free of all from what is in some."""
    mean = 0.5e-3 * np.array(MOVED_MM)
    free = [Estimate(replace(candidate("marker_offset", STUCK), note="as calibrated"), mean)]
    (named,) = discover(person().model, moved("gait_1", "gait_2"), free).findings.named
    assert named.effect.candidate.where == (STUCK,)
    assert named.effect.candidate.trials in {("knee_r",), ("gait_1", "gait_2")}
    assert 1e3 * np.linalg.norm(named.effect.size) == pytest.approx(np.linalg.norm(MOVED_MM), rel=0.05)


def test_scopes_are_all_trials_each_and_all_since_each() -> None:
    scene = Scene(
        model=person().model, markers=(STUCK,), moving=(), trials=("a", "b", "c"), plates=(), wrenches=("a",)
    )
    assert scene.scopes == ((), ("a",), ("b",), ("c",), ("b", "c"))
    assert scene.scopes_with_forces == ((),)
    assert [c.trials for c in propose_candidates(scene, ["marker_offset"])] == list(scene.scopes)


def option(*trials: str) -> ScoredCandidate:
    """The same effect in some trials; () for all."""
    return ScoredCandidate(
        candidate=Candidate(kind="marker_offset", where=(STUCK,), columns=(), trials=trials),
        fitted=NOTHING,
        gains=None,
        held_out=HeldOut(1, 0, False),
    )


@pytest.mark.parametrize(
    ("passing", "kept"),
    [
        ([("b",), ("b", "c")], [("b", "c")]),  # the held-out trial has judged the wider one
        ([("c",), ()], [()]),  # a gain in a held-out trial does not compare
        ([("a",), ()], [("a",), ()]),  # gains in trials to fit do
        ([("c",), ("c", "d")], [("c",), ("c", "d")]),  # so do gains of what was held out
        ([("c",)], [("c",)]),
    ],
)
def test_the_wider_of_two_scopes_stays_where_gains_do_not_compare(
    passing: list[tuple[str, ...]], kept: list[tuple[str, ...]]
) -> None:
    found = keep_widest([option(*trials) for trials in passing], "abcd", "ab", DiscoverySettings())
    assert [o.candidate.trials for o in found] == kept


@pytest.mark.parametrize(("in_first", "kept"), [(1.02, [("b", "c")]), (1.2, [("a",), ("b", "c")])])
def test_what_is_in_the_first_trial_alone_or_reversed_in_all_others_is_in_the_others(
    in_first: float, kept: list[tuple[str, ...]]
) -> None:
    """Where it explains as much there, reversed: its value in all trials is free. Else the two differ."""
    both = [option("a"), option("b", "c")]
    both = [
        replace(o, fitted=replace(NOTHING, gain=gain)) for o, gain in zip(both, (in_first, 1.0), strict=True)
    ]
    assert [o.candidate.trials for o in keep_widest(both, "abc", "ab", DiscoverySettings())] == kept
