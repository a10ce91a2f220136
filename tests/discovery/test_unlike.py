"""What no effect of the catalogue describes: plates that misread, and forces that disagree for a while."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.discovery.effects.external_contact import find_contacts, make_touch
from scaling_service.capabilities.discovery.evidence.fit import Fit, SearchContext, fit_recordings
from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.laws.loads import PlateLate, PlateMisreading
from scaling_service.capabilities.discovery.observations.wrench import WrenchFit
from scaling_service.capabilities.discovery.options import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.discovery.ordinary.forces import NOISE
from scaling_service.capabilities.discovery.ordinary.loads import Touched, score_loads
from scaling_service.capabilities.discovery.search.instruments import find_misreading
from scaling_service.capabilities.discovery.start import prepare
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.core.arrays import Array
from tests.jobs.force_laboratory import force_laboratory

ODDS = DiscoverySettings().odds

Misread = Callable[[Array, Array], Array]
"""Of a plate's wrench about its middle (n, 6) and the times (n,), what it reads."""


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    file = force_laboratory(tmp_path_factory.mktemp("forces"))
    prepared = prepare(open_subject(file, AS_MEASURED), DiscoverSettings(start="none"), AS_MEASURED)
    return fit_recordings(SearchContext(model=prepared.model, recordings=prepared.recordings))


def spoil(item: WrenchFit, misread: Misread) -> WrenchFit:
    """The recording with a first plate that reads otherwise."""
    ground, middle = item.contacts.ground, item.centre("plate_1")
    wrench = item.plate("plate_1").copy()
    wrench[:, 3:] -= np.cross(middle, wrench[:, :3])
    read = misread(wrench, item.times)
    force, moment = ground.force.copy(), ground.moment.copy()
    force[:, 0], moment[:, 0] = read[:, :3], read[:, 3:] + np.cross(middle, read[:, :3])
    return replace(item, contacts=replace(item.contacts, ground=replace(ground, force=force, moment=moment)))


def exchange(wrench: Array, _: Array) -> Array:
    return wrench[:, [2, 1, 0, 3, 4, 5]]


def delay(wrench: Array, times: Array) -> Array:
    late = [np.interp(times - 0.04, times, channel) for channel in wrench.T]
    return np.stack(late, axis=1)


def bend(wrench: Array, _: Array) -> Array:
    bent = wrench.copy()
    bent[:, 1] *= 1.0 + wrench[:, 1] / 3000.0
    return bent


@pytest.mark.parametrize(
    ("misread", "said"),
    [(exchange, "fx"), (delay, "they come 4"), (bend, "more under load")],
    ids=["exchanged channels", "late", "bent"],
)
def test_a_plate_that_misreads_is_found_in_all_its_recordings(misread: Misread, said: str, fit: Fit) -> None:
    spoilt = replace(fit, wrenches=tuple(spoil(item, misread) for item in fit.wrenches))
    found = find_misreading(spoilt, [], [], [])
    assert found is not None
    odds, (candidate, _), words = found
    assert candidate.where == ("plate_1",)
    assert odds > 3.0 * ODDS
    assert said in words


def test_plates_in_order_misread_nothing(fit: Fit) -> None:
    found = find_misreading(fit, [], [], [])
    assert found is not None
    assert found[0] < ODDS


def test_a_misreading_is_what_its_columns_say(fit: Fit) -> None:
    (item, *_) = fit.wrenches

    def lean(wrench: Array, _: Array) -> Array:
        read = wrench.copy()
        read[:, 2] += 0.1 * wrench[:, 1]
        read[:, 4] += 0.3 * 0.2 * wrench[:, 0]
        return read

    columns = [PlateMisreading("plate_1", k, of).column(item) for k, of in ((2, 1), (4, 0))]
    expected = 0.1 * columns[0] + 0.3 * columns[1]
    np.testing.assert_allclose(spoil(item, lean).measured - item.measured, expected, atol=1e-9)
    later = spoil(item, lambda wrench, times: delay(wrench, 10.0 * times))  # by 4 ms
    inside = slice(5, -5)
    moved = (later.measured - item.measured)[inside]
    of_late = 0.004 * PlateLate("plate_1").column(item)[inside]
    assert np.abs(moved - of_late).max() < 0.1 * np.abs(of_late).max()


def weigh_push(fit: Fit, *, at_a_point: bool) -> Touched:
    """The likeliest touch where a force pushes the trunk, or force and moment disagree in whatever way."""
    item = next(one for one in fit.wrenches if one.name == "sway")
    start, end = 0.5, 1.5
    course = 100.0 * np.clip(np.minimum(item.times - start, end - item.times) / 0.1, 0.0, 1.0)
    angle = 2.0 * np.pi * (item.times - start)
    force = course[:, None] * np.stack([np.cos(angle), 0.3 + 0.0 * angle, np.sin(angle)], axis=1)
    origin, axes = item.segment_frame("torso")
    moment = np.cross(origin + np.einsum("njk,j->nk", axes, np.array([0.08, 0.25, -0.1])), force)
    if not at_a_point:
        anyhow = [np.sin(3.0 * angle), np.cos(2.0 * angle), np.cos(3.0 * angle)]
        moment += course[:, None] * np.stack(anyhow, axis=1)
    pushed = replace(item, touched=-np.concatenate([force, moment], axis=1))
    made = replace(fit, wrenches=tuple(pushed if one is item else one for one in fit.wrenches))
    found = [c for _, c in find_contacts(made, {one.name: 0.3 * NOISE for one in made.wrenches})]
    loads = score_loads(
        made,
        [],
        [],
        mass_sd=0.05,
        weighed=False,
        each=False,
        touching=[],
        touches=lambda _: [make_touch(made, c) for c in found],
    )
    return max(loads.touched)


def test_a_touch_explains_more_than_forces_that_disagree_in_whatever_way(fit: Fit) -> None:
    pushed, anyhow = weigh_push(fit, at_a_point=True), weigh_push(fit, at_a_point=False)
    assert pushed.bayes > anyhow.bayes > ODDS
    assert pushed.beyond > ODDS > anyhow.beyond
