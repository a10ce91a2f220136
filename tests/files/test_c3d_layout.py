"""C3D: header, parameters and length are witnesses; what they do not show together is refused or said."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scaling_service.core.errors import FileUnreadable, InputError
from scaling_service.files.c3d import read_c3d
from scaling_service.files.c3d_file import C3dFile, read_c3d_file
from tests.files.c3d_bytes import BLOCK, DEC, INTEL, MIPS, make_c3d, pack_reals, pack_words
from tests.files.made import SHARED_FOLDER, outcome

LABELS = ("RASI", "LASI", "SACR", "RKNE", "LKNE")
FRAMES, SAMPLES, CHANNELS = 30, 5, 3


def make_points(frames: int = FRAMES, count: int = len(LABELS)) -> Any:
    rng = np.random.default_rng(5)
    points = np.round(rng.uniform(-2000, 2000, (frames, count, 3)), 1)
    points[3:6, 1] = np.nan
    return points


def make_analog(frames: int = FRAMES, samples: int = SAMPLES, channels: int = CHANNELS) -> Any:
    return np.rint(np.random.default_rng(6).uniform(-4000, 4000, (frames, samples, channels))) / 2


POINTS, ANALOG = make_points(), make_analog()


def read_bytes(folder: Path, content: bytes) -> C3dFile:
    (folder / "walk.c3d").write_bytes(content)
    return read_c3d_file(folder / "walk.c3d")


def check_same(found: C3dFile, points: Any = POINTS, analog: Any = ANALOG, rate: float = 100.0) -> None:
    np.testing.assert_allclose(found.points, points, atol=2e-4)  # mm: 32-bit reals
    np.testing.assert_allclose(found.analog, analog.reshape(-1, analog.shape[-1]), atol=1e-6)
    assert found.rate_hz == pytest.approx(rate)
    assert found.analog_rate_hz == pytest.approx(rate * analog.shape[1])


@pytest.mark.parametrize("processor", [INTEL, DEC, MIPS])
@pytest.mark.parametrize("real", [True, False])
def test_every_processor_and_form_gives_the_same_numbers(tmp_path, processor, real):
    found = read_bytes(tmp_path, make_c3d(POINTS, LABELS, ANALOG, processor=processor, real=real))
    check_same(found)
    assert (found.labels, found.point_unit, found.repairs) == (LABELS, "mm", ())


@pytest.mark.parametrize("real", [True, False])
def test_an_independent_engine_reads_the_same(tmp_path, real):
    found = read_bytes(tmp_path, make_c3d(POINTS, LABELS, ANALOG, real=real))
    peer = ezc3d.c3d(str(tmp_path / "walk.c3d"))
    np.testing.assert_allclose(found.points, peer["data"]["points"][:3].T, atol=1e-9)
    np.testing.assert_allclose(found.analog, peer["data"]["analogs"][0].T, atol=1e-9)
    assert list(found.labels) == peer["parameters"]["POINT"]["LABELS"]["value"]


def test_every_real_recording_is_read_as_by_an_independent_engine(shared_data):
    files = sorted(shared_data.rglob("*.c3d"))
    assert files
    for file in files:
        found, peer = read_c3d_file(file), ezc3d.c3d(str(file))
        points = peer["data"]["points"][:3].T.copy()
        points[peer["data"]["meta_points"]["residuals"][0].T < 0] = np.nan
        np.testing.assert_allclose(found.points, points, atol=1e-9, err_msg=str(file))
        np.testing.assert_allclose(found.analog, peer["data"]["analogs"][0].T, rtol=1e-9, atol=1e-9)
        assert found.rate_hz == peer["parameters"]["POINT"]["RATE"]["value"][0]


@pytest.mark.parametrize("processor", [INTEL, DEC, MIPS])
@pytest.mark.parametrize("real", [True, False])
@pytest.mark.parametrize(
    ("said", "changed"),
    [
        ("ANALOG:RATE", {("ANALOG", "RATE"): 0.0}),
        ("ANALOG:RATE", {("ANALOG", "RATE"): None}),
        ("ANALOG:RATE", {("ANALOG", "RATE"): 777.0}),
        ("ANALOG:RATE", {("ANALOG", "RATE"): 1000.0}),
        ("ANALOG:RATE", {("ANALOG", "RATE"): float("nan")}),
        ("POINT:RATE", {("POINT", "RATE"): None}),
        ("POINT:RATE", {("POINT", "RATE"): 0.0}),
        ("POINT:RATE", {("POINT", "RATE"): 50.0}),
        ("POINT:FRAMES", {("POINT", "FRAMES"): 400}),
        ("POINT:FRAMES", {("POINT", "FRAMES"): 12}),
        ("", {("POINT", "FRAMES"): None}),
        ("", {("POINT", "FRAMES"): float(FRAMES)}),
        ("POINT:USED", {("POINT", "USED"): 4}),
        ("POINT:USED", {("POINT", "USED"): 6}),
        ("", {("POINT", "USED"): None}),
        ("ANALOG:USED", {("ANALOG", "USED"): 2}),
        ("", {("ANALOG", "USED"): None}),
        ("POINT:DATA_START", {("POINT", "DATA_START"): 9}),
        ("", {("POINT", "DATA_START"): None}),
        ("", {("POINT", "SCALE"): None}),
    ],
)
def test_a_parameter_that_is_wrong_or_absent_changes_no_number(tmp_path, processor, real, said, changed):
    content = make_c3d(POINTS, LABELS, ANALOG, processor=processor, real=real, parameters=changed)
    found = read_bytes(tmp_path, content)
    check_same(found)
    assert [note.where for note in found.repairs] == ([said] if said else [])


@pytest.mark.parametrize("processor", [INTEL, DEC, MIPS])
@pytest.mark.parametrize("real", [True, False])
@pytest.mark.parametrize(
    ("said", "at", "value"),
    [
        ("header word 2", 2, 9),
        ("header word 3", 4, 0),
        ("header word 3", 4, 14),
        ("header words 4 and 5", 8, FRAMES + 400),
        ("header words 4 and 5", 8, 7),
        ("header words 4 and 5", 8, 0),
        ("header word 9", 16, 2),
        ("header word 10", 18, 4),
        ("header word 10", 18, 1),
    ],
)
def test_a_word_of_the_header_that_is_wrong_changes_no_number(tmp_path, processor, real, said, at, value):
    header = {at: pack_words([value], processor)}
    content = make_c3d(POINTS, LABELS, ANALOG, processor=processor, real=real, header=header)
    found = read_bytes(tmp_path, content)
    check_same(found)
    assert [note.where for note in found.repairs] == [said]


@pytest.mark.parametrize("processor", [INTEL, DEC, MIPS])
@pytest.mark.parametrize("rate", [0.0, 60.0, float("nan")])
def test_a_rate_in_the_header_that_is_wrong_changes_no_number(tmp_path, processor, rate):
    header = {20: pack_reals([rate], processor)}
    check_same(read_bytes(tmp_path, make_c3d(POINTS, LABELS, ANALOG, processor=processor, header=header)))


def test_two_rates_without_a_third_opinion_are_refused(tmp_path):
    content = make_c3d(POINTS, LABELS, parameters={("POINT", "RATE"): 50.0})
    with pytest.raises(FileUnreadable, match="different frame rates: POINT:RATE 50 Hz, header words 11"):
        read_bytes(tmp_path, content)


def test_two_scales_of_whole_numbers_are_refused(tmp_path):
    content = make_c3d(POINTS, LABELS, real=False, parameters={("POINT", "SCALE"): 0.2})
    with pytest.raises(FileUnreadable, match=r"parameters and header state 0\.2 and 0\.1"):
        read_bytes(tmp_path, content)


@pytest.mark.parametrize("stated", [0, 1, 83])
@pytest.mark.parametrize("processor", [INTEL, DEC, MIPS])
def test_a_processor_that_does_not_exist_is_told_by_the_numbers(tmp_path, stated, processor):
    content = bytearray(make_c3d(POINTS, LABELS, ANALOG, processor=processor))
    content[BLOCK + 3] = stated
    found = read_bytes(tmp_path, bytes(content))
    check_same(found)
    assert [note.where for note in found.repairs] == ["processor type"]


@pytest.mark.parametrize(
    "more",
    [
        {},
        {("POINT", "LONG_FRAMES"): 70_000.0},
        {
            ("TRIAL", "ACTUAL_START_FIELD"): np.array([1, 0]),
            ("TRIAL", "ACTUAL_END_FIELD"): np.array([4464, 1]),
        },
        {("POINT", "FRAMES"): 70_000 - 65_536},
    ],
)
def test_more_frames_than_a_word_counts(tmp_path, more):
    points = make_points(70_000, 2)
    found = read_bytes(tmp_path, make_c3d(points, LABELS[:2], parameters=more))
    assert len(found.points) == 70_000
    np.testing.assert_allclose(found.points, points, atol=2e-4)


def test_a_count_of_frames_that_ran_over_in_the_header(tmp_path):
    points = make_points(70_000, 2)
    content = make_c3d(
        points,
        LABELS[:2],
        header={8: pack_words([70_000 - 65_536], INTEL)},
        parameters={("POINT", "FRAMES"): 70_000 - 65_536},
    )
    assert len(read_bytes(tmp_path, content).points) == 70_000


def test_a_recording_that_begins_late_holds_its_own_frames(tmp_path):
    check_same(read_bytes(tmp_path, make_c3d(POINTS, LABELS, ANALOG, first=341)))


@pytest.mark.parametrize("share", [0.35, 0.6, 0.8])
@pytest.mark.parametrize("real", [True, False])
def test_a_file_cut_off_in_the_middle_is_refused_with_both_counts(tmp_path, share, real):
    content = make_c3d(POINTS, LABELS, ANALOG, real=real)
    with pytest.raises(FileUnreadable, match=f"cut off: {FRAMES} frames are stated, and it ends after"):
        read_bytes(tmp_path, content[: int(share * len(content))])


@pytest.mark.parametrize("count", [255, 256, 600])
def test_more_labels_than_one_parameter_holds(tmp_path, count):
    labels = tuple(f"M{k}" for k in range(count))
    assert read_bytes(tmp_path, make_c3d(make_points(3, count), labels)).labels == labels


@pytest.mark.parametrize(
    ("unit", "metres"),
    [
        *((unit, 1) for unit in ("m", "M", "meters", "Metres", "mete")),
        *((unit, 1e-3) for unit in ("mm", "MM", "millimetres", "Millimeters")),
        *((unit, 1e-2) for unit in ("cm", "CM", "centimeters")),
    ],
)
def test_spellings_of_units(tmp_path, unit, metres):
    points = POINTS / 1000 / metres
    content = make_c3d(points, LABELS, parameters={("POINT", "UNITS"): [unit]})
    (tmp_path / "walk.c3d").write_bytes(content)
    np.testing.assert_allclose(read_c3d(tmp_path / "walk.c3d").markers, POINTS / 1000, atol=2e-6)


def test_a_duplicate_keeps_both_and_the_first_its_name(tmp_path):
    labels = ("RASI", "LASI", "RASI", "RKNE", "RASI")
    about = {("POINT", "DESCRIPTIONS"): ["", "", "second camera", "", ""]}
    (tmp_path / "walk.c3d").write_bytes(make_c3d(POINTS, labels, parameters=about))
    found = read_c3d(tmp_path / "walk.c3d")
    assert found.labels == ("RASI", "LASI", "RASI#2", "RKNE", "RASI#3")
    np.testing.assert_allclose(found.markers, POINTS / 1000, atol=2e-6)
    assert [(note.what, note.where) for note in found.repairs] == [("duplicate", "RASI")]
    assert "second camera" in found.repairs[0].detail


def test_a_duplicate_that_is_never_seen_gives_way(tmp_path):
    points = POINTS.copy()
    points[:, 0] = np.nan
    (tmp_path / "walk.c3d").write_bytes(make_c3d(points, ("RASI", "LASI", "RASI", "RKNE", "LKNE")))
    assert read_c3d(tmp_path / "walk.c3d").labels == ("RASI#2", "LASI", "RASI", "RKNE", "LKNE")


def test_a_second_set_of_all_labels_is_a_second_person(tmp_path):
    points = np.concatenate((POINTS, POINTS + 900.0), axis=1)
    (tmp_path / "walk.c3d").write_bytes(make_c3d(points, LABELS * 2))
    found = read_c3d(tmp_path / "walk.c3d")
    assert found.labels == (*LABELS, *(f"#2:{label}" for label in LABELS))


@pytest.mark.parametrize(
    "corners",
    [np.zeros((3, 4, 1)), np.full((3, 4, 1), np.nan), np.outer([1.0, 2, 0], [0, 100.0, 200, 300])[..., None]],
)
def test_a_plate_with_impossible_corners_leaves_the_markers(tmp_path, corners):
    plate = {
        "USED": 1,
        "TYPE": np.array([2]),
        "CORNERS": corners,
        "ORIGIN": np.zeros((3, 1)),
        "CHANNEL": np.arange(1, 7)[:, None],
        "ZERO": np.array([1, 0]),
    }
    content = make_c3d(
        POINTS,
        LABELS,
        make_analog(channels=6),
        parameters={("FORCE_PLATFORM", name): value for name, value in plate.items()},
    )
    (tmp_path / "walk.c3d").write_bytes(content)
    found = read_c3d(tmp_path / "walk.c3d")
    np.testing.assert_allclose(found.markers, POINTS / 1000, atol=2e-6)
    assert isinstance(found.plates, InputError)
    assert found.plates.field == "FORCE_PLATFORM:CORNERS"


def test_unsigned_analog_numbers(tmp_path):
    analog = np.rint(np.random.default_rng(1).uniform(0, 60_000, (FRAMES, SAMPLES, CHANNELS))) / 2
    content = make_c3d(POINTS, LABELS, analog, real=False, parameters={("ANALOG", "FORMAT"): ["UNSIGNED"]})
    check_same(read_bytes(tmp_path, content), analog=analog)


def test_an_empty_array_of_many_dimensions_takes_no_memory(tmp_path):
    """Nested lists of a shape that ends in nothing would be more than any memory holds."""
    spare = {("POINT", "SPARE"): np.zeros((255, 255, 255, 255, 255, 0))}
    check_same(read_bytes(tmp_path, make_c3d(POINTS, LABELS, ANALOG, parameters=spare)))


@given(st.data())
@settings(SHARED_FOLDER, max_examples=400)
def test_one_flipped_bit_changes_nothing_is_said_or_refused(tmp_path, data):
    """In the header or the parameters: the same numbers, or a note, or a refusal with field and remedy."""
    processor, real = data.draw(st.sampled_from([INTEL, DEC, MIPS])), data.draw(st.booleans())
    content = bytearray(make_c3d(POINTS, LABELS, ANALOG, processor=processor, real=real))
    end = BLOCK * (content[BLOCK + 2] + 1)
    at = data.draw(st.one_of(st.integers(0, 24), st.integers(BLOCK, end - 1)))
    content[at] ^= 1 << data.draw(st.integers(0, 7))
    (tmp_path / "walk.c3d").write_bytes(content)
    found = outcome(read_c3d_file, tmp_path / "walk.c3d")
    if isinstance(found, InputError):
        assert found.file
        assert found.remedy
    elif not found.repairs:
        np.testing.assert_allclose(found.points, POINTS, rtol=1e-4, atol=2e-4)
        assert found.rate_hz == pytest.approx(100.0, rel=1e-3)
        assert found.analog.shape == (FRAMES * SAMPLES, CHANNELS)


@given(st.data())
@settings(SHARED_FOLDER, max_examples=400)
def test_any_damage_gives_a_file_or_a_clear_refusal(tmp_path, data):
    processor, real = data.draw(st.sampled_from([INTEL, DEC, MIPS])), data.draw(st.booleans())
    content = bytearray(make_c3d(POINTS, LABELS, ANALOG, processor=processor, real=real))
    end = BLOCK * (content[BLOCK + 2] + 1)
    for _ in range(data.draw(st.integers(2, 12))):
        at = data.draw(st.one_of(st.integers(0, 24), st.integers(BLOCK, end - 1)))
        content[at] = data.draw(st.integers(0, 255))
    (tmp_path / "walk.c3d").write_bytes(content[: data.draw(st.integers(0, len(content)))])
    found = outcome(read_c3d, tmp_path / "walk.c3d")
    if isinstance(found, InputError):
        assert found.file
        assert found.remedy
    else:
        assert (np.diff(found.times) > 0).all()
        assert not np.isinf(found.markers).any()


def test_notes_speak_plain_english(tmp_path):
    content = bytearray(make_c3d(POINTS, LABELS, ANALOG))
    struct.pack_into("<H", content, 8, 430)
    found = read_bytes(tmp_path, bytes(content))
    assert [note.detail for note in found.repairs] == ["frames: it says 430; the rest of the file shows 30"]
