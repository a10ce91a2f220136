"""Skin over bone in the standard deviations of coordinates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scaling_service.capabilities.motion.inverse_kinematics import Task
from scaling_service.capabilities.motion.run import track
from scaling_service.capabilities.motion.uncertainty import cover_with_skin, list_skin_fields
from scaling_service.model.people import read_people
from scaling_service.model.places import tell_landmarks
from tests.capabilities.recorded import recorded


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
    names = [task.markers[k] for k in first.markers]
    bone = made.model.bone_of(made.model.marker(names[0]).segment)
    told = tell_landmarks(made.model)
    places = np.array([made.model.marker(name).nominal for name in names])
    expected = read_people().skin_covariance(bone, [told.get(name) for name in names], places)
    np.testing.assert_allclose(alone.covariance, expected)


def test_a_cluster_that_deforms_more_than_peoples_has_more_skin_and_pins_have_none() -> None:
    made = recorded("lower_limb_14dof", 60, 3)
    task = Task.of(made.model, made.trial)
    calm = next(f for f in list_skin_fields(task) if len(f.markers) > 2)
    shaken = task.measured + np.random.default_rng(0).normal(0.0, 0.05, task.measured.shape)
    wild = next(f for f in list_skin_fields(replace(task, measured=shaken)) if len(f.markers) > 2)
    assert np.all(np.diag(wild.covariance) > 1.2 * np.diag(calm.covariance))
    places = np.zeros((2, 3))
    pinned = cover_with_skin("femur", read_people(), {}, ("LFE_pin", "LFE"), places, 1.0)
    assert np.array_equal(np.diag(pinned) > 0.0, [False] * 3 + [True] * 3)
