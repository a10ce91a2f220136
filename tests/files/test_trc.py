"""TRC: what is odd is repaired and said, what is wrong is refused."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scaling_service.core.errors import FileUnreadable, InputError, TrialUnusable
from scaling_service.files.trc import read_trc, write_trc
from tests.files.made import SHARED_FOLDER, outcome, random_trial


def _trial(n=6, labels=("RASI", "S1:L.ASIS", "V Sacral"), **options):
    return random_trial(n, labels, **options)


def _kinds(trial):
    return {repair.what for repair in trial.repairs}


@pytest.fixture
def lines(tmp_path):
    """The lines of a well-formed file of six frames and three markers, and a way to read them back."""
    path = tmp_path / "walk.trc"
    write_trc(path, _trial())
    content = path.read_text().split("\n")

    def read(changed, newline="\n", encoding="utf-8"):
        path.write_bytes(newline.join(changed).encode(encoding))
        return read_trc(path)

    return content, read


def test_spaces_and_prefixes_in_labels_are_kept(lines):
    content, read = lines
    assert read(content).labels == ("RASI", "S1:L.ASIS", "V Sacral")


def test_metres_and_unknown_units(lines):
    content, read = lines
    expected = _trial().markers
    as_metres = [content[0], content[1], content[2].replace("mm", "m"), *content[3:]]
    np.testing.assert_allclose(read(as_metres).markers, 1000 * expected, atol=1e-5)
    unstated = read([content[0], content[1], re.sub(r"\tmm\t.*", "", content[2]), *content[3:]])
    np.testing.assert_allclose(unstated.markers, expected, atol=1e-8)
    assert "unit" in _kinds(unstated)
    with pytest.raises(FileUnreadable, match="furlong"):
        read([content[0], content[1], content[2].replace("mm", "furlong"), *content[3:]])


def test_blank_cells_and_short_rows_are_missing_markers(lines):
    content, read = lines
    rows = [line.split("\t") for line in content[6:-1]]
    rows[1][5:8] = ["", "", ""]
    rows[2] = rows[2][:8]
    rows[3][6] = ""
    rows[4] = rows[4] + ["", ""]
    trial = read([*content[:6], *("\t".join(row) for row in rows), ""])
    missing = np.isnan(trial.markers).all(-1)
    assert np.argwhere(missing).tolist() == [[1, 1], [2, 2], [3, 1]]
    assert _kinds(trial) == {"blank_cells", "short_rows", "partial_position"}
    kept = ~missing
    np.testing.assert_allclose(trial.markers[kept], _trial().markers[kept], atol=1e-8)


def test_exact_zeros_are_lost_markers(lines):
    content, read = lines
    row = content[8].split("\t")
    row[2:5] = ["0.00000", "0", "0.0"]
    trial = read([*content[:8], "\t".join(row), *content[9:]])
    assert np.isnan(trial.markers[2, 0]).all()
    assert np.isnan(trial.markers).all(-1).sum() == 1
    (repair,) = trial.repairs
    assert (repair.what, repair.where, repair.frames) == ("lost_marker", "RASI", 1)


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_line_ends_trailing_tabs_and_byte_order_mark(lines, newline):
    content, read = lines
    trial = read([line + "\t" if line else line for line in content], newline, "utf-8-sig")
    np.testing.assert_allclose(trial.markers, _trial().markers, atol=1e-8)
    assert trial.repairs == ()


def test_bytes_of_another_encoding(lines):
    content, read = lines
    trial = read([content[0] + "_Müller", *content[1:]], encoding="latin-1")
    assert _kinds(trial) == {"encoding"}
    np.testing.assert_allclose(trial.markers, _trial().markers, atol=1e-8)


def test_files_delimited_by_spaces(lines):
    content, read = lines
    spaced = [re.sub(r"\t+", "   ", line.replace("V Sacral", "VSAC")) for line in content]
    trial = read(spaced)
    assert trial.labels == ("RASI", "S1:L.ASIS", "VSAC")
    np.testing.assert_allclose(trial.markers, _trial().markers, atol=1e-8)
    spaced[8] = " ".join(spaced[8].split()[:-1])  # which of the nine numbers is absent cannot be known
    holed = read(spaced)
    assert np.isnan(holed.markers[2]).all()
    np.testing.assert_allclose(np.delete(holed.markers, 2, 0), np.delete(_trial().markers, 2, 0), atol=1e-8)
    assert "short_rows" in _kinds(holed)


def test_numbering_from_another_marker_and_no_blank_line(lines):
    content, read = lines
    content[4] = "\t\tX7\tY7\tZ7\tX8\tY8\tZ8\tX9\tY9\tZ9"
    trial = read([*content[:5], *content[6:]])
    np.testing.assert_allclose(trial.markers, _trial().markers, atol=1e-8)
    assert _kinds(trial) == {"header"}
    trial = read([*content[:4], *content[6:]])
    np.testing.assert_allclose(trial.markers, _trial().markers, atol=1e-8)


def test_wrong_counts_are_repaired_and_said(lines):
    content, read = lines
    content[2] = content[2].replace("\t6\t3\t", "\t99\t41\t")
    trial = read(content)
    assert trial.n_frames == 6
    assert {repair.where for repair in trial.repairs} == {"NumFrames", "NumMarkers"}


def test_columns_without_a_label_are_dropped(lines):
    content, read = lines
    content[3] = content[3].replace("S1:L.ASIS", "")
    trial = read(content)
    assert trial.labels == ("RASI", "V Sacral")
    np.testing.assert_allclose(trial.markers, _trial().markers[:, [0, 2]], atol=1e-8)
    assert "unlabelled" in _kinds(trial)


def test_labels_in_neighbouring_cells(lines):
    content, read = lines
    content[3] = "Frame#\tTime\tA\tB\tC"
    trial = read(content)
    assert trial.labels == ("A", "B", "C")
    assert _kinds(trial) == {"label_layout"}


def test_a_duplicate_keeps_both_and_the_first_its_name(lines):
    content, read = lines
    whole = read(content)
    content[3] = content[3].replace("V Sacral", "RASI")
    trial = read(content)
    assert trial.labels == ("RASI", "S1:L.ASIS", "RASI#2")
    np.testing.assert_array_equal(trial.markers, whole.markers)
    assert _kinds(trial) == {"duplicate"}


@pytest.mark.parametrize("stated", ["100", "0"])
def test_times_in_milliseconds_become_seconds(lines, stated):
    content, read = lines
    content[2] = re.sub(r"^[^\t]+", stated, content[2])
    rows = [line.split("\t") for line in content[6:-1]]
    trial = read([*content[:6], *("\t".join([r[0], f"{1e3 * float(r[1]):.0f}", *r[2:]]) for r in rows), ""])
    np.testing.assert_allclose(trial.times, np.arange(6) / 100, atol=1e-9)
    assert trial.rate_hz == pytest.approx(100)
    assert any("milliseconds" in repair.detail for repair in trial.repairs)


def test_times_that_count_frames_become_seconds(lines):
    content, read = lines
    rows = [line.split("\t") for line in content[6:-1]]
    trial = read([*content[:6], *("\t".join([r[0], str(k), *r[2:]]) for k, r in enumerate(rows)), ""])
    np.testing.assert_allclose(trial.times, np.arange(6) / 100, atol=1e-9)
    assert _kinds(trial) == {"clock"}


@pytest.mark.parametrize("rate", [60.0, 120.0, 300.0])
def test_times_rounded_to_a_millisecond_are_restored(tmp_path, rate):
    trial = _trial(200, rate=rate)
    write_trc(tmp_path / "walk.trc", trial)
    text = re.sub(
        r"(?m)^(\d+\t)([\d.]+)", lambda m: f"{m[1]}{float(m[2]):.3f}", (tmp_path / "walk.trc").read_text()
    )
    (tmp_path / "walk.trc").write_text(text)
    back = read_trc(tmp_path / "walk.trc")
    assert _kinds(back) == {"clock"}
    np.testing.assert_allclose(np.diff(back.times), 1 / rate, rtol=1e-9)
    np.testing.assert_allclose(back.times, trial.times, atol=5e-4)


def test_absent_rows_become_unseen_frames(lines):
    content, read = lines
    trial = read([*content[:8], *content[10:]])
    assert trial.n_frames == 6
    np.testing.assert_array_equal(
        np.isnan(trial.markers).all((1, 2)), [False, False, True, True, False, False]
    )
    np.testing.assert_allclose(trial.times, np.arange(6) / 100, atol=1e-9)
    assert "absent_frames" in _kinds(trial)


@pytest.mark.parametrize("stated", ["0", "50", "x"])
def test_a_wrong_rate_is_taken_from_the_times(lines, stated):
    content, read = lines
    content[2] = re.sub(r"^[^\t]+", stated, content[2])
    trial = read(content)
    assert trial.rate_hz == pytest.approx(100)
    assert _kinds(trial) == {"rate"}
    np.testing.assert_allclose(trial.times, np.arange(6) / 100, atol=1e-9)


def test_uneven_times_are_kept_and_said(lines):
    content, read = lines
    uneven = [0.0, 0.0123, 0.0167, 0.0391, 0.0402, 0.0555]
    rows = [line.split("\t") for line in content[6:-1]]
    trial = read(
        [*content[:6], *("\t".join([r[0], str(t), *r[2:]]) for r, t in zip(rows, uneven, strict=True)), ""]
    )
    np.testing.assert_array_equal(trial.times, uneven)
    assert "clock" in _kinds(trial)


def test_a_file_that_breaks_off_loses_only_its_last_number(lines):
    content, read = lines
    cut = content[:-1]
    cut[-1] = cut[-1][:-40]
    trial = read(cut)
    assert trial.n_frames == 6
    assert "cut_row" in _kinds(trial)
    known = np.isfinite(trial.markers)
    assert not known[-1].all()
    np.testing.assert_allclose(trial.markers[known], _trial().markers[known], atol=1e-8)


def test_a_file_that_breaks_off_before_its_last_frames_is_refused(lines):
    content, read = lines
    with pytest.raises(FileUnreadable, match="counts 6 frames, and it breaks off in line 10 after 4"):
        read([*content[:9], content[9][:-40]])


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"", "empty"),
        (b" \n\n", "empty"),
        (b"\x00\x01\x02\x03" * 200, "binary"),
        (b"\x02\x50" + b"\x00" * 600, "C3D"),
        (b"hello world\n", "not a TRC"),
        (b"Coordinates\nversion=1\nendheader\ntime\tx\n0\t1\n", "MOT or STO"),
        (b'<?xml version="1.0"?><OpenSimDocument/>', "XML"),
        (b"PathFileType\t4\t(X/Y/Z)\ta.trc\n", "truncated"),
        (b"PathFileType\t4\n\nDataRate\tUnits\n100\tmm\n", "truncated"),
        (b"PathFileType\t4\nDataRate\tUnits\n100\tmm\nFrame#\n", "truncated"),
    ],
)
def test_what_is_not_a_trc_is_refused(tmp_path, content, problem):
    (tmp_path / "a.trc").write_bytes(content)
    with pytest.raises(FileUnreadable, match=problem) as caught:
        read_trc(tmp_path / "a.trc")
    assert caught.value.file == str(tmp_path / "a.trc")
    assert caught.value.remedy


def test_absent_files_and_folders_are_refused(tmp_path):
    with pytest.raises(FileUnreadable, match="no such file"):
        read_trc(tmp_path / "absent.trc")
    with pytest.raises(FileUnreadable, match="folder"):
        read_trc(tmp_path)


def test_files_without_frames_markers_or_order_are_refused(lines):
    content, read = lines
    with pytest.raises(TrialUnusable, match="no frame"):
        read(content[:6])
    with pytest.raises(TrialUnusable, match="no marker"):
        read([*content[:3], "Frame#\tTime\t\t\t", *content[4:]])
    with pytest.raises(TrialUnusable, match=r"line 8 has time 0 s, not later than 0\.01 s"):
        read([*content[:6], content[7], content[6], *content[8:]])
    with pytest.raises(TrialUnusable, match="line 8 has no usable time"):
        read([*content[:7], content[7].replace("0.010000000", ""), *content[8:]])
    with pytest.raises(FileUnreadable, match="line 7 holds 'abc'") as caught:
        read([*content[:6], re.sub(r"[^\t]+$", "abc", content[6]), *content[7:]])
    assert caught.value.field == "V Sacral Z"


@given(st.data())
@settings(SHARED_FOLDER, max_examples=150)
def test_damage_gives_a_trial_or_a_clear_refusal(tmp_path, data):
    write_trc(tmp_path / "w.trc", _trial(4, missing=0.2))
    content = bytearray((tmp_path / "w.trc").read_bytes())
    for _ in range(data.draw(st.integers(1, 6))):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place] = data.draw(st.one_of(st.integers(0, 255), st.sampled_from(b"\t\n ,.e9-_")))
    content = content[: data.draw(st.integers(0, len(content)))] if data.draw(st.booleans()) else content
    (tmp_path / "w.trc").write_bytes(content)
    trial = outcome(read_trc, tmp_path / "w.trc")
    if isinstance(trial, InputError):
        assert trial.file
        assert trial.remedy
    else:
        assert (np.diff(trial.times) > 0).all()
        assert not np.isinf(trial.markers).any()
        assert len(set(trial.labels)) == len(trial.labels)


def test_real_files_are_read_whole(shared_data):
    """Counts from the files' own headers; rounding of times repaired where the data's description says so."""
    expected = {
        "gait2354/subject01_walk1.trc": (151, 41, 60.0, {"clock"}),
        "gait2354/subject01_static.trc": (300, 49, 60.0, {"clock"}),
        "rajagopal_walk/motion_capture_walk.trc": (238, 41, 100.0, set()),
        "opencap_squat/squats1.trc": (1346, 51, 100.0, set()),
        "opencap_squat/walking1.trc": (131, 51, 100.0, set()),
    }
    for name, (frames, markers, rate, kinds) in expected.items():
        trial = read_trc(shared_data / name)
        assert (trial.n_frames, len(trial.labels), trial.rate_hz) == (frames, markers, rate)
        assert _kinds(trial) == kinds
        np.testing.assert_allclose(np.diff(trial.times), 1 / rate, atol=1e-6)
