"""Where something touches, against a force put at a known point of a recording's trunk."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.discovery.effects.external_contact import find_contacts
from scaling_service.capabilities.discovery.evidence.fit import Fit, SearchContext, fit_recordings
from scaling_service.capabilities.discovery.laws.candidates import Contact
from scaling_service.capabilities.discovery.laws.contacts import Spell, fit_point
from scaling_service.capabilities.discovery.observations.wrench import WrenchFit
from scaling_service.capabilities.discovery.options import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.discovery.ordinary.forces import NOISE
from scaling_service.capabilities.discovery.start import prepare
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.core.arrays import Array
from tests.jobs.force_laboratory import force_laboratory

POINT = (0.08, 0.25, -0.1)


@pytest.fixture(scope="module")
def sway(tmp_path_factory: pytest.TempPathFactory) -> WrenchFit:
    file = force_laboratory(tmp_path_factory.mktemp("forces"))
    prepared = prepare(open_subject(file, AS_MEASURED), DiscoverSettings(start="none"), AS_MEASURED)
    found = fit_recordings(
        SearchContext(
            model=prepared.model, recordings=[r for r in prepared.recordings if r.trial.name == "sway"]
        )
    )
    return found.wrenches[0]


def pushed(item: WrenchFit, newton: float, start: float, end: float, *, turning: bool = True) -> WrenchFit:
    """The recording with a force on the trunk that turns as time goes by, or keeps its direction."""
    course = np.clip(np.minimum(item.times - start, end - item.times) / 0.2, 0.0, 1.0)
    angle = 2.0 * np.pi * (item.times - start) * turning
    force = newton * course[:, None] * np.stack([np.cos(angle), 0.3 + 0.0 * angle, np.sin(angle)], axis=1)
    origin, axes = item.segment_frame("torso")
    place = origin + np.einsum("njk,j->nk", axes, np.array(POINT))
    return replace(item, touched=-np.concatenate([force, np.cross(place, force)], axis=1))


def distance(point: Array) -> float:
    return float(np.linalg.norm(point - POINT))


def test_a_turning_force_shows_its_point(sway: WrenchFit) -> None:
    item = pushed(sway, 60.0, 0.6, 1.5)
    spell = Spell(item, np.flatnonzero(item.usable & (item.times > 0.7) & (item.times < 1.4)), 0.1 * NOISE)
    assert distance(fit_point(spell, "torso")) < 0.02


def test_a_force_of_one_direction_shows_a_line(sway: WrenchFit) -> None:
    """Noise alone would say where on it: the moment about the point found is none all the same."""
    item = pushed(sway, 60.0, 0.6, 1.5, turning=False)
    spell = Spell(item, np.flatnonzero(item.usable & (item.times > 0.7) & (item.times < 1.4)), 0.1 * NOISE)
    apart = fit_point(spell, "torso") - np.array(POINT)
    along = np.array([1.0, 0.3, 0.0]) / np.hypot(1.0, 0.3)
    assert np.linalg.norm(np.cross(apart, along)) < 0.05


@pytest.mark.parametrize("lasting_s", [0.4, 0.8, 1.2])
def test_a_push_is_found_however_long_it_lasts(sway: WrenchFit, lasting_s: float) -> None:
    fit = Fit(context=SearchContext(model=sway.model), wrenches=(pushed(sway, 150.0, 0.5, 0.5 + lasting_s),))
    found = {c.where[0]: c.change for _, c in find_contacts(fit, {item.name: NOISE for item in fit.wrenches})}
    contact = found["torso"]
    assert isinstance(contact, Contact)
    assert contact.start_s == pytest.approx(0.5, abs=0.2)
    assert contact.end_s == pytest.approx(0.5 + lasting_s, abs=0.2)


def test_without_a_push_nothing_touches(sway: WrenchFit) -> None:
    fit = Fit(context=SearchContext(model=sway.model), wrenches=(sway,))
    assert not find_contacts(fit, {item.name: NOISE for item in fit.wrenches})
