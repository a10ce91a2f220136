"""An effect taken back by its columns is as one that was never put in."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.capabilities.discovery.evidence.fit import SearchContext, fit_recordings
from scaling_service.capabilities.discovery.evidence.markers import MARKERS
from scaling_service.capabilities.discovery.evidence.scoring import score_candidates
from scaling_service.capabilities.discovery.laws.apply import with_effects
from scaling_service.capabilities.discovery.search.elimination import Removable
from tests.discovery.hidden import candidate, person, recorded, sized


def test_taking_back_is_to_first_order_what_following_anew_says() -> None:
    offset = sized("marker_offset", "RFH", numbers=(3.0, 0.0, 3.0))
    artefact = sized("soft_tissue_artefact", "RLFE", driver="knee_angle_r", numbers=(0.1, 0.1, 0.0))
    rival = candidate("joint_centre_offset", "hip_r")
    recordings = recorded(person(), with_effects(person().model, [offset, artefact], ""))
    model = person().model
    now = fit_recordings(SearchContext(model=model, recordings=recordings), (), [offset, artefact])
    without = fit_recordings(SearchContext(model=model, recordings=recordings), (), [artefact])

    known = Removable.of(now, MARKERS, [rival])
    quick = {o.candidate.key: o for o in known.without(offset, [rival])}
    anew = {o.candidate.key: o for o in score_candidates(without, [offset.candidate, rival], 2)}
    assert set(quick) == set(anew)
    for key, option in anew.items():
        assert quick[key].fitted.expected == pytest.approx(option.fitted.expected, rel=0.02)
        assert quick[key].held_out.gain == pytest.approx(option.held_out.gain, rel=0.05)
    own = quick[offset.candidate.key]
    np.testing.assert_allclose(own.fitted.size, offset.size, atol=2e-4)
    assert own.held_out.p < 1e-3
