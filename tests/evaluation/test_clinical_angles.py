"""Conventional angles of moving models: the model's own coordinates where both mean the same, and cycles."""

from __future__ import annotations

import csv
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.motion.clinical_angles import (
    compute_clinical_angles,
    compute_clinical_rates,
    cut_clinical_cycles,
    find_clinical_landmarks,
    track_landmarks,
)
from scaling_service.capabilities.motion.run import track
from scaling_service.capabilities.motion.saving import write_clinical_angles
from scaling_service.capabilities.scaling.clinical_gait import compute_clinical_gait
from scaling_service.files.osim.models import read_osim
from scaling_service.model.anatomy.frames import ANGLES, SIDES, compute_conventional_angles
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin
from scaling_service.model.results import Motion
from scaling_service.model.trial import Trial
from scaling_service.virtual.example import make_demo_session
from scaling_service.virtual.subject import VirtualSettings
from tests.capabilities.recorded import recorded

SAME = {
    "hip_flexion": "hip_flexion",
    "hip_adduction": "hip_adduction",
    "hip_internal_rotation": "hip_rotation",
    "knee_flexion": "knee_angle",
}
"""Conventional angle to the built-in models' coordinate, whose axes are anatomical."""


def moving(model: BodyModel, **columns: np.ndarray) -> Motion:
    """A motion of a model in which the named coordinates are as given."""
    frames = len(next(iter(columns.values())))
    q = np.zeros((frames, len(model.coordinates)))
    for name, values in columns.items():
        q[:, model.coordinate_names.index(name)] = values
    names = model.coordinate_names
    return Motion(
        trial="walk",
        times=np.arange(frames) / 100.0,
        coordinates=names,
        q=q,
        markers=(),
        residuals=np.empty((frames, 0, 3)),
        estimated=names,
    )


def wandering(model: BodyModel) -> Motion:
    rng = np.random.default_rng(2)
    return moving(
        model, **{c.name: rng.uniform(-0.4, 0.4, 20) for c in model.coordinates if c.kind == "rotation"}
    )


@pytest.mark.parametrize("name", ["lower_limb_14dof", "lower_limb_feet_18dof", "full_body_35dof"])
def test_hips_and_knees_of_built_in_models_are_their_own_coordinates(name: str) -> None:
    model = load_builtin(name)
    motion = wandering(model)
    found = compute_clinical_angles(model, motion)
    for side in SIDES:
        for angle, coordinate in SAME.items():
            own = motion.q[:, motion.coordinates.index(f"{coordinate}_{side}")]
            np.testing.assert_allclose(found.values[side][angle], own, atol=1e-9, err_msg=f"{angle} {side}")
    tilt, sideways = (motion.q[:, motion.coordinates.index(f"pelvis_{n}")] for n in ("tilt", "list"))
    np.testing.assert_allclose(found.values["r"]["pelvis_anterior_tilt"], -tilt, atol=1e-9)
    np.testing.assert_allclose(found.values["l"]["pelvis_obliquity_up"], sideways, atol=1e-9)


def test_a_foot_is_level_in_the_neutral_pose_and_bends_with_the_ankle() -> None:
    model = load_builtin("lower_limb_feet_18dof")
    bend = np.linspace(-0.3, 0.3, 7)
    found = compute_clinical_angles(model, moving(model, ankle_angle_r=bend))
    torsion = np.radians(
        15.0
    )  # of the malleoli in the built-in model: they bear the conventional shank's plane
    straight = np.arctan2(np.sin(bend), np.cos(bend) * np.cos(torsion))
    # The toe marker lies 8 mm inward of the heel's: the foot's line is 2 deg off the plane of the bend.
    np.testing.assert_allclose(found.values["r"]["ankle_dorsiflexion"], straight, atol=np.radians(0.5))
    assert found.values["r"]["ankle_dorsiflexion"][3] == pytest.approx(0.0, abs=1e-9)
    inward = np.arctan2(0.008, 0.216)  # m: heel to toe marker in lower_limb_feet_18dof.yaml
    np.testing.assert_allclose(
        [found.values[side]["foot_internal_progression"][3] for side in SIDES], inward, atol=1e-3
    )


