"""Distances from a known truth: zero for the truth itself, and known for a known difference."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.capabilities.scaling.comparison.geometry import (
    compute_angle_errors,
    compute_centre_errors,
    compute_length_errors,
)
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import repeat_default_pose
from scaling_service.model.results import Motion
from scaling_service.model.scaling import scale_model

N = 4


def motion(model: BodyModel, **changed: float) -> Motion:
    q = repeat_default_pose(model, N)
    for name, value in changed.items():
        q[:, model.coordinate_names.index(name)] += value
    return Motion(
        trial="walk",
        times=np.arange(N) / 100.0,
        coordinates=model.coordinate_names,
        q=q,
        markers=(),
        residuals=np.zeros((N, 0, 3)),
        estimated=(),
    )


@pytest.fixture
def truth() -> BodyModel:
    return load_builtin("lower_limb_14dof")


def test_the_truth_has_no_error(truth: BodyModel) -> None:
    same = motion(truth)
    assert set(compute_length_errors(truth, truth).values()) == {0.0}
    assert set(compute_centre_errors(truth, [same], truth, {"walk": same.q}).values()) == {0.0}
    assert set(compute_angle_errors([same], truth, {"walk": same.q}).values()) == {0.0}


def test_a_longer_thigh_is_reported_as_such(truth: BodyModel) -> None:
    longer = scale_model(truth, {"femur_r": (1.1, 1.1, 1.1)})
    errors = compute_length_errors(longer, truth)
    assert errors.pop("femur_r") == pytest.approx(0.1 * 0.43245)
    assert list(errors.values()) == pytest.approx([0.0] * len(errors), abs=1e-15)
    # Standing straight: knee and ankle of that leg are lower, those of the other are where they were.
    centres = compute_centre_errors(longer, [motion(longer)], truth, {"walk": repeat_default_pose(truth, N)})
    assert centres == pytest.approx({"hip": 0.0, "knee": 0.05 * 0.43245, "ankle": 0.05 * 0.43245}, abs=1e-12)


def test_angles_are_pooled_over_sides_and_the_root_is_none(truth: BodyModel) -> None:
    moved = motion(truth, hip_flexion_r=0.3, hip_flexion_l=-0.4, pelvis_tilt=1.0, pelvis_tx=2.0)
    errors = compute_angle_errors([moved], truth, {"walk": repeat_default_pose(truth, N)})
    assert errors.pop("hip_flexion") == pytest.approx(np.sqrt((0.09 + 0.16) / 2))
    assert errors == {"hip_adduction": 0.0, "hip_rotation": 0.0, "knee_angle": 0.0}


def test_a_body_moved_as_a_whole_has_its_centres_moved_as_much(truth: BodyModel) -> None:
    moved = motion(truth, pelvis_tx=0.03, pelvis_tz=-0.04)
    centres = compute_centre_errors(truth, [moved], truth, {"walk": repeat_default_pose(truth, N)})
    assert centres == pytest.approx({"hip": 0.05, "knee": 0.05, "ankle": 0.05})


def test_frames_that_are_not_determined_are_passed_over(truth: BodyModel) -> None:
    moved = motion(truth, knee_angle_r=0.2, knee_angle_l=0.2)
    moved.q[0] = np.nan
    errors = compute_angle_errors([moved], truth, {"walk": repeat_default_pose(truth, N)})
    assert errors["knee_angle"] == pytest.approx(0.2)
