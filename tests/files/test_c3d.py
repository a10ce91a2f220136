"""C3D: recordings that an independent engine writes, and real ones."""

from __future__ import annotations

import ezc3d
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scaling_service.core.errors import FileUnreadable, InputError, TrialUnusable
from scaling_service.files.c3d import read_c3d
from scaling_service.files.c3d_file import read_c3d_file
from tests.files.c3d_writing import write_c3d
from tests.files.made import SHARED_FOLDER, outcome, random_trial


def _trial(n=8, labels=("S1:RASI", "LASI", "SACR"), missing=0.2):
    return random_trial(n, labels, missing=missing)


def _raw(path, labels, points, units="mm", parameters=None, analogs=None):
    """A file straight from the library: ``points`` in file units, (3, n_points, n_frames)."""
    content = ezc3d.c3d()
    content["parameters"]["POINT"]["UNITS"]["value"] = [units] if units else []
    content["parameters"]["POINT"]["RATE"]["value"] = [100]
    content["parameters"]["POINT"]["LABELS"]["value"] = labels
    content["data"]["points"] = np.concatenate((points, np.ones((1, *points.shape[1:]))))
    for name, value in (parameters or {}).items():
        content.add_parameter("POINT", name, value)
    if analogs is not None:
        content["parameters"]["ANALOG"]["RATE"]["value"] = [1000]
        content["parameters"]["ANALOG"]["LABELS"]["value"] = [f"A{k}" for k in range(analogs.shape[1])]
        content["data"]["analogs"] = analogs
    content.write(str(path))


@pytest.mark.parametrize("count", [1, 3, 255, 300])
def test_round_trip_also_of_many_labels(tmp_path, count):
    trial = _trial(labels=[f"M{k}" for k in range(count)])
    write_c3d(tmp_path / "walk.c3d", trial)
    back = read_c3d(tmp_path / "walk.c3d")
    assert (back.name, back.labels, back.rate_hz, back.repairs) == ("walk", trial.labels, 100.0, ())
    np.testing.assert_allclose(back.markers, trial.markers, atol=2e-7)  # m: 32-bit floats of millimetres
    np.testing.assert_allclose(back.times, trial.times)


def test_missing_markers_have_negative_residuals_for_other_readers(tmp_path):
    trial = _trial()
    write_c3d(tmp_path / "walk.c3d", trial)
    residuals = ezc3d.c3d(str(tmp_path / "walk.c3d"))["data"]["meta_points"]["residuals"][0]
    np.testing.assert_array_equal(residuals.T < 0, np.isnan(trial.markers).all(-1))


def test_metres_zeros_computed_and_unlabelled_points(tmp_path):
    points = np.random.default_rng(1).uniform(-1, 1, (3, 5, 4))
    points[:, 1, 2] = 0
    _raw(
        tmp_path / "a.c3d",
        ["RASI", "LASI", "*12", "LKneeAngles", "CentreOfMass"],
        points,
        "m",
        {"ANGLES": ["LKneeAngles"], "MODELED_MARKERS": ["CentreOfMass"]},
    )
    trial = read_c3d(tmp_path / "a.c3d")
    assert trial.labels == ("RASI", "LASI")
    assert np.argwhere(np.isnan(trial.markers).all(-1)).tolist() == [[2, 1]]
    np.testing.assert_allclose(trial.markers[:, 0], points[:, 0].T, atol=1e-7)
    assert [r.what for r in trial.repairs] == ["computed_points", "unlabelled", "lost_marker"]
    assert "LKneeAngles, CentreOfMass" in trial.repairs[0].detail


def test_unknown_units(tmp_path):
    points = np.ones((3, 2, 4))
    _raw(tmp_path / "a.c3d", ["A", "B"], points, "inch")
    with pytest.raises(FileUnreadable, match="inch"):
        read_c3d(tmp_path / "a.c3d")


def test_files_without_markers(tmp_path):
    _raw(tmp_path / "a.c3d", ["*1", "*2"], np.ones((3, 2, 4)))
    with pytest.raises(TrialUnusable, match="no labelled marker"):
        read_c3d(tmp_path / "a.c3d")


