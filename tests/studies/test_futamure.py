"""The study of Futamure et al.: persons as drawn, claims that can be answered, a page with them."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.model.inertia import sum_mass
from scaling_service.numerics.wrench import GRAVITY
from scaling_service.studies.claims import draw_person_seeds
from scaling_service.studies.futamure.claims import assess_less
from scaling_service.studies.futamure.result import FutamureDocument
from scaling_service.studies.futamure.squatters import OVER_FOOT_M, make_virtual_squatter
from scaling_service.studies.futamure.study import WAYS, reproduce_futamure, study_squatter
from scaling_service.studies.futamure.words import summarise


def test_a_squatter_stands_on_the_foot_and_weighs_what_he_weighs() -> None:
    person = make_virtual_squatter(4)
    wrench = person.fitted.wrench
    assert sum_mass(person.model) == pytest.approx(person.mass_kg)
    assert wrench[:, 1].mean() == pytest.approx(-GRAVITY[1] * person.mass_kg, rel=0.01)
    pressure = wrench[:, 5] / wrench[:, 1]
    assert pressure.mean() == pytest.approx(OVER_FOOT_M, abs=0.02)
    assert (pressure > -0.06).all()
    assert (pressure < 0.2).all()


def test_the_same_seed_is_the_same_person_and_another_is_not() -> None:
    first, again, other = make_virtual_squatter(2), make_virtual_squatter(2), make_virtual_squatter(5)
    np.testing.assert_array_equal(first.fitted.trial.markers, again.fitted.trial.markers)
    assert first.height_m != other.height_m


@pytest.fixture(scope="module")
def document() -> FutamureDocument:
    """Of one person."""
    return reproduce_futamure(seed=0, subjects=1, worker_count=1)


def test_the_study_answers_every_claim_and_shows_it(document: FutamureDocument) -> None:
    assert len(document.claims) == 10
    assert (
        document.persons[0].fitted.consistent.wrench_rmse[0]
        < document.persons[0].fitted.classical.wrench_rmse[0]
    )
    page = summarise(document).html()
    for claim in document.claims:
        assert claim.where in page
    undecided = [claim for claim in document.claims if claim.holds is None]
    assert undecided  # one person is too few for a test


def test_the_signed_rank_test_is_one_sided() -> None:
    low, high = np.arange(8.0), np.arange(8.0) + np.linspace(1.0, 2.0, 8)
    assert assess_less(low, high) == pytest.approx(2.0**-8)
    assert assess_less(high, low) == pytest.approx(1.0)


@pytest.mark.costly  # a person more
def test_faults_are_what_costs_the_angles(document: FutamureDocument) -> None:
    clean, usual = study_squatter(*draw_person_seeds(0, 1), faults=0.0), document.persons[0]
    assert clean.name == usual.name
    for way in WAYS:
        ours, theirs = (getattr(person.fitted, way).angle_rmse_deg for person in (clean, usual))
        assert np.mean(ours) < np.mean(theirs)
