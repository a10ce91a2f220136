"""Force plates of C3D files: what is read, in which unit, and what is refused by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.core.errors import TrialUnusable
from scaling_service.files.c3d import read_c3d, read_c3d_plates
from scaling_service.files.c3d_file import C3dFile

CORNERS = [[[600.0], [600.0], [0.0], [0.0]], [[400.0], [0.0], [0.0], [400.0]], [[0.0]] * 4]


def made(kind: int = 2, *, units: tuple[str, ...] = ("N",) * 3 + ("Nmm",) * 3, **group: object) -> C3dFile:
    """A file of four frames with ten samples each and one plate."""
    count = 8 if kind == 3 else 6
    analog = np.arange(40.0)[:, None] + 100.0 * np.arange(count)
    plates = {
        "USED": [1],
        "TYPE": [kind],
        "CORNERS": CORNERS,
        "ORIGIN": [[0.0], [0.0], [-40.0]],
        "CHANNEL": [[k + 1] for k in range(count)],
        "ZERO": [1, 0],
        "CAL_MATRIX": np.diag([2.0, 3, 4, 500, 600, 700])[:, :, None].tolist(),
    }
    parameters = {"FORCE_PLATFORM": plates | group, "ANALOG": {"UNITS": list(units)}}
    return C3dFile(
        name="made",
        points=np.zeros((4, 1, 3)),
        labels=("A",),
        computed=frozenset(),
        point_unit="mm",
        rate_hz=100.0,
        analog=analog,
        parameters=parameters,
    )


def test_numbers_become_si_and_the_clock_is_that_of_the_samples() -> None:
    recording = read_c3d_plates(made())
    (plate,) = recording.plates
    np.testing.assert_allclose(recording.times, np.arange(40) / 1000)
    np.testing.assert_allclose(plate.signals[1], [1.0, 101.0, 201.0, 0.301, 0.401, 0.501])
    np.testing.assert_allclose(plate.corners[0], [0.6, 0.4, 0.0])
    np.testing.assert_allclose(plate.origin, [0, 0, -0.04])
    assert recording.repairs == ()


def test_units_of_moments_are_believed_and_missing_ones_are_reported() -> None:
    metres = read_c3d_plates(made(units=("N",) * 3 + ("N.m",) * 3))
    np.testing.assert_allclose(metres.plates[0].signals[0, 3:], [300.0, 400.0, 500.0])
    silent = read_c3d_plates(made(units=()))
    np.testing.assert_allclose(silent.plates[0].signals[0, 3:], [0.3, 0.4, 0.5])
    assert [r.what for r in silent.repairs] == ["unit"]


def test_a_calibration_matrix_turns_volts_into_forces() -> None:
    plate = read_c3d_plates(made(4, units=("V",) * 6)).plates[0]
    np.testing.assert_allclose(plate.signals[0], [0, 300, 800, 150, 240, 350])  # N mm: 500 x 300 / 1000


def test_a_baseline_is_taken_off_only_where_nobody_stands() -> None:
    low = replace(made(ZERO=[1, 2]), analog=np.full((40, 6), 3.0))
    empty = read_c3d_plates(low)
    np.testing.assert_array_equal(empty.plates[0].signals, 0.0)
    assert [r.what for r in empty.repairs] == ["baseline"]
    stood_on = read_c3d_plates(made(ZERO=[1, 2]))
    assert [r.what for r in stood_on.repairs] == ["baseline_refused"]
    assert stood_on.plates[0].signals[0, 2] == 200.0


@pytest.mark.parametrize(
    ("file", "said"),
    [
        (made(5), "plate_1 is of type 5, which is not supported"),
        (made(21), "type 21"),
        (made(USED=[0]), "has no force plate"),
        (replace(made(), analog=np.zeros((0, 0))), "has no analog signal"),
        (made(CHANNEL=[[k + 3] for k in range(6)]), "names channels that the file does not hold"),
        (made(CORNERS=[]), "CORNERS does not describe plate_1"),
        (made(CORNERS=[[[0.0]] * 4] * 3), "corners that span 0 m²"),
        (made(ORIGIN=[[float("nan")]] * 3), "ORIGIN does not describe plate_1"),
        (made(units=("N",) * 3 + ("lbf ft",) * 3), "is in 'lbf ft', which is no unit of moment"),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(file: C3dFile, said: str) -> None:
    with pytest.raises(TrialUnusable, match=said) as caught:
        read_c3d_plates(file)
    assert caught.value.remedy
    assert caught.value.field


def test_real_files_are_read(shared_data) -> None:  # type: ignore[no-untyped-def]
    kistler = read_c3d(shared_data / "jia_mri" / "Walking01.c3d").plates
    assert [p.kind for p in kistler.plates] == [1, 1]
    assert kistler.plates[0].signals.shape == (1090, 6)
    bertec = read_c3d(shared_data / "functional" / "right_hip.c3d").plates
    assert [p.kind for p in bertec.plates] == [4, 4]
