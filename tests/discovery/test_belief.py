"""How far a named effect may be believed: closed forms, published sizes, an unloaded plate."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.stats import multivariate_normal

from scaling_service.capabilities.discovery.effects.catalogue import find_effects
from scaling_service.capabilities.discovery.effects.plates import contradict_bias, propose_plate_biases
from scaling_service.capabilities.discovery.effects.sizes import Range, look_up_usual_sizes
from scaling_service.capabilities.discovery.evidence.fit import SearchContext, fit_recordings
from scaling_service.capabilities.discovery.result import (
    estimate_probability,
    estimate_sign_probability,
    find_carrying,
    make_discovery_document,
)
from scaling_service.capabilities.discovery.search.findings import NamedEffect
from scaling_service.capabilities.discovery.start import assign_contacts
from scaling_service.capabilities.kinetics.forces import TrialForces
from scaling_service.model.builtin import load_builtin
from scaling_service.model.forces import CONTACT_N
from scaling_service.model.inertia import sum_mass
from scaling_service.model.reference import find_reference_folder
from scaling_service.recording.plates_feet import NOBODY, assign_foot_loads
from tests.discovery.hidden import person, recorded
from tests.jobs.hand_made import LOAD, SCALE, findings
from tests.jobs.hidden_case import found
from tests.jobs.test_discover_forces import contacts, ground_of


def test_a_p_value_of_five_per_cent_leaves_almost_thirty_per_cent_for_chance() -> None:
    """Sellke, Bayarri & Berger 2001, table 1: at least 0.289 at p = 0.05, 0.111 at 0.01."""
    for p, least in ((0.05, 0.289), (0.01, 0.111)):
        assert 1.0 - estimate_probability(replace(SCALE, p_family=p)) == pytest.approx(least, abs=5e-4)
    assert estimate_probability(replace(SCALE, p_family=0.9)) == 0.5


def test_the_sign_is_that_of_a_normal_number() -> None:
    """One number: the normal distribution. Two that hang together: as often as drawn numbers say."""
    assert estimate_sign_probability(np.array([-2.0]), np.eye(1)) == pytest.approx(0.97725, abs=1e-5)
    values, covariance = np.array([1.0, 2.0]), np.array([[1.0, 0.6], [0.6, 4.0]])
    draws = multivariate_normal(values, covariance).rvs(200_000, random_state=0) / np.sqrt(
        np.diag(covariance)
    )
    along = draws @ (values / np.sqrt(np.diag(covariance)))
    assert estimate_sign_probability(values, covariance) == pytest.approx((along > 0.0).mean(), abs=4e-3)
    assert estimate_sign_probability(np.zeros(0), np.zeros((0, 0))) is None


def test_a_range_knows_its_share_and_its_ends() -> None:
    assert Range(-1.96, 1.96).chance(0.0, 1.0) == pytest.approx(0.95, abs=1e-4)
    assert Range(0.0, 1.0).chance(2.0, 0.0) == 0.0
    assert Range(0.0, 1.0).at_end(0.995)
    assert not Range(0.0, 1.0).at_end(0.5)
    assert not Range(0.0, float("inf")).at_end(0.0)


def test_every_kind_has_sizes_with_a_source() -> None:
    content = yaml.safe_load((find_reference_folder() / "effect_sizes.yaml").read_text(encoding="utf-8"))
    assert content.keys() == find_effects().keys()
    for row in content.values():
        assert row["source"]
        assert row["confidence"] in ("high", "medium", "low")
        tables = [row.get(table, {}) for table in ("sizes", "of_body", "of_segment")]
        assert all(low < high for table in tables for low, high in table.values())


def test_masses_are_shares_of_the_person() -> None:
    model = load_builtin("full_body_35dof")
    usual = look_up_usual_sizes(LOAD.candidate, model)("kg")
    assert usual is not None
    assert usual.high == pytest.approx(0.4 * sum_mass(model))


def test_a_load_of_half_the_body_is_reported_as_implausible() -> None:
    """2 kg are met, 60 kg are not; one at its bound is no estimate."""
    heavy = replace(LOAD, effect=replace(LOAD.effect, size=np.array([60.0, 0.1, 0.4, 0.0])))
    for named, doubtful in ((LOAD, False), (heavy, True)):
        document = make_discovery_document(replace(found(), findings=findings(named)))
        belief = document.effects[0].belief
        assert belief is not None
        assert bool(belief.cautions) is doubtful
        assert ("of a size to doubt" in document.headline) is doubtful
        assert (belief.size is not None and belief.size > 0.99) is not doubtful


def test_what_explains_most_carries_the_gap() -> None:
    def of(gain: float, held_out: float) -> NamedEffect:
        return replace(
            SCALE, fitted=replace(SCALE.fitted, gain=gain), held_out=replace(SCALE.held_out, gain=held_out)
        )

    named = [of(100.0, 0.5), of(5.0, 0.3), of(5.0, 0.02), of(20.0, 0.01)]
    assert list(find_carrying(named)) == [True, True, False, True]
    assert list(find_carrying(named[2:3])) == [True]


def test_an_unloaded_plate_speaks_against_a_bias() -> None:
    """Half a second with nobody on the plate, which then shows 2 N: no bias of 90 N, but one of 2 N."""
    someone = person()
    recording = recorded(someone, someone.model)[0]
    n = len(recording.trial.times)
    loads = np.where(np.arange(n) < n // 2, 700.0, 2.0)
    ground = replace(ground_of([[x] for x in loads]), times=recording.trial.times)
    feet = contacts([[0 if x > CONTACT_N else NOBODY] for x in loads], [[True, True]] * n)

    forces = TrialForces(
        Path("made.mot"), ground, feet, assign_foot_loads(ground, feet, {"r": "r", "l": "l"})
    )
    given = replace(recording, contacts=assign_contacts(forces, 5.0))
    fit = fit_recordings(SearchContext(model=someone.model, recordings=[given]))
    bias = next(c for c in propose_plate_biases(fit.scene) if len(c.columns) == 3 and not c.trials)
    assert contradict_bias(bias, np.array([0.0, -90.0, 0.0]), fit.wrenches)
    assert not contradict_bias(bias, np.array([0.0, 2.2, 0.0]), fit.wrenches)
    # Of readings that it was taken off: 2 N are little of 90, and as much as 2.
    assert not contradict_bias(bias, np.array([0.0, -90.0, 0.0]), fit.wrenches, removed=True)
    assert contradict_bias(bias, np.array([0.0, 2.2, 0.0]), fit.wrenches, removed=True)
