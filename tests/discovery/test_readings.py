"""Forces that follow the plates' own readings by a law that no effect has."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from scaling_service.capabilities.discovery.disturbances.plates import curving
from scaling_service.capabilities.discovery.disturbances.readings import following_readings
from scaling_service.capabilities.discovery.evidence.fit import Fit, Recording, SearchContext, fit_recordings
from scaling_service.capabilities.discovery.evidence.scoring import score_candidates
from scaling_service.capabilities.discovery.evidence.wrench import WRENCH
from scaling_service.capabilities.discovery.options import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.discovery.start import prepare
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.model.forces import GroundForces
from tests.jobs.force_laboratory import force_laboratory

SHARE = 0.1


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory: pytest.TempPathFactory) -> SearchContext:
    file = force_laboratory(tmp_path_factory.mktemp("readings"))
    prepared = prepare(open_subject(file, AS_MEASURED), DiscoverSettings(start="none"), AS_MEASURED, 0.5)
    return SearchContext(prepared.model, prepared.recordings)


def crossing(ground: GroundForces, share: float) -> GroundForces:
    """The first plate's sideways force with a share of the second one's vertical force."""
    force = ground.force.copy()
    force[:, 0, 2] += share * np.nan_to_num(force[:, 1, 1])
    return replace(ground, force=force)


def read(recording: Recording, share: float) -> Recording:
    """A recording whose plates do so."""
    contacts = recording.contacts
    assert contacts is not None
    return replace(recording, contacts=replace(contacts, ground=crossing(contacts.ground, share)))


def seen(laboratory: SearchContext, share: float) -> Fit:
    recordings = list(map(partial(read, share=share), laboratory.recordings))
    return fit_recordings(replace(laboratory, recordings=recordings))


def test_crosstalk_is_predicted_where_it_was_not_fitted(laboratory: SearchContext) -> None:
    fit = seen(laboratory, SHARE)
    (found,) = following_readings(fit)
    assert found.p < 0.01  # eight blocks of half a second, of a swaying of its own course each
    assert found.held_out < 0.01
    assert found.expected > 0.5 * WRENCH.above_noise(fit)
    assert "forces" in found.where
    assert "off by what the plates themselves read" in found.law


def test_right_plates_are_predicted_no_better_than_by_chance(laboratory: SearchContext) -> None:
    (found,) = following_readings(seen(laboratory, 0.0))
    assert found.p > 0.05


def bent(recording: Recording, more: float) -> Recording:
    """A recording whose first plate reads more of what it bears, the more the more that is."""
    contacts = recording.contacts
    assert contacts is not None
    ground = contacts.ground
    gain = np.ones_like(ground.force[..., :1])
    gain[:, 0] += more * 1e-3 * np.nan_to_num(ground.force[:, 0, 1:2])
    ground = replace(ground, force=gain * ground.force, moment=gain * ground.moment)
    return replace(recording, contacts=replace(contacts, ground=ground))


def test_a_gain_that_grows_with_the_load_is_reported_with_its_size(laboratory: SearchContext) -> None:
    recordings = [bent(recording, 0.1) for recording in laboratory.recordings]
    fit = fit_recordings(replace(laboratory, recordings=recordings))
    (one,) = [c for c in curving(fit) if c.where == ("plate_1",)]
    (found,) = score_candidates(fit, [one], 1)
    assert found.fitted.size[1] == pytest.approx(0.1, rel=0.25)  # of what it reads, which is more
    assert found.fitted.gain > 0.9 * WRENCH.above_noise(fit)
