"""Legs with feet: scaled by their own markers, fitted, imaged to the ankle, and on real recordings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.capabilities.scaling.methods.marker_based import scale_linearly
from scaling_service.capabilities.scaling.methods.table import METHODS, calibrate
from scaling_service.capabilities.scaling.result import Results
from scaling_service.capabilities.scaling.run import compare
from scaling_service.capabilities.shared.settings import CalibrationSettings
from scaling_service.model.anatomy.lengths import find_joint_centres, measure_segment_lengths
from scaling_service.model.builtin import load_builtin
from scaling_service.model.results import Calibration
from tests.calibration.people import KNEES, imaged, person
from tests.jobs.laboratory import write_subject

FEET = "lower_limb_feet_18dof"
MEASURED = CalibrationSettings(sizes="measured")
ANKLES = [f"ankle_{turn}_{side}" for turn in ("angle", "inversion") for side in "rl"]


def test_a_foot_is_scaled_from_the_heel_to_the_metatarsal_heads() -> None:
    factors = {"calcn_r": (1.12,) * 3, "calcn_l": (0.94,) * 3, "tibia_r": (1.05,) * 3}
    found = scale_linearly(person(51, factors=factors, model=FEET).session, MEASURED).scale_factors
    for segment in ("calcn_r", "calcn_l", "tibia_r", "tibia_l"):
        assert found[segment] == pytest.approx(factors.get(segment, (1.0,) * 3), rel=1e-9)


def test_without_feet_the_leg_is_the_same() -> None:
    """The feet's markers take no part in the sizes of the others, nor in their lengths."""
    known = person(52, shift_m=0.005, model=FEET)
    bare = replace(known.session, model=load_builtin("lower_limb_14dof"))
    with_feet, without = (scale_linearly(s, MEASURED) for s in (known.session, bare))
    for segment, factors in without.scale_factors.items():
        assert with_feet.scale_factors[segment] == pytest.approx(factors, rel=1e-12)
    assert measure_segment_lengths(with_feet.model) == pytest.approx(
        measure_segment_lengths(without.model), rel=1e-9
    )
    assert find_joint_centres(with_feet.model)["ankle_r"][0] == "tibia_r"


@pytest.mark.parametrize(
    ("method", "free"), [("MB_am", {"x", "z"}), pytest.param("MB_lam", {"z"}, marks=pytest.mark.costly)]
)
def test_the_heights_of_foot_markers_give_the_ankles_their_zero(method: str, free: set[str]) -> None:
    known = person(56, noise_m=0.001, seconds=2.0, model=FEET)
    fitted = calibrate(known.session, method).parameters
    assert {p.name[-1] for p in fitted if p.group == "marker" and p.target in ("RHEE", "LMT5")} == free
    other = calibrate(person(56, seconds=2.0, model="full_body_35dof").session, method).parameters
    assert {p.name[-1] for p in other if p.target == "RHEE"} > {"z"}  # one turn: as the other markers


@pytest.mark.parametrize("method", sorted(METHODS))
def test_every_method_follows_the_feet(method: str) -> None:
    known = person(53, shift_m=0.004, noise_m=0.001, seconds=4.0, model=FEET)
    images = imaged(known, dict.fromkeys(KNEES, (0.0, 0.0, 0.0)))
    found = calibrate(replace(known.session, images=images), method)
    motion = inverse_kinematics(found.model, known.session.evaluation[0])
    assert set(ANKLES) <= set(motion.estimated)
    assert float(np.nanmean(motion.distances)) < 0.05
    shifted = {p.target for p in found.parameters if p.group == "marker"}
    assert ({"RHEE", "LMT5"} <= shifted) == (method not in ("MB", "EB"))


def test_feet_are_found_without_noise() -> None:
    factors = {"calcn_r": (1.06,) * 3, "tibia_l": (0.97,) * 3}
    known = person(54, factors=factors, model=FEET)
    ones = dict.fromkeys(known.truth.segment_names, (1.0, 1.0, 1.0))
    start = Calibration(
        method="MB", model=known.session.model, generic=known.session.model, scale_factors=ones
    )
    found = calibrate(known.session, "MB_lam", known={"MB": start})
    assert found.cost < 1e-14
    size = next(p for p in found.parameters if p.name == "scale.calcn_r")
    assert size.identifiable
    assert size.value == pytest.approx(1.06, abs=1e-6)


def test_an_image_places_the_ankle_on_which_the_foot_turns() -> None:
    known = person(55, factors={"tibia_r": (1.1,) * 3}, model=FEET)
    images = imaged(known, dict.fromkeys(KNEES, (0.0, 0.0, 0.0)))
    found = calibrate(replace(known.session, images=images), "EB")
    true, ours = find_joint_centres(known.truth)["ankle_r"][1], find_joint_centres(found.model)["ankle_r"][1]
    assert ours == pytest.approx(true, abs=1e-9)


def compared(folder: Path, tmp: Path, files: tuple[str, str, str], **more: Any) -> Results:
    static, fitted, held_out = (str(folder / name) for name in files)
    content = {
        "subject": {"id": "walker"},
        "model": FEET,
        "trials": {"static": static, "calibration": [fitted], "evaluation": [held_out]},
    }
    return compare(write_subject(tmp, content | more), ("MB", "MB_am"))


SANE = 15e-3
"""m; chosen: twice the 6.5 mm of Puchaud 2019 (table 5, MB_a,m*) plus room for other bodies and markers."""

FOOT_M = (0.20, 0.32)
"""From heel to toe tip. Chosen: a fifth to either side of a generic foot in a shoe."""


def check_feet(results: Results, trial: str) -> None:
    scaling = results.scalings["MB_am"]
    assert set(ANKLES) <= set(scaling.motions[trial].estimated)
    error = scaling.errors[trial]
    assert error.mean < SANE
    assert max(error.per_marker[name] for name in ("RHEE", "LHEE", "RMT5", "LMT5")) < 2.0 * SANE
    whole = 0.1822 + 0.066  # m: of the generic foot, ankle to toe tip and heel to ankle
    for side in "rl":
        assert FOOT_M[0] < whole * scaling.calibration.scale_factors[f"calcn_{side}"][0] < FOOT_M[1]
        flexion = np.degrees(
            scaling.motions[trial].q[:, scaling.motions[trial].coordinates.index(f"ankle_angle_{side}")]
        )
        assert 15.0 < np.ptp(flexion[np.isfinite(flexion)]) < 70.0  # 25 deg in walking (Schwartz 2008)


def test_a_patient_walks_on_feet(shared_data: Path, tmp_path: Path) -> None:
    results = compared(shared_data / "jia_mri", tmp_path, ("Static.c3d", "Walking02.c3d", "Walking01.c3d"))
    assert results.loaded.markers_used["RMT1"] == ("RD1M",)
    check_feet(results, "Walking01")


@pytest.mark.costly
def test_a_walker_on_shoes(shared_data: Path, tmp_path: Path) -> None:
    """Their toe marker is at the tip: named by the user, placed from the static trial."""
    results = compared(
        shared_data / "rajagopal_walk",
        tmp_path,
        ("static_walk_1.trc", "static_walk_2.trc", "motion_capture_walk.trc"),
        markers={"RTOE": "R.Toe", "LTOE": "L.Toe"},
    )
    check_feet(results, "motion_capture_walk")