def test_what_a_model_lacks_locks_or_a_recording_does_not_tell_is_left_out() -> None:
    model = load_builtin("lower_limb_14dof")
    motion = wandering(model)
    found = compute_clinical_angles(model, motion)
    assert "ankle_dorsiflexion" not in found.values["r"]
    assert "knee_adduction" not in found.values["r"]
    assert found.left_out == (
        "ankle and foot: the model has no heel and toe",
        "knee adduction and knee internal rotation: the model's knee does not turn so",
    )
    q = motion.q.copy()
    q[4, motion.coordinates.index("hip_flexion_r")] = np.nan
    seen = tuple(name for name in motion.estimated if name != "knee_angle_l")
    found = compute_clinical_angles(model, replace(motion, q=q, estimated=seen))
    assert np.isnan(found.values["r"]["knee_flexion"]).tolist() == [k == 4 for k in range(20)]
    assert np.isfinite(found.values["l"]["hip_flexion"]).all()
    assert np.isnan(found.values["l"]["knee_flexion"]).all()
    assert any("knee flexion (l)" in sentence for sentence in found.left_out)


@pytest.mark.parametrize(
    ("followed", "doubt"),
    [(("RASIS", "LASIS", "RLFE"), True), (("RASIS", "LASIS", "LPSIS"), False), (("RASIS", "RPSIS"), False)],
)
def test_tilt_is_doubtful_where_only_the_front_of_the_pelvis_is_followed(
    followed: tuple[str, ...], doubt: bool
) -> None:
    model = load_builtin("lower_limb_14dof")
    motion = replace(wandering(model), markers=("LASIS", "RASIS", "RLFE", "RPSIS", "LPSIS"))
    residuals = np.full((20, 5, 3), np.nan)
    residuals[3:, [name in followed for name in motion.markers]] = 0.001
    found = compute_clinical_angles(model, replace(motion, residuals=residuals))
    assert any("no marker behind" in sentence for sentence in found.doubtful) == doubt


def test_a_planar_model_has_none_of_them() -> None:
    model = load_builtin("squat_4dof")
    found = compute_clinical_angles(model, wandering(model))
    assert not found.values["r"]
    assert not found.values["l"]
    assert len(found.left_out) == 3


def test_turns_against_the_way_do_not_depend_on_where_it_leads() -> None:
    """Two strides, the second at a right angle to the first: pelvis and foot count from each stride's way."""
    model = load_builtin("lower_limb_feet_18dof")
    t = np.arange(201) / 100.0
    first = t < 1.0
    turned = np.where(first, 0.0, np.pi / 2) + 0.1 * np.sin(2.0 * np.pi * t)
    x, z = np.minimum(t, 1.0), -np.maximum(t - 1.0, 0.0)
    motion = moving(model, pelvis_tx=x, pelvis_tz=z, pelvis_rotation=turned)
    found = cut_clinical_cycles([(compute_clinical_angles(model, motion), [(0.0, 0.98), (1.02, 2.0)])], "r")
    assert found is not None
    assert found.cycles == (("walk", 0.0, 0.98), ("walk", 1.02, 2.0))
    rotation = found.values["pelvis_internal_rotation"]
    swing = 0.1 * np.sin(2.0 * np.pi * np.linspace(0.0, 0.98, 101))
    np.testing.assert_allclose(rotation[0], swing, atol=0.03)  # the hips' middle swings with the pelvis
    np.testing.assert_allclose(np.ptp(rotation[1]), 0.2, atol=0.01)
    assert abs(rotation[1].mean()) < 0.03


def test_no_cycle_within_what_is_known_is_none() -> None:
    model = load_builtin("lower_limb_14dof")
    motion = moving(model, pelvis_tx=np.full(50, np.nan))
    assert cut_clinical_cycles([(compute_clinical_angles(model, motion), [(0.1, 0.4)])], "l") is None
    assert cut_clinical_cycles([], "r") is None


@pytest.fixture(scope="module")
def walker():
    return make_demo_session(4, VirtualSettings(functional_s=3.0, strides=4.0))


