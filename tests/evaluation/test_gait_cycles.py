"""Gait cycles from markers against virtual persons, whose phase is known, and against force plates."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.scaling.comparison.gait_cycles import find_gait_cycles
from scaling_service.core.streams import stream
from scaling_service.files.recording import read_recording
from scaling_service.files.sto import read_sto
from scaling_service.model.anatomy.markers import find_canonical
from scaling_service.model.trial import Trial
from scaling_service.recording.orientation import decide
from scaling_service.recording.pipeline import process
from scaling_service.virtual.example import make_demo_session
from scaling_service.virtual.motion import draw_style
from scaling_service.virtual.subject import VirtualSettings

SEEDS = range(6)
LONG = VirtualSettings(strides=6.0, functional_s=4.0, gait_trials=1)


@pytest.fixture(scope="module")
def persons():
    return [make_demo_session(seed, LONG) for seed in SEEDS]


def _true_contacts(person, trial, side):
    """Where the stride's phase is 0 (right) or a half (left): how ``virtual_motion.walking`` draws it."""
    stride_s = draw_style(stream(person.seed, "style"), person.sex).stride_s
    start = stream(person.seed, "motion", "gait", 1).uniform()
    later = 0.0 if side == "r" else 0.5
    return stride_s, np.array([(k + later - start) * stride_s for k in range(-1, 8)])


@pytest.mark.parametrize("side", ["r", "l"])
def test_virtual_contacts_are_found_at_a_steady_delay(persons, side):
    errors = []
    for session, person in persons:
        (trial,) = session.evaluation
        stride_s, true = _true_contacts(person, trial, side)
        found = np.array(find_gait_cycles(trial, side).contacts)
        nearest = true[np.argmin(np.abs(found[:, None] - true), axis=1)]
        errors.extend(found - nearest)
        inside = true[(true > trial.times[0] + 0.1) & (true < trial.times[-1] - 0.1)]
        assert set(inside) <= set(nearest)  # none was missed
        assert len(set(nearest)) == len(found)  # none was found twice
        lengths = np.diff(find_gait_cycles(trial, side).cycles, axis=1)
        np.testing.assert_allclose(lengths, stride_s, atol=0.015)  # chosen: one frame and a half
    # The foremost place of an ankle is a little before contact in Schwartz' mean gait: 22 ms, alike for all.
    assert abs(np.mean(errors)) < 0.03
    assert np.std(errors) < 0.006


def test_cycles_follow_each_other_and_legs_alternate(persons):
    for session, _ in persons:
        (trial,) = session.evaluation
        right, left = find_gait_cycles(trial, "r").cycles, find_gait_cycles(trial, "l").cycles
        assert len(right) >= 4
        assert all(a[1] == b[0] for a, b in pairwise(right))
        middles = [start for start, _ in left if right[0][0] < start < right[-1][1]]
        shares = [(m - s) / (e - s) for m in middles for s, e in right if s < m < e]
        np.testing.assert_allclose(shares, 0.5, atol=0.03)


@pytest.mark.parametrize("degrees", [37.0, 90.0, 180.0])
def test_the_way_may_have_any_direction(persons, degrees):
    (trial,) = persons[0][0].evaluation
    a = np.radians(degrees)
    turn = np.array([[np.cos(a), 0.0, -np.sin(a)], [0.0, 1.0, 0.0], [np.sin(a), 0.0, np.cos(a)]])
    turned = trial.with_markers(trial.markers @ turn)
    np.testing.assert_allclose(
        find_gait_cycles(turned, "r").cycles, find_gait_cycles(trial, "r").cycles, atol=1e-9
    )


def test_functional_movements_and_standing_are_no_walking(persons):
    session, _ = persons[0]
    for trial in (*session.calibration, session.static):
        for side in ("r", "l"):
            found = find_gait_cycles(trial, side)
            assert found.cycles == ()
            assert "stays in place" in found.reason


def test_the_same_walk_on_a_treadmill_has_the_same_cycles(persons):
    (trial,) = persons[1][0].evaluation
    pelvis = trial.markers[:, [trial.index("RASIS"), trial.index("LASIS")], 0].mean(axis=1)
    steady = np.polyval(np.polyfit(trial.times, pelvis, 1), trial.times)
    belt = trial.with_markers(trial.markers - steady[:, None, None] * [1.0, 0.0, 0.0])
    for side in ("r", "l"):
        np.testing.assert_allclose(
            find_gait_cycles(belt, side).cycles, find_gait_cycles(trial, side).cycles, atol=0.002
        )


def test_feet_that_glide_along_do_not_walk(persons):
    """Legs moved in walking, the body carried far too slowly: no foot ever stands."""
    (trial,) = persons[1][0].evaluation
    slow = np.linspace(0.0, 1.0, trial.n_frames)[:, None, None] * [1.0, 0.0, 0.0]
    pelvis = trial.markers[:, [trial.index("RASIS"), trial.index("LASIS")], 0].mean(axis=1)
    glided = trial.with_markers(trial.markers - pelvis[:, None, None] * [1.0, 0.0, 0.0] + slow)
    assert "no stride carries the pelvis" in find_gait_cycles(glided, "r").reason


