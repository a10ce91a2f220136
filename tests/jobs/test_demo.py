"""The demonstration: a virtual person beside its truth."""

from __future__ import annotations

import pytest

from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.model.anatomy.lengths import measure_segment_lengths
from scaling_service.virtual.subject import make_virtual_subject
from tests.finished import Demo


def test_every_method_is_measured_against_the_truth(demo: Demo) -> None:
    results, truth, _ = demo
    assert set(truth.errors) == set(results.scalings)
    for errors in truth.errors.values():
        assert {"lengths_mm", "hip_centre_mm", "knee_centre_mm", "ankle_centre_mm", "knee_angle_deg"} <= set(
            errors
        )
        assert all(0.0 < value < 200.0 for value in errors.values())


def test_lengths_are_near_the_truth(demo: Demo) -> None:
    results, truth, _ = demo
    ours = results.scalings["MB"].geometry.lengths
    mean = sum(abs(1e3 * ours[name] - true) for name, true in truth.segment_lengths_mm.items()) / len(ours)
    assert mean == pytest.approx(truth.errors["MB"]["lengths_mm"], abs=1e-3)  # mm, as rounded


def test_images_lie_nearer_to_the_truth_than_markers(demo: Demo) -> None:
    results, truth, _ = demo
    assert results.session.images is not None
    assert set(results.scalings) == set(METHODS)
    markers, images = truth.errors["MB"], truth.errors["EB"]
    assert images["lengths_mm"] < min(5.0, markers["lengths_mm"])
    # In space, skin movement adds to what the image has wrong.
    assert images["hip_centre_mm"] < min(10.0, markers["hip_centre_mm"])


def test_fitting_from_images_follows_the_markers_better(
    demo: Demo,
) -> None:
    """Of all calibration trials together, as it is their sum that is fitted."""
    results = demo.results
    squares = {
        method: sum(results.scalings[method].errors[t.name].rms ** 2 for t in results.session.calibration)
        for method in ("EB", "EB_am")
    }
    assert squares["EB_am"] < squares["EB"]


def test_progress_rises_from_bones_to_done(demo: Demo) -> None:
    said = [what for what, _ in demo.shares]
    assert said[0] == "making the pelvis"
    assert "landmarks of the tibia_l" in said
    assert said[-1] == "done"
    values = [share for _, share in demo.shares]
    assert values == sorted(values)
    assert values[-1] == pytest.approx(1.0)


def test_the_seed_decides_the_person(demo: Demo) -> None:
    results, truth, _ = demo
    assert results.session.subject.id == "virtual_0"
    for seed, same in ((0, True), (4, False)):
        lengths = measure_segment_lengths(make_virtual_subject(seed).model)
        close = [abs(1e3 * lengths[name] - true) < 1e-3 for name, true in truth.segment_lengths_mm.items()]
        assert all(close) is same
