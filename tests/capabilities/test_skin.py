"""Skin over bone in the standard deviations of coordinates, beside bones whose true pose was measured."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.motion.inverse_kinematics import Task
from scaling_service.capabilities.motion.run import TrackedTrial, ik, track
from scaling_service.capabilities.motion.uncertainty import list_skin_fields, look_up_published_sd
from scaling_service.numerics.multibody.laws import Array
from tests.capabilities.recorded import recorded

JOINTS = {"femur": "hip", "tibia": "knee", "humerus": "shoulder"}
HELD_OUT = {
    "cadaver_hip": "hipFunct_second",
    "knee_fluoroscopy": "stepUp",
    "knee_pins": "walking",
    "shoulder_pins": "eating",
}


def test_published_sizes_go_by_the_segments_name() -> None:
    assert look_up_published_sd("femur_r") == look_up_published_sd("thigh_left") == pytest.approx(0.012)
    assert look_up_published_sd("calcn_l") < look_up_published_sd("tibia_l") < look_up_published_sd("femur_l")
    assert look_up_published_sd("segment7") > 0.0


def test_deviations_grow_most_where_skin_moves_most_and_not_at_all_on_pins() -> None:
    made = recorded("lower_limb_14dof", 60, 3)
    names = made.model.coordinate_names
    skin, none = (track(made.model, made.trial, skin=yes).uncertainty.sd for yes in (True, False))
    assert (skin >= none).all()
    wider = np.sqrt(skin**2 - none**2).mean(axis=0)
    assert wider[names.index("hip_rotation_r")] > wider[names.index("pelvis_list")] > 0.0
    task = Task.of(made.model, made.trial)
    on_skin = {k for field in list_skin_fields(task) for k in field.markers.tolist()}
    assert on_skin == set(range(len(task.markers)))


@pytest.mark.parametrize("name", HELD_OUT)
def test_intervals_hold_the_angles_between_bones_whose_pose_was_measured(
    shared_data: Path, name: str
) -> None:
    """Pins in the bone or fluoroscopy (Cereatti et al. 2017) against intervals from skin markers alone."""
    folder, trial = shared_data / "living_bone" / name, HELD_OUT[name]
    if not folder.is_dir():
        pytest.skip("recordings over bones of known pose are not here")
    tracked = ik(folder / "model.osim", [folder / f"{trial}.trc"]).trials[trial]
    off, sd = _off(tracked, true_rotations(folder / f"{trial}_bones.csv"))
    assert np.mean(np.abs(off) <= 1.96 * sd) >= 0.90
    assert np.sqrt(np.mean(sd**2)) < 3.0 * np.sqrt(np.mean(off**2))  # wide enough is not enough


def test_two_markers_in_one_place_are_followed() -> None:
    made = recorded("lower_limb_14dof", 60, 3)
    name = next(m.name for m in made.model.markers if m.segment == "femur_r")
    twin = replace(made.model.marker(name), name="TWIN")
    model = made.model.with_markers((*made.model.markers, twin))
    trial = made.trial
    places = np.concatenate([trial.markers, trial.markers[:, [trial.index(name)]]], axis=1)
    sd = track(model, replace(trial, labels=(*trial.labels, "TWIN"), markers=places)).uncertainty.sd
    assert np.isfinite(sd).all()


def test_a_segment_that_is_never_seen_whole_leans_on_published_sizes() -> None:
    made = recorded("lower_limb_14dof", 60, 3)
    task = Task.of(made.model, made.trial)
    first = next(f for f in list_skin_fields(task) if len(f.markers) > 2)
    measured = task.measured.copy()
    for frame in range(len(measured)):
        measured[frame, first.markers[frame % len(first.markers)]] = np.nan
    alone = next(f for f in list_skin_fields(replace(task, measured=measured)) if len(f.markers) > 2)
    segment = made.model.marker(task.markers[first.markers[0]]).segment
    assert np.sqrt(alone.covariance[0, 0]) == pytest.approx(look_up_published_sd(segment))


def true_rotations(path: Path) -> dict[str, Array]:
    """Rotation matrices of the bones, (n, 3, 3), by name in the order of the chain."""
    with path.open() as file:
        names, *rows = list(csv.reader(file))
    values = np.array([[float(v) if v.strip() else np.nan for v in row] for row in rows])
    starts = {n.removesuffix("_r11"): k for k, n in enumerate(names) if n.endswith("_r11")}
    return {bone: values[:, k : k + 9].reshape(-1, 3, 3) for bone, k in starts.items()}


def _off(tracked: TrackedTrial, true: dict[str, Array]) -> tuple[Array, Array]:
    """Joint angles less the true ones, and their standard deviations, rad, all frames in a row."""
    q, sd, names = tracked.motion.q, tracked.uncertainty.sd, tracked.motion.coordinates
    errors, deviations = [], []
    angles = iter(joint_angles(true).T)
    for child in list(true)[1:]:
        for axis in "zxy":
            angle, k = next(angles)[: len(q)], names.index(f"{JOINTS[child]}_{axis}")
            off = (q[: len(angle), k] - angle + np.pi) % (2 * np.pi) - np.pi
            known = np.isfinite(off)
            errors.append(off[known])
            deviations.append(sd[: len(angle), k][known])
    return np.concatenate(errors), np.concatenate(deviations)


def joint_angles(true: dict[str, Array]) -> Array:
    """Turns about Z, X, Y of every bone against its parent, (n, 3 n_joints), rad."""
    columns = []
    for parent, child in zip(true, list(true)[1:], strict=False):
        between = np.einsum("nji,njk->nik", true[parent], true[child])
        columns += [
            np.arctan2(-between[:, 0, 1], between[:, 1, 1]),
            np.arcsin(between[:, 2, 1]),
            np.arctan2(-between[:, 2, 0], between[:, 2, 2]),
        ]
    return np.array(columns).T
