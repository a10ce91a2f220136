"""What is superfluous is dropped, and no more than that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scaling_service.capabilities.discovery.evidence.fit import SearchContext, fit_recordings
from scaling_service.capabilities.discovery.laws.apply import with_effects
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate, Masked
from scaling_service.capabilities.discovery.search.elimination import (
    drop_negligible,
    eliminate_backward,
    settle,
)
from tests.discovery.hidden import passed, person, recorded, sized


def test_of_one_thing_that_was_named_twice_one_is_kept() -> None:
    """Beside each other neither does anything."""
    offset = sized("marker_offset", "RFH", numbers=(6.0, 0.0, 6.0))
    artefact = sized("soft_tissue_artefact", "RLFE", driver="knee_angle_r", numbers=(0.1, 0.1, 0.0))
    model = person().model
    recordings = recorded(person(), with_effects(model, [offset, artefact], ""))
    half = replace(offset, size=0.5 * offset.size)
    again = replace(half, candidate=replace(half.candidate, note="again"))
    now = fit_recordings(SearchContext(model=model, recordings=recordings), (), [half, again, artefact])
    found = [passed(half), passed(again), passed(artefact)]
    kept, after = eliminate_backward(found, now)
    kept, after = settle(kept, after)
    assert len(kept) == len(after.effects) == 2
    sizes = {n.effect.candidate.kind: n.effect.size for n in kept}
    np.testing.assert_allclose(sizes["marker_offset"], offset.size, atol=3e-4)


def test_what_chance_explains_as_well_is_dropped() -> None:
    offset = sized("marker_offset", "RFH", numbers=(6.0, 0.0, 6.0))
    nothing = sized("marker_offset", "LFH", numbers=(0.0, 0.0, 0.0))
    model, recordings = person().model, recorded(person(), with_effects(person().model, [offset], ""))
    now = fit_recordings(SearchContext(model=model, recordings=recordings), (), [offset, nothing])
    kept, _ = eliminate_backward([passed(nothing), passed(offset)], now)
    assert [n.effect.candidate.name for n in kept] == [offset.candidate.name]


def test_a_name_that_the_whole_catalogue_finds_by_chance_is_dropped() -> None:
    offset = sized("marker_offset", "RFH", numbers=(6.0, 0.0, 6.0))
    model = person().model
    now = fit_recordings(
        SearchContext(model=model, recordings=recorded(person(), with_effects(model, [offset], ""))),
        (),
        [offset],
    )
    for p, kept in ((0.04, [offset.candidate.key]), (0.3, [])):
        found, after = eliminate_backward([replace(passed(offset), p_family=p)], now)
        assert [n.candidate.key for n in found] == [e.candidate.key for e in after.effects] == kept


def test_effects_that_take_little_of_what_is_wrong_are_taken_back_and_reported() -> None:
    """The cameras' noise is known, and with it what stands above."""
    large = sized("marker_offset", "RFH", numbers=(9.0, 0.0, 9.0))
    small = sized("marker_offset", "LFH", numbers=(1.5, 0.0, 1.5))
    model = person().model
    context = SearchContext(
        model=model, recordings=recorded(person(), with_effects(model, [large, small], ""))
    )
    before = fit_recordings(context)
    left_out = Estimate(
        Candidate(kind="own_way", where=("RLFE",), columns=(), change=Masked("RLFE")), np.zeros(0)
    )
    for effect, holds in ((small, False), (large, True)):
        for beside in ([], [left_out]):  # a marker that moves independently changes nothing of it
            now = fit_recordings(context, (), [*beside, effect], before)
            named, after, said = drop_negligible([passed(effect)], now, before)
            assert bool(named) is (len(after.effects) > len(beside)) is holds
            assert [effect.candidate.name in each for each in said] == [True] * (not holds)