def test_walking_backwards_and_round_a_corner_are_refused(persons):
    (trial,) = persons[0][0].evaluation
    backwards = replace(trial, markers=trial.markers[::-1].copy())
    assert find_gait_cycles(backwards, "r").reason == "the person walks backwards"
    half = trial.n_frames // 2
    corner = trial.markers.copy()
    corner[half:] += (trial.times[half:] - trial.times[half])[:, None, None] * [-2.4, 0.0, 1.0]
    assert "straight" in find_gait_cycles(trial.with_markers(corner), "r").reason


def test_a_stride_with_hidden_markers_is_left_out(persons):
    (trial,) = persons[2][0].evaluation
    whole = find_gait_cycles(trial, "l").cycles
    start, end = whole[1]
    hidden = (trial.times > start + 0.3) & (trial.times < end - 0.3)
    markers = trial.markers.copy()
    markers[hidden] = np.nan
    left = find_gait_cycles(trial.with_markers(markers), "l").cycles
    assert whole[1] not in left
    np.testing.assert_allclose(left, [c for c in whole if c != whole[1]], atol=1e-9)


def test_the_marker_that_is_seen_is_taken_and_none_is_said(persons):
    (trial,) = persons[3][0].evaluation
    assert find_gait_cycles(trial, "r").marker == "RLM"
    blind = trial.markers.copy()
    blind[:, trial.index("RLM")] = np.nan
    other = find_gait_cycles(trial.with_markers(blind), "r")
    assert other.marker == "RMM"
    np.testing.assert_allclose(other.cycles, find_gait_cycles(trial, "r").cycles, atol=0.01)  # one frame
    kept = [label for label in trial.labels if label not in ("RLM", "RMM")]
    assert "side 'r'" in find_gait_cycles(trial.select(kept), "r").reason
    legs = [label for label in trial.labels if "SIS" not in label]
    assert "pelvis" in find_gait_cycles(trial.select(legs), "r").reason


def test_a_recording_of_less_than_a_stride_says_so(persons):
    (trial,) = persons[0][0].evaluation
    start, end = find_gait_cycles(trial, "r").cycles[0]
    short = trial.frames(np.flatnonzero((trial.times > start + 0.1) & (trial.times < end + 0.2)))
    assert find_gait_cycles(short, "r").reason == "1 contact of the right foot, and a stride needs two"


PLATES = [
    ("jia_mri/Walking01.c3d", "jia_mri/Walking01_kinetics.mot", "l", "2_ground_force_vy"),
    ("jia_mri/Walking02.c3d", "jia_mri/Walking02_kinetics.mot", "l", "1_ground_force_vy"),
    ("jia_mri/Walking04.c3d", "jia_mri/Walking04_kinetics.mot", "l", "1_ground_force_vy"),
    ("rajagopal_walk/motion_capture_walk.trc", "rajagopal_walk/grf_walk.mot", "r", "ground_force_r_vy"),
    ("rajagopal_walk/motion_capture_walk.trc", "rajagopal_walk/grf_walk.mot", "l", "ground_force_l_vy"),
    ("gait2354/subject01_walk1.trc", "gait2354/subject01_walk1_grf.mot", "r", "ground_force_vy"),
    ("gait2354/subject01_walk1.trc", "gait2354/subject01_walk1_grf.mot", "l", "1_ground_force_vy"),
    ("opencap_squat/walking1.trc", "opencap_squat/walking1_grf.mot", "r", "ground_force_1_vy"),
    ("opencap_squat/walking1.trc", "opencap_squat/walking1_grf.mot", "l", "ground_force_2_vy"),
]
"""Markers, forces, the foot, and the plate that it meets; the second person walks on a treadmill."""

LOADED_N = 20.0
"""Custom: the threshold of contact in most gait software."""


@pytest.mark.parametrize(("markers", "forces", "side", "plate"), PLATES)
def test_contacts_agree_with_force_plates(shared_data: Path, markers, forces, side, plate):
    found = np.array(find_gait_cycles(_processed(shared_data / markers), side).contacts)
    table = read_sto(shared_data / forces)
    measured = _landings(table.times, table.column(plate))
    assert len(measured) > 0
    for contact in measured:
        # Chosen: the instants differ by nature; the largest seen is 0.054 s, in slow walking.
        assert np.abs(found - contact).min() < 0.06


def _processed(path: Path) -> Trial:
    raw = read_recording(path)
    roles = {label: role for label in raw.labels if (role := find_canonical(label)) is not None}
    return process(raw, decide(raw, roles=roles), {})


def _landings(times, force):
    """When a plate that was empty for a tenth of a second is loaded for as long."""
    loaded = np.nan_to_num(force) > LOADED_N
    near = round(0.1 / np.median(np.diff(times)))
    rises = np.flatnonzero(~loaded[:-1] & loaded[1:]) + 1
    return [
        times[i] for i in rises if i >= near and not loaded[i - near : i].any() and loaded[i : i + near].all()
    ]


def test_real_squats_are_no_walking(shared_data: Path):
    assert "in turn" in find_gait_cycles(_processed(shared_data / "opencap_squat/squats1.trc"), "r").reason
