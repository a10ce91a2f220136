"""Forces that follow the plates' own readings by a law that no effect has."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from scaling_service.capabilities.discovery.disturbances.plates import LAWS, propose_crossing, propose_curving
from scaling_service.capabilities.discovery.disturbances.readings import find_following_readings
from scaling_service.capabilities.discovery.evidence.fit import Fit, Recording, SearchContext, fit_recordings
from scaling_service.capabilities.discovery.evidence.noise_floors import measure_noise_floors
from scaling_service.capabilities.discovery.evidence.scoring import score_candidates
from scaling_service.capabilities.discovery.evidence.wrench import WRENCH
from scaling_service.capabilities.discovery.options import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.discovery.search.unexplained import describe_unexplained
from scaling_service.capabilities.discovery.start import prepare
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.model.forces import GroundForces
from tests.jobs.force_laboratory import force_laboratory

SHARE = 0.1


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory: pytest.TempPathFactory) -> SearchContext:
    file = force_laboratory(tmp_path_factory.mktemp("readings"))
    prepared = prepare(open_subject(file, AS_MEASURED), DiscoverSettings(start="none"), AS_MEASURED, 0.5)
    return SearchContext(model=prepared.model, recordings=prepared.recordings)


def leaking(ground: GroundForces, share: float) -> GroundForces:
    """The first plate's sideways force with a share of the second one's vertical force."""
    force = ground.force.copy()
    force[:, 0, 2] += share * np.nan_to_num(force[:, 1, 1])
    return replace(ground, force=force)


def changed(laboratory: SearchContext, change: Callable[[GroundForces], GroundForces]) -> Fit:
    """The recordings with other readings."""

    def of(recording: Recording) -> Recording:
        contacts = recording.contacts
        assert contacts is not None
        return replace(recording, contacts=replace(contacts, ground=change(contacts.ground)))

    return fit_recordings(replace(laboratory, recordings=[of(r) for r in laboratory.recordings]))


def test_crosstalk_is_predicted_where_it_was_not_fitted(laboratory: SearchContext) -> None:
    fit = changed(laboratory, partial(leaking, share=SHARE))
    (found,) = find_following_readings(fit)
    assert found.p < 0.01  # eight blocks of half a second, of a swaying of its own course each
    assert found.held_out < 0.01
    assert found.expected > 0.5 * WRENCH.above_noise(fit)
    assert "forces" in found.where
    assert "off by what the plates themselves read" in found.law


def test_right_plates_are_predicted_no_better_than_by_chance(laboratory: SearchContext) -> None:
    (found,) = find_following_readings(changed(laboratory, partial(leaking, share=0.0)))
    assert found.p > 0.05


def exchanged(ground: GroundForces, sign: float = 1.0) -> GroundForces:
    """The first plate's horizontal channels stand for each other; its moments are right.

    ``sign``: minus one for a plate whose axes lie across those of the ground.
    """
    force = ground.force.copy()
    force[:, 0] = force[:, 0][:, [2, 1, 0]] * np.array([sign, 1.0, sign])
    return replace(ground, force=force)


def reversed_channel(ground: GroundForces) -> GroundForces:
    """The first plate's sideways channel has the wrong sign."""
    force = ground.force.copy()
    force[:, 0, 2] *= -1.0
    return replace(ground, force=force)


@pytest.mark.parametrize(
    ("fault", "size", "said"),
    [
        (exchanged, (1, -1, -1, 1), "were exchanged"),
        (partial(exchanged, sign=-1.0), (1, 1, 1, 1), "were exchanged"),
        (reversed_channel, (0, 0, 0, 2), "fz had the wrong sign"),
    ],
)
def test_wrong_plugs_are_reported_as_what_they_are(
    laboratory: SearchContext,
    fault: Callable[[GroundForces], GroundForces],
    size: tuple[int, ...],
    said: str,
) -> None:
    fit = changed(laboratory, fault)
    (one,) = [c for c in propose_crossing(fit) if c.where == ("plate_1",)]
    (found,) = score_candidates(fit, [one], 1)
    assert found.fitted.size[:4] == pytest.approx(size, abs=0.2)
    assert found.fitted.gain > 0.9 * WRENCH.above_noise(fit)
    (describe,) = [law.describe for law in LAWS if law.candidates is propose_crossing]
    assert describe is not None
    assert said in describe(found)[1]


def test_a_loose_plug_is_unexplained_though_most_blocks_are_right(laboratory: SearchContext) -> None:
    def dropped(ground: GroundForces) -> GroundForces:
        on = (np.mod(ground.times, 1.7) >= 0.08)[:, None]
        force, moment = ground.force.copy(), ground.moment.copy()
        force[:, 0] *= on
        moment[:, 0] *= on
        return replace(ground, force=force, moment=moment)

    for change, places in ((lambda ground: ground, set()), (dropped, {"fy"})):
        fit = changed(laboratory, change)
        found = describe_unexplained(fit, measure_noise_floors(fit, fit.scene.moving))
        assert places <= {place for one in found for place in one.where}
        assert bool(found) == bool(places)


def bent(ground: GroundForces) -> GroundForces:
    """The first plate reads more of what it bears, the more the more that is."""
    gain = np.ones_like(ground.force[..., :1])
    gain[:, 0] += 1e-4 * np.nan_to_num(ground.force[:, 0, 1:2])
    return replace(ground, force=gain * ground.force, moment=gain * ground.moment)


def test_a_gain_that_grows_with_the_load_is_reported_with_its_size(laboratory: SearchContext) -> None:
    fit = changed(laboratory, bent)
    (one,) = [c for c in propose_curving(fit) if c.where == ("plate_1",)]
    (found,) = score_candidates(fit, [one], 1)
    assert found.fitted.size[1] == pytest.approx(0.1, rel=0.25)  # of what it reads, which is more
    assert found.fitted.gain > 0.9 * WRENCH.above_noise(fit)
