"""The demonstration: a virtual person beside its truth."""

from __future__ import annotations

import pytest

from scaling_service.jobs.demo import run_demo
from scaling_service.jobs.settings import Settings
from scaling_service.jobs.tasks import Results
from scaling_service.schemas.results import TruthDocument


@pytest.fixture(scope="module")
def demonstration() -> tuple[Results, TruthDocument]:
    return run_demo(Settings(seed=3))


def test_every_method_is_measured_against_the_truth(demonstration: tuple[Results, TruthDocument]) -> None:
    results, truth = demonstration
    assert set(truth.errors) == set(results.scalings)
    for errors in truth.errors.values():
        assert {"lengths_mm", "hip_centre_mm", "knee_centre_mm", "ankle_centre_mm", "knee_angle_deg"} <= set(
            errors
        )
        assert all(0.0 < value < 200.0 for value in errors.values())


def test_lengths_are_near_the_truth(demonstration: tuple[Results, TruthDocument]) -> None:
    results, truth = demonstration
    ours = results.scalings["MB"].geometry.lengths
    mean = sum(abs(1e3 * ours[name] - true) for name, true in truth.segment_lengths_mm.items()) / len(ours)
    assert mean == pytest.approx(truth.errors["MB"]["lengths_mm"], abs=1e-3)  # mm, as rounded


def test_the_seed_decides_the_person(demonstration: tuple[Results, TruthDocument]) -> None:
    _, truth = demonstration
    results, other = run_demo(Settings(seed=4))
    assert other.segment_lengths_mm != truth.segment_lengths_mm
    assert results.session.subject.id != demonstration[0].session.subject.id