def test_a_walk_of_a_virtual_person_is_read_from_held_out_trials(walker) -> None:
    session, person = walker
    names = person.model.coordinate_names
    motions = {
        t.name: Motion(
            trial=t.name,
            times=t.times,
            coordinates=names,
            q=person.motions[t.name],
            markers=(),
            residuals=np.empty((t.n_frames, 0, 3)),
            estimated=names,
        )
        for t in session.dynamic
    }
    fitted = {trial.name for trial in session.calibration}
    gait = compute_clinical_gait(person.model, motions, session.dynamic, fitted)
    assert gait.held_out
    assert gait.reason == ""
    assert set(gait.recordings) == set(motions)
    for side in SIDES:
        assert {trial for trial, _, _ in gait.cycles[side].cycles}.isdisjoint(fitted)
        knee = np.degrees(gait.cycles[side].values["knee_flexion"])
        assert np.ptp(knee, axis=1) == pytest.approx(
            55.0, abs=15.0
        )  # Schwartz 2008, with this person's own gait
        assert gait.profile.variable_scores[side]["knee_flexion"] < np.radians(15.0)
    assert gait.profile.score is None  # without feet
    none = compute_clinical_gait(person.model, motions, [t for t in session.dynamic if t.name in fitted], ())
    assert not none.cycles
    assert none.reason


@pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")
def test_an_opensim_model_bends_its_knee_as_far_as_its_coordinate_says(shared_data: Path) -> None:
    """Rajagopal's knee glides and turns a little while it bends."""
    model = read_osim(shared_data / "rajagopal_walk" / "Rajagopal2016.osim")
    bend = np.radians(np.linspace(0.0, 60.0, 13))
    found = compute_clinical_angles(model, moving(model, knee_angle_r=bend, hip_flexion_l=bend)).values
    knee = found["r"]["knee_flexion"]
    np.testing.assert_allclose(np.degrees(knee - knee[0]), np.degrees(bend), atol=3.0)
    np.testing.assert_allclose(
        found["l"]["hip_flexion"] - found["l"]["hip_flexion"][0], bend, atol=np.radians(1.0)
    )


def test_labels_of_a_trial_do_not_matter(walker) -> None:
    """Angles come from the model: only cycles are found in markers."""
    session, person = walker
    trial: Trial = session.evaluation[0]
    names = person.model.coordinate_names
    motion = Motion(
        trial=trial.name,
        times=trial.times,
        coordinates=names,
        q=person.motions[trial.name],
        markers=(),
        residuals=np.empty((trial.n_frames, 0, 3)),
        estimated=names,
    )
    bare = trial.select(["X1"])
    gait = compute_clinical_gait(person.model, {trial.name: motion}, [bare])
    assert not gait.cycles
    assert gait.reason == f"{trial.name}: no marker of the pelvis is seen"
    assert np.isfinite(gait.recordings[trial.name].values["r"]["knee_flexion"]).all()


def test_rates_are_those_of_the_angles() -> None:
    """Central differences of the angles themselves, coordinate by coordinate."""
    made = recorded("lower_limb_feet_18dof", 6, 3)
    model, q = made.model, made.q
    names, rates = compute_clinical_rates(model)
    assert set(names) == {(side, name) for side in SIDES for name in ANGLES}

    def angles(values: np.ndarray) -> np.ndarray:
        motion = moving(model, **dict(zip(model.coordinate_names, values.T, strict=True)))
        points = track_landmarks(model, motion, find_clinical_landmarks(model))
        return np.stack([compute_conventional_angles(points, side)[name] for side, name in names], axis=1)

    found, step = rates(q), 1e-5
    for k in range(q.shape[1]):
        ends = [angles(q + sign * step * np.eye(q.shape[1])[k]) for sign in (1.0, -1.0)]
        np.testing.assert_allclose(found[:, :, k], (ends[0] - ends[1]) / (2.0 * step), atol=1e-6)


def test_a_hinges_deviation_is_that_of_its_coordinate(tmp_path: Path) -> None:
    """Knee flexion is the model's own coordinate, so both are known equally well; and the file holds it."""
    made = recorded("lower_limb_feet_18dof", 40, 3)
    tracked = track(made.model, made.trial, angles=True)
    assert tracked.angles is not None
    own = tracked.uncertainty.sd[:, made.model.coordinate_names.index("knee_angle_r")]
    np.testing.assert_allclose(tracked.angles.sd["r"]["knee_flexion"], own, rtol=1e-3)
    write_clinical_angles(tmp_path, tracked.angles)
    with next(tmp_path.glob("*_clinical.csv")).open() as file:
        first = next(csv.DictReader(file))
    assert float(first["knee_flexion_r_sd_deg"]) == pytest.approx(np.degrees(own[0]), abs=1e-3)
