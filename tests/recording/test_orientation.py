"""Axes and unit: a body put into any laboratory comes back upright and facing forward."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scaling_service.core.errors import InputError, TrialUnusable
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.rigid import rotate_about
from scaling_service.recording.orientation import apply, decide, stand_along
from scaling_service.recording.plausibility import find_unit_factor

BODY = {  # m; X forward, Y up, Z right; a person standing at the origin
    "RASIS": (0.10, 0.95, 0.12), "LASIS": (0.10, 0.95, -0.12), "RPSIS": (-0.08, 0.98, 0.05),
    "LPSIS": (-0.08, 0.98, -0.05), "RLFE": (0.0, 0.48, 0.15), "LLFE": (0.0, 0.48, -0.15),
    "RLM": (-0.02, 0.08, 0.14), "LLM": (-0.02, 0.08, -0.14), "HEAD": (0.08, 1.70, 0.0),
    "RTOE": (0.18, 0.04, 0.12), "LTOE": (0.18, 0.04, -0.12),
}  # fmt: skip
ROLES = {name: name for name in BODY if name not in ("HEAD", "RTOE", "LTOE")}
ROTATIONS = [
    R
    for signs in itertools.product((1.0, -1.0), repeat=3)
    for order in itertools.permutations(range(3))
    if np.linalg.det(R := np.diag(signs)[:, order]) > 0
]


def _trial(turn=None, walk=0.0, shift=(0.0, 0.0, 0.0), scale=1.0, frames=50):
    """The body in a laboratory: ``turn`` maps our axes to the laboratory's."""
    body = np.array(list(BODY.values()))
    way = np.linspace(0, walk, frames)[:, None, None] * np.array([1.0, 0, 0])
    positions = (body + way) @ (np.eye(3) if turn is None else turn).T + np.array(shift)
    return Trial(
        name="static",
        times=np.arange(frames) / 100,
        labels=tuple(BODY),
        markers=positions * scale,
        rate_hz=100.0,
    )


@pytest.mark.parametrize("turn", ROTATIONS, ids=lambda R: "".join(f"{v:+.0f}" for v in R.ravel() if v))
def test_every_right_angled_laboratory_is_undone(turn):
    trial = _trial(turn)
    found = decide(trial, roles=ROLES)
    np.testing.assert_array_equal(found.R_new_old, turn.T)
    np.testing.assert_allclose(apply(found, trial).markers, _trial().markers, atol=1e-12)
    assert [r.what for r in found.repairs] == ["up_axis", "forward_axis"]


@given(
    st.sampled_from(ROTATIONS),
    st.floats(-40, 40),
    st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
    st.booleans(),
)
@settings(max_examples=40)
def test_standing_anywhere_and_askew_snaps_to_the_nearest_axis(turn, askew, place, walking):
    skewed = turn @ rotate_about([0, 1, 0], np.radians(askew))
    shift = turn @ np.array([place[0], 0.0, place[1]])
    found = decide(_trial(skewed, walk=2.0 * walking, shift=shift), roles=ROLES)
    np.testing.assert_array_equal(found.R_new_old, turn.T)
    (said,) = re.findall(r"(\d+) deg off it", found.repairs[1].detail)
    assert abs(float(said) - abs(askew)) <= 0.5 + 1e-6  # a whole number of degrees is said


@pytest.mark.parametrize("turn", [np.eye(3), ROTATIONS[5], rotate_about([1, 0, 0], np.pi / 2).round()])
def test_without_names_the_shape_tells_up_and_walking_tells_forward(turn):
    found = decide(_trial(turn, walk=2.0))
    np.testing.assert_allclose(found.R_new_old, turn.T, atol=1e-12)
    assert "displacement of 2.0 m" in found.repairs[1].detail


def test_arms_stretched_out_do_not_hide_the_floor():
    body = dict(BODY, RHAND=(0.0, 1.4, 0.9), LHAND=(0.0, 1.4, -0.9))
    z_up = rotate_about([1, 0, 0], np.pi / 2).round()
    positions = np.repeat((np.array(list(body.values())) @ z_up.T)[None], 5, axis=0)
    found = decide(
        Trial(name="t", times=np.arange(5) / 100, labels=tuple(body), markers=positions, rate_hz=100.0)
    )
    assert found.description.startswith("up +z")


def test_standing_still_without_names_keeps_a_lab_axis_and_says_so():
    found = decide(_trial())
    np.testing.assert_array_equal(found.R_new_old, np.eye(3))
    assert "not known" in found.repairs[1].detail


def test_right_and_left_alone_tell_forward():
    turn = ROTATIONS[7]
    roles = {label: role for label, role in ROLES.items() if "PSIS" not in role}
    np.testing.assert_array_equal(decide(_trial(turn), roles=roles).R_new_old, turn.T)
    one_sided = {
        label: role for label, role in ROLES.items() if role in ("RASIS", "RPSIS", "LPSIS", "RLM", "LLM")
    }
    np.testing.assert_array_equal(decide(_trial(turn), roles=one_sided).R_new_old, turn.T)


def test_labels_are_found_through_their_roles():
    trial = _trial(ROTATIONS[9]).relabel({"RASIS": "S1:RASI"})
    roles = {**{k: v for k, v in ROLES.items() if k != "RASIS"}, "S1:RASI": "RASIS"}
    np.testing.assert_array_equal(decide(trial, roles=roles).R_new_old, ROTATIONS[9].T)


