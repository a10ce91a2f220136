"""What is not in all recordings: named in those in which it is, whatever else is free."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.capabilities.discovery.effects.catalogue import propose_candidates
from scaling_service.capabilities.discovery.evidence.fit import SearchTrial
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.discover import discover
from tests.discovery.hidden import hide, person, recorded

MOVED_MM = (20.0, 0.0, 20.0)
STUCK = "RFH"


def moved(*trials: str) -> list[SearchTrial]:
    """The person's recordings, a marker elsewhere on its segment in some of them."""
    _, truth = hide("marker_offset", STUCK, numbers=MOVED_MM)
    pairs = zip(recorded(person(), person().model), recorded(person(), truth), strict=True)
    return [after if after.trial.name in trials else before for before, after in pairs]


@pytest.mark.parametrize(
    "trials",
    [
        ("gait_1",),
        *(pytest.param(names, marks=pytest.mark.costly) for names in (("gait_1", "gait_2"), ("gait_2",))),
    ],
)
def test_a_marker_that_was_stuck_on_again_is_found_in_its_recordings(trials: tuple[str, ...]) -> None:
    (named,) = discover(person().model, moved(*trials)).named
    assert named.effect.candidate.where == (STUCK,)
    assert named.effect.candidate.trials == trials
    assert 1e3 * np.linalg.norm(named.effect.size) == pytest.approx(np.linalg.norm(MOVED_MM), rel=0.05)


def test_scopes_are_all_trials_each_and_all_since_each() -> None:
    scene = Scene(
        model=person().model, markers=(STUCK,), moving=(), trials=("a", "b", "c"), plates=(), wrenches=("a",)
    )
    assert scene.scopes == ((), ("a",), ("b",), ("c",), ("b", "c"))
    assert scene.scopes_with_forces == ((),)
    assert [c.trials for c in propose_candidates(scene, ["marker_offset"])] == list(scene.scopes)
