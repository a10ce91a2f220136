"""Effects that are named along with the best one: those of other places, and no shadows of it."""

from __future__ import annotations

from scaling_service.capabilities.discovery.evidence.fit import SearchContext, fit_recordings
from scaling_service.capabilities.discovery.laws.apply import with_effects
from scaling_service.capabilities.discovery.search.selection import score_all, select
from scaling_service.model.body import BodyModel
from tests.discovery.hidden import hide, person, recorded, sized


def names(truth: BodyModel) -> list[str]:
    someone = person()
    now = fit_recordings(SearchContext(someone.model, recorded(someone, truth)))
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