def test_analog_signals_and_parameters(tmp_path):
    analogs = np.random.default_rng(2).normal(size=(1, 2, 40))
    _raw(tmp_path / "a.c3d", ["A"], np.ones((3, 1, 4)), analogs=analogs)
    content = read_c3d_file(tmp_path / "a.c3d")
    np.testing.assert_allclose(content.analog, analogs[0].T, atol=1e-6)
    assert content.analog_rate_hz == pytest.approx(1000)
    assert content.parameters["ANALOG"]["LABELS"] == ["A0", "A1"]


@pytest.mark.parametrize(
    ("content", "problem"),
    [(b"", "empty"), (b"PathFileType\t4\n" * 100, "not a C3D"), (b"\x02\x50\x00", "not a C3D")],
)
def test_what_is_not_c3d_is_refused(tmp_path, content, problem):
    (tmp_path / "a.c3d").write_bytes(content)
    with pytest.raises(FileUnreadable, match=problem):
        read_c3d(tmp_path / "a.c3d")
    with pytest.raises(FileUnreadable, match="no such file"):
        read_c3d(tmp_path / "absent.c3d")


@given(st.data())
@settings(SHARED_FOLDER, max_examples=25)
def test_damage_gives_a_trial_or_a_clear_refusal(tmp_path, data):
    write_c3d(tmp_path / "w.c3d", _trial())
    content = bytearray((tmp_path / "w.c3d").read_bytes())
    for _ in range(data.draw(st.integers(1, 8))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    if data.draw(st.booleans()):
        content = content[: data.draw(st.integers(0, len(content)))]
    (tmp_path / "w.c3d").write_bytes(content)
    trial = outcome(read_c3d, tmp_path / "w.c3d")
    if isinstance(trial, InputError):
        assert trial.file
        assert trial.remedy
    else:
        assert (np.diff(trial.times) > 0).all()
        assert not np.isinf(trial.markers).any()


@pytest.mark.parametrize("missing", [1, 40, 400])
def test_a_file_that_ends_too_early_is_refused(tmp_path, missing):
    write_c3d(tmp_path / "walk.c3d", _trial())
    whole = (tmp_path / "walk.c3d").read_bytes()
    frames = whole[512 * (int.from_bytes(whole[16:18], "little") - 1) :]
    size = 3 * 16  # points of four 4-byte numbers
    end = len(whole) - len(frames) + 8 * size
    (tmp_path / "walk.c3d").write_bytes(whole[:end])
    assert read_c3d(tmp_path / "walk.c3d").n_frames == 8
    (tmp_path / "walk.c3d").write_bytes(whole[: end - missing])
    left = max(0, 8 * size - missing) // size
    with pytest.raises(FileUnreadable, match=f"8 frames are stated, and it ends after {left}"):
        read_c3d(tmp_path / "walk.c3d")


def test_trailing_frames_without_a_marker_are_no_cut(tmp_path):
    trial = _trial()
    markers = trial.markers.copy()
    markers[5:] = np.nan
    write_c3d(tmp_path / "walk.c3d", trial.with_markers(markers))
    assert read_c3d(tmp_path / "walk.c3d").n_frames == 8


def test_a_truncated_real_recording_is_refused(shared_data, tmp_path):
    whole = (shared_data / "jia_mri/Walking01.c3d").read_bytes()
    (tmp_path / "cut.c3d").write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(FileUnreadable, match="109 frames are stated"):
        read_c3d(tmp_path / "cut.c3d")


def test_real_files_are_read_whole(shared_data):
    expected = {
        "jia_mri/Static.c3d": (7, 51),
        "jia_mri/Walking01.c3d": (109, 45),
        "functional/right_knee.c3d": (922, 73),
    }
    for name, shape in expected.items():
        trial = read_c3d(shared_data / name)
        assert (*trial.markers.shape[:2], trial.rate_hz, trial.repairs) == (*shape, 100.0, ())
        height = np.nanmax(trial.markers, axis=(0, 1)) - np.nanmin(trial.markers, axis=(0, 1))
        assert 1.0 < height.max() < 5.0  # m: a person, or a person walking
    content = read_c3d_file(shared_data / "jia_mri/Walking01.c3d")
    assert content.analog_rate_hz == pytest.approx(1000)
    assert content.parameters["FORCE_PLATFORM"]["USED"] == [2]
