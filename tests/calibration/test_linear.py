"""Linear scaling against known sizes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scaling_service.capabilities.scaling.methods.marker_based import compute_setup_factors, scale_linearly
from scaling_service.capabilities.shared.settings import CalibrationSettings
from scaling_service.core.errors import TrialUnusable
from scaling_service.model.anatomy.hip_centre import predict_hip_centres
from scaling_service.model.builtin import load_builtin
from scaling_service.model.subject import Measurement, ScaleSetup
from tests.calibration.people import person

SETTINGS = CalibrationSettings(sizes="measured")


def test_a_uniformly_larger_person_gets_one_factor_everywhere() -> None:
    k = 1.13
    session = person(
        1, factors=dict.fromkeys(load_builtin("lower_limb_14dof").segment_names, (k, k, k))
    ).session
    found = scale_linearly(session, SETTINGS).scale_factors
    assert found["pelvis"] == pytest.approx((k, k, k), rel=1e-12)
    assert found["tibia_r"] == pytest.approx((k, k, k), rel=1e-12)
    # the hip regression has a constant part, so a thigh does not scale exactly with its markers
    assert found["femur_r"] == pytest.approx((k, k, k), rel=0.01)


def test_the_pelvis_takes_the_mean_of_four_ratios() -> None:
    session = person(2, shift_m=0.01).session
    points = {n: session.static.position(n).mean(axis=0) for n in ("RASIS", "LASIS", "RPSIS", "LPSIS")}
    generic = {m.name: np.array(m.nominal) for m in session.model.markers}
    pairs = (("RASIS", "LASIS"), ("RPSIS", "LPSIS"), ("RASIS", "RPSIS"), ("LASIS", "LPSIS"))
    ratios = [
        np.linalg.norm(points[a] - points[b]) / np.linalg.norm(generic[a] - generic[b]) for a, b in pairs
    ]
    assert scale_linearly(session, SETTINGS).scale_factors["pelvis"][0] == pytest.approx(
        np.mean(ratios), rel=1e-12
    )


def test_the_thigh_runs_from_the_regressed_hip_to_the_middle_of_the_epicondyles() -> None:
    session = person(3, shift_m=0.01).session
    at = session.static.position
    pelvis = [at(n) for n in ("RASIS", "LASIS", "RPSIS", "LPSIS")]
    hips = predict_hip_centres(*pelvis)
    knee = 0.5 * (at("RLFE") + at("RMFE"))
    length = np.linalg.norm(hips.right_ground - knee, axis=1).mean()
    generic = {m.name: np.array(m.nominal) for m in session.model.markers}
    model = np.linalg.norm(0.5 * (generic["RLFE"] + generic["RMFE"]))
    assert scale_linearly(session, SETTINGS).scale_factors["femur_r"][0] == pytest.approx(
        length / model, rel=1e-12
    )


def test_where_the_laboratory_stands_changes_no_factor() -> None:
    session = person(4, shift_m=0.01).session
    turn = Rotation.from_rotvec([0.3, 1.2, -0.4]).as_matrix()
    moved = session.static.with_markers(session.static.markers @ turn.T + [1.0, 2.0, 3.0])
    first, second = (
        scale_linearly(s, SETTINGS).scale_factors for s in (session, replace(session, static=moved))
    )
    for segment in first:
        assert first[segment] == pytest.approx(second[segment], rel=1e-9)


def test_left_and_right_are_independent() -> None:
    session = person(5, factors={"femur_l": (1.1, 1.1, 1.1)}).session
    found = scale_linearly(session, SETTINGS).scale_factors
    assert found["tibia_r"] == pytest.approx((1.0, 1.0, 1.0), rel=1e-9)
    assert found["femur_l"][0] > found["femur_r"][0] + 0.05


def test_without_a_static_trial_the_movement_is_measured_and_it_says_so() -> None:
    session = replace(person(6).session, static=None)
    found = scale_linearly(session, SETTINGS)
    assert found.scale_factors["tibia_r"][0] == pytest.approx(1.0, abs=0.2)
    assert any("no static trial" in w for w in found.warnings)


def test_no_landmark_at_all_is_refused() -> None:
    session = person(7).session
    nameless = replace(session.static, labels=tuple(f"m{k}" for k in range(len(session.static.labels))))
    with pytest.raises(TrialUnusable, match="no segment could be measured"):
        scale_linearly(replace(session, static=nameless, calibration=()), SETTINGS)


def test_a_unit_mistaken_is_refused() -> None:
    session = person(8).session
    huge = session.static.with_markers(session.static.markers * 1000.0)
    with pytest.raises(TrialUnusable, match="Check the unit"):
        scale_linearly(replace(session, static=huge), SETTINGS)


def test_a_set_up_scales_named_axes_in_its_order() -> None:
    session = person(9, factors={"tibia_r": (1.2, 1.2, 1.2)}).session
    setup = ScaleSetup(
        measurements=(
            Measurement("shank", (("RFH", "RLM"), ("RFH", "RMM")), {"tibia_r": "Y", "femur_r": "XZ"}),
        ),
        manual={"tibia_r": (2.0, 2.0, 2.0)},
        order=("manualScale", "measurements"),
        time_range=None,
        preserve_mass_distribution=True,
        mass_kg=None,
        placement=None,
    )
    found = compute_setup_factors(session.model, session.static, setup)
    assert found["tibia_r"] == pytest.approx((2.0, 1.2, 2.0), rel=1e-9)
    assert found["femur_r"] == pytest.approx((1.2, 1.0, 1.2), rel=1e-9)
    assert found["pelvis"] == (1.0, 1.0, 1.0)


def test_markers_on_one_spot_cannot_be_measured() -> None:
    session = person(10).session
    markers = session.static.markers.copy()
    markers[:, session.static.index("RLM")] = markers[:, session.static.index("RFH")]
    setup = ScaleSetup(
        measurements=(Measurement("shank", (("RFH", "RLM"),), {"tibia_r": "XYZ"}),),
        manual={},
        order=("measurements",),
        time_range=None,
        preserve_mass_distribution=True,
        mass_kg=None,
        placement=None,
    )
    with pytest.raises(TrialUnusable, match="less than 10 mm apart"):
        compute_setup_factors(session.model, session.static.with_markers(markers), setup)
