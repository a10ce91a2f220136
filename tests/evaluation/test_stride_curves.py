"""Curves over strides and centres seen from another model, on a virtual person whose motion is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.scaling.comparison.curves import list_leg_coordinates, make_stride_curves
from scaling_service.capabilities.scaling.comparison.gait_cycles import find_gait_cycles
from scaling_service.capabilities.scaling.comparison.geometry import place_centres
from scaling_service.model.anatomy.lengths import find_joint_centres
from scaling_service.model.results import Motion
from scaling_service.model.scaling import scale_model
from scaling_service.virtual.example import make_demo_session
from scaling_service.virtual.subject import VirtualSettings


@pytest.fixture(scope="module")
def walker():
    return make_demo_session(4, VirtualSettings(functional_s=3.0, strides=4.0))


def _motion(person, trial, q=None):
    names = person.model.coordinate_names
    truth = person.motions[trial.name] if q is None else q
    return Motion(
        trial=trial.name,
        times=trial.times,
        coordinates=names,
        q=truth,
        markers=(),
        residuals=np.zeros((trial.n_frames, 0, 3)),
        estimated=names,
    )


def test_curves_are_the_means_of_the_strides(walker):
    session, person = walker
    true = {t.name: _motion(person, t) for t in session.dynamic}
    more = {n: replace(m, q=m.q + 0.1) for n, m in true.items()}
    found = make_stride_curves(session.dynamic, {"MB": true, "EB": more}, person.model)
    assert set(found.curves["MB"]) == {
        f"{name}_{s}" for name in ("hip_flexion", "hip_adduction", "hip_rotation", "knee_angle") for s in "rl"
    }
    for side in ("r", "l"):
        cycles = {t.name: find_gait_cycles(t, side).cycles for t in session.dynamic}
        assert found.strides[side] == sum(map(len, cycles.values())) > 4
        column = person.model.coordinate_names.index(f"knee_angle_{side}")
        starts = [
            np.interp(start, true[name].times, true[name].q[:, column])
            for name, pairs in cycles.items()
            for start, _ in pairs
        ]
        curve = found.curves["MB"][f"knee_angle_{side}"]
        assert curve[0] == pytest.approx(np.mean(starts), abs=1e-3)  # rad: straight lines between frames
        assert np.degrees(np.ptp(curve)) == pytest.approx(55.0, abs=15.0)  # Schwartz 2008: 55 deg
        np.testing.assert_allclose(found.curves["EB"][f"knee_angle_{side}"] - curve, 0.1, atol=1e-9)


def test_a_stride_with_an_undetermined_angle_counts_for_no_method(walker):
    session, person = walker
    trial = session.evaluation[0]
    (start, end), *_ = find_gait_cycles(trial, "r").cycles
    q = person.motions[trial.name].copy()
    q[(trial.times > start + 0.4) & (trial.times < end - 0.4), 9] = np.nan
    assert list_leg_coordinates(person.model, "r").count(person.model.coordinate_names[9]) == 1
    whole, holed = _motion(person, trial), _motion(person, trial, q)
    before = make_stride_curves([trial], {"MB": {trial.name: whole}, "EB": {trial.name: whole}}, person.model)
    after = make_stride_curves([trial], {"MB": {trial.name: whole}, "EB": {trial.name: holed}}, person.model)
    assert after.strides["r"] == before.strides["r"] - 1
    assert after.strides["l"] == before.strides["l"]
    assert np.isfinite(after.curves["MB"]["knee_angle_r"]).all()


def test_who_does_not_walk_has_a_reason(walker):
    session, person = walker
    motions = {"MB": {t.name: _motion(person, t) for t in session.calibration}}
    found = make_stride_curves(session.calibration, motions, person.model)
    assert found.curves == {"MB": {}}
    assert found.strides == {"r": 0, "l": 0}
    assert "hip_r: the pelvis stays in place" in found.reasons["r"]


def test_a_model_seen_from_itself_has_its_own_centres(walker):
    _, person = walker
    q = person.motions["gait_1"]
    found = place_centres(person.model, q, person.model, q)
    own = find_joint_centres(person.model)
    assert set(found) == set(own)
    for name, place in found.items():
        np.testing.assert_allclose(place, own[name][1], atol=1e-9)


def test_another_size_shows_as_a_shift_and_carrying_both_about_changes_nothing(walker):
    _, person = walker
    q = person.motions["gait_1"]
    # Twice the pelvis about its origin, the rest as it was: hips lie twice as far out, seen from the truth.
    wide = scale_model(person.model, {"pelvis": (1.0, 1.0, 2.0)})
    found = place_centres(wide, q, person.model, q)
    own = find_joint_centres(person.model)["hip_r"][1]
    np.testing.assert_allclose(found["hip_r"], np.array(own) * [1.0, 1.0, 2.0], atol=1e-9)
    away = q.copy()
    away[:, [person.model.coordinate_names.index(f"pelvis_t{axis}") for axis in "xyz"]] += [3.0, -1.0, 2.0]
    for name, place in place_centres(wide, away, person.model, away).items():
        np.testing.assert_allclose(place, found[name], atol=1e-9)
    holed = q.copy()
    holed[5] = np.nan
    assert place_centres(wide, holed, person.model, q)["hip_r"] == pytest.approx(found["hip_r"], abs=1e-9)