def test_overrides_hold():
    found = decide(_trial(), roles=ROLES, up="z", forward="-X")
    np.testing.assert_array_equal(found.R_new_old, [[-1, 0, 0], [0, 0, 1], [0, 1, 0]])
    assert found.description == "up +z, forward -x"
    assert "given" in found.repairs[0].detail
    for wrong in ({"up": "w"}, {"forward": "+"}, {"up": "+y", "forward": "-y"}):
        with pytest.raises(InputError):
            decide(_trial(), **wrong)


def test_forces_turn_with_the_markers_but_keep_their_unit():
    turn = rotate_about([1, 0, 0], np.pi / 2).round()
    found = decide(_trial(turn, scale=1000.0), roles=ROLES)
    up_in_lab = turn @ [0, 1.0, 0]
    np.testing.assert_array_equal(found.rotate(800 * up_in_lab), [0, 800, 0])


@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_a_unit_that_cannot_be_true_is_corrected_for_each_recording(factor):
    good, bad = _trial(), _trial(scale=factor)
    found = decide(good, roles=ROLES)
    for trial, kinds in ((good, 0), (bad, 1)):
        result = apply(found, trial)
        np.testing.assert_allclose(result.markers, good.markers, rtol=1e-12)
        assert sum(r.what == "unit" for r in result.repairs) == kinds
    assert find_unit_factor(bad)[0] == pytest.approx(1 / factor)


def test_no_body_and_no_marker_are_refused():
    with pytest.raises(TrialUnusable, match="no body in m or mm"):
        decide(_trial(scale=30.0))
    empty = _trial()
    with pytest.raises(TrialUnusable, match="no marker is seen"):
        decide(empty.with_markers(np.full_like(empty.markers, np.nan)))


def test_gaps_and_markers_that_are_never_seen_do_not_disturb():
    trial = _trial(ROTATIONS[3])
    markers = trial.markers.copy()
    markers[:, trial.index("RASIS")] = np.nan
    markers[3:9] = np.nan
    markers[20:, trial.index("HEAD")] = np.nan
    holed = trial.with_markers(markers)
    np.testing.assert_array_equal(decide(holed, roles=ROLES).R_new_old, ROTATIONS[3].T)
    np.testing.assert_array_equal(
        np.isnan(apply(decide(holed, roles=ROLES), holed).markers), np.isnan(markers)
    )


def test_real_laboratories(shared_data):
    """Y up by OpenSim's convention in the TRC files, Z up by the data's description in the C3D file."""
    from scaling_service.files.recording import read_recording

    for name, up in (
        ("functional/right_knee.c3d", "up +z"),
        ("functional/right_hip.c3d", "up +z"),
        ("gait2354/subject01_static.trc", "up +y"),
        ("rajagopal_walk/motion_capture_walk.trc", "up +y, forward +x"),
        ("opencap_squat/squats1.trc", "up +y"),
        ("opencap_squat/walking1.trc", "up +y, forward +x"),
        ("jia_mri/Static.c3d", "up +y"),
    ):
        assert decide(read_recording(shared_data / name)).description.startswith(up), name


@pytest.mark.parametrize("turn", ROTATIONS, ids=lambda R: "".join(f"{v:+.0f}" for v in R.ravel() if v))
def test_a_kept_heading_is_turned_by_the_vertical_alone(turn):
    found = decide(_trial(turn), roles=ROLES, facing=False)
    np.testing.assert_array_equal(found.R_new_old[1], turn[:, 1])  # what was up is up
    angle = np.degrees(np.arccos(np.clip((np.trace(found.R_new_old) - 1.0) / 2.0, -1.0, 1.0)))
    assert angle == pytest.approx(np.degrees(np.arccos(np.clip(turn[1, 1], -1.0, 1.0))))  # the smallest turn
    if turn[1, 1] == 1.0:
        np.testing.assert_array_equal(found.R_new_old, np.eye(3))


def test_the_root_tells_the_vertical_where_a_leg_is_level():
    lying = {"RASIS": "RASIS", "RLFE": "RLFE", "RLM": "RLM"}
    trial = _trial()
    level = trial.markers.copy()
    for name, reach in (("RLFE", 0.45), ("RLM", 0.9)):
        level[:, trial.labels.index(name)] = level[:, trial.labels.index("RASIS")] + [reach, -0.05, 0.0]
    sitting = trial.with_markers(level)
    assert decide(sitting, roles=lying).up == "-x"
    assert decide(sitting, roles=lying, upright=np.array([0.1, 0.95, 0.0])).up == "+y"


def test_force_plates_tell_the_vertical_of_who_lies():
    """Lying along x: markers and root say x, the plates under them z."""
    turn = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # our y along the laboratory's x
    trial = _trial(turn, shift=(0.0, 0.0, 0.5))
    square = np.array([[0.2, 0.2, 0.0], [-0.2, 0.2, 0.0], [-0.2, -0.2, 0.0], [0.2, -0.2, 0.0]])
    corners = np.stack([square, square + np.array([1.0, 0.0, 0.0])])
    assert decide(trial, roles=ROLES).up == "+x"
    assert decide(trial, roles=ROLES, level=corners).up == "+z"
    wall = corners[:, :, [2, 0, 1]]
    assert decide(trial, roles=ROLES, level=np.concatenate([corners, wall])).up == "+x"  # they disagree


def test_a_model_may_stand_along_another_axis():
    kept = decide(_trial(ROTATIONS[0]), roles=ROLES, facing=False)
    for vertical in range(3):
        found = stand_along(kept, vertical)
        assert found.up == kept.up
        np.testing.assert_allclose(found.R_new_old[vertical], kept.R_new_old[1])
        assert np.linalg.det(found.R_new_old) == pytest.approx(1.0)
