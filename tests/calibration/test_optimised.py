"""Optimisation-based scaling against known people."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.capabilities.scaling.methods.fitting import choose_calibration_frames
from scaling_service.capabilities.scaling.methods.optimised import select_coordinates
from scaling_service.capabilities.scaling.methods.table import METHODS, calibrate
from scaling_service.capabilities.shared.settings import CalibrationSettings
from scaling_service.core.errors import SubjectInvalid, TrialUnusable
from scaling_service.model.results import Calibration
from tests.calibration.people import KNEES, Person, imaged, person

TILTS = {"knee_r": (4.0, -6.0, 0.0), "knee_l": (-5.0, 3.0, 0.0)}


def start_at(known: Person) -> Calibration:
    """The person's true size as a first guess."""
    ones = dict.fromkeys(known.truth.segment_names, (1.0, 1.0, 1.0))
    return Calibration(
        method="MB", model=known.session.model, generic=known.session.model, scale_factors=ones
    )


@pytest.mark.parametrize("method", sorted(METHODS))
def test_every_method_gives_a_whole_calibration(method: str) -> None:
    known = person(11, shift_m=0.005, noise_m=0.001, seconds=4.0)
    images = imaged(known, dict.fromkeys(KNEES, (0.0, 0.0, 0.0)))
    found = calibrate(replace(known.session, images=images), method)
    assert found.method == method
    assert not found.model.parameters
    assert set(found.scale_factors) == set(found.model.segment_names)
    assert found.wall_s > 0.0
    motion = inverse_kinematics(found.model, known.session.evaluation[0])
    assert set(motion.estimated) == set(found.model.coordinate_names)
    assert float(np.nanmean(motion.distances)) < 0.05


def test_noise_free_axes_are_found_where_markers_are_known() -> None:
    known = person(12, tilts_deg=TILTS)
    found = calibrate(known.session, "MB_am", known={"MB": start_at(known)})
    assert found.cost < 1e-16
    motion = inverse_kinematics(found.model, known.session.evaluation[0])
    assert float(motion.distances.max()) < 1e-7
    values = {p.name: p for p in found.parameters}
    for joint in KNEES:
        tilt = values[f"axis.{joint}.x"]
        if tilt.identifiable:
            assert np.rad2deg(tilt.value) == pytest.approx(TILTS[joint][0], abs=1e-4)


def test_identifiable_parameters_are_recovered_from_noise_free_markers() -> None:
    factors = {"femur_r": (1.05,) * 3, "tibia_r": (0.95,) * 3, "pelvis": (1.04,) * 3, "femur_l": (0.97,) * 3}
    known = person(13, factors=factors, tilts_deg=TILTS)
    found = calibrate(known.session, "MB_lam", known={"MB": start_at(known)})
    assert found.cost < 1e-14
    sure = {p.name: p.value for p in found.parameters if p.identifiable}
    assert {"scale.femur_r", "scale.tibia_r"} <= set(sure)
    for name, value in sure.items():
        segment = name.removeprefix("scale.")
        if name.startswith("scale."):
            assert value == pytest.approx(factors.get(segment, (1.0,))[0], abs=1e-6), name


@pytest.mark.parametrize("method", ["MB_lam", "MB_am"])
def test_together_is_never_worse_than_the_papers_loop(method: str) -> None:
    known = person(14, shift_m=0.006, tilts_deg=TILTS, noise_m=0.002, seconds=6.0)
    together = calibrate(known.session, method, CalibrationSettings(strategy="joint"))
    in_turn = calibrate(known.session, method, CalibrationSettings(strategy="alternating"))
    assert together.cost <= in_turn.cost * (1.0 + 1e-9)


@pytest.mark.parametrize("strategy", ["joint", "alternating"])
def test_bounds_are_kept_and_reported(strategy: str) -> None:
    known = person(15, shift_m=0.02, noise_m=0.001, seconds=4.0)
    settings = CalibrationSettings(strategy=strategy, marker_bound_m=0.004, axis_bound_x_deg=1.0)
    found = calibrate(known.session, "MB_am", settings)
    for parameter in found.parameters:
        bound = {"marker": 0.004, "axis": np.deg2rad(30.0)}[parameter.group]
        assert abs(parameter.value) <= bound + 1e-12
    assert any(p.at_bound for p in found.parameters)
    assert any("at their bounds" in w for w in found.warnings)


def test_the_cost_is_the_cumulative_kinematic_error_of_its_own_model() -> None:
    known = person(16, shift_m=0.006, noise_m=0.002, seconds=4.0)
    found = calibrate(known.session, "MB_am")
    names = [m.name for m in found.model.markers if m.weight > 0]
    frames = choose_calibration_frames(known.session.calibration, names, 100)
    motion = inverse_kinematics(found.model, frames.trial)
    assert float((motion.residuals**2).sum()) == pytest.approx(found.cost, rel=1e-6)


def test_frames_are_equally_spaced_over_all_trials() -> None:
    session = person(17, seconds=2.0).session
    frames = choose_calibration_frames((session.calibration[0], session.evaluation[0]), ("RASIS",), 100)
    both = np.concatenate([t.position("RASIS") for t in (session.calibration[0], session.evaluation[0])])
    rows = np.linspace(0, 399, 100).round().astype(int)
    assert np.array_equal(frames.trial.markers[:, 0], both[rows])
    assert np.array_equal(frames.blocks, rows // 100)  # each of two trials in two parts


def test_markers_never_seen_in_the_movement_are_not_freed() -> None:
    session = person(18, seconds=4.0).session
    hidden = session.calibration[0].select([n for n in session.static.labels if n not in ("RMFE", "RMM")])
    found = calibrate(replace(session, calibration=(hidden,)), "MB_am")
    assert not [p for p in found.parameters if p.target in ("RMFE", "RMM")]
    assert found.model.marker("RMFE").nominal == calibrate(session, "MB").model.marker("RMFE").nominal


def test_nothing_to_calibrate_on_is_refused() -> None:
    with pytest.raises(TrialUnusable, match=r"trials\.calibration"):
        calibrate(replace(person(19, seconds=1.0).session, calibration=()), "MB_am")


def test_an_unknown_method_is_refused_with_the_known_ones() -> None:
    with pytest.raises(SubjectInvalid, match="MB_lam"):
        calibrate(person(20, seconds=1.0).session, "XB")


def test_table_1_of_the_paper() -> None:
    table = {"RPSIS": "xz", "L.ASIS": "xz", "RKNE": "", "LMFE": "xz", "RFH": "xz", "RANK": "", "RMM": "x"}
    assert {name: select_coordinates(name) for name in table} == table
