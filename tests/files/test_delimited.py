"""CSV and TSV: each vendor's layout gives the same markers; what is no recording is refused by field."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scaling_service.core.errors import FileUnreadable, InputError, TrialUnusable
from scaling_service.files.recording import read_recording
from tests.files.made import outcome

LABELS = ("S01:LASI", "S01:RASI", "S01:LKNE", "S01:LANK")
FRAMES, RATE = 12, 120.0


def make_markers() -> Any:
    """Four markers of a leg of 1 m, m; one not seen for two frames."""
    base = np.array([[0.1, 1.0, 0.1], [0.1, 1.0, -0.1], [0.0, 0.5, 0.1], [0.0, 0.1, 0.1]])
    markers = base + np.round(np.random.default_rng(2).normal(0, 0.01, (FRAMES, 1, 3)), 4)
    markers[4:6, 2] = np.nan
    return markers


MARKERS = make_markers()


def write_cell(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.6f}"


def write_rows(markers: Any, before: Any, delimiter: str = ",") -> list[str]:
    return [delimiter.join([*before(k), *map(write_cell, frame.ravel())]) for k, frame in enumerate(markers)]


def write_motive(parent: bool = False, expected: bool = False) -> str:
    """With the positions that a skeleton expects and a rigid body beside the measured ones."""
    n = len(LABELS)
    more = [("Bone Marker", name) for name in LABELS] if expected else []
    columns = [("Rigid Body", "wand")] + more + [("Marker", name) for name in LABELS]
    cells = [(kind, name, axis) for kind, name in columns for axis in "XYZ"]
    above = [",Type," + ",".join(kind for kind, _, _ in cells), ",Name," + ",".join(n for _, n, _ in cells)]
    above.append(",ID," + ",".join(f'"{k // 3:04X}"' for k in range(len(cells))))
    if parent:
        above.append(",Parent," + "," * (len(cells) - 1))
    above.append(",," + ",".join("Position" for _ in cells))
    above.append("Frame,Time (Seconds)," + ",".join(axis for _, _, axis in cells))
    other = np.full((FRAMES, 1 + (n if expected else 0), 3), 7.0)
    rows = write_rows(np.concatenate((other, MARKERS), axis=1), lambda k: [str(k), f"{k / RATE:.6f}"])
    first = (
        f"Format Version,1.23,Take Name,a take,Capture Frame Rate,{RATE:.6f},Export Frame Rate,{RATE:.6f},"
    )
    first += "Rotation Type,Quaternion,Length Units,Meters,Coordinate Space,Global"
    return "\n".join([first, "", *above, *rows, ""])


def write_vicon() -> str:
    head = ["Devices", "1200", ",,Plate", "Frame,Sub Frame,Fx", ",,N", "1,0,3.5", ""]
    head += ["Trajectories", f"{RATE:g}", ",," + ",".join(f"{name},," for name in LABELS)]
    head += ["Frame,Sub Frame" + ",X,Y,Z" * len(LABELS), "," + ",mm,mm,mm" * len(LABELS)]
    return "\n".join([*head, *write_rows(1e3 * MARKERS, lambda k: [str(k + 1), "0"]), "", ""])


def write_qualisys(columns: int, head: bool) -> str:
    lines = [f"NO_OF_FRAMES\t{FRAMES}", "NO_OF_CAMERAS\t8", f"NO_OF_MARKERS\t{len(LABELS)}"]
    lines += [f"FREQUENCY\t{RATE:g}", "NO_OF_ANALOG\t0", "DESCRIPTION\t--", "DATA_INCLUDED\t3D"]
    lines += [
        "MARKER_NAMES\t" + "\t".join(LABELS),
        "TRAJECTORY_TYPES\t" + "\t".join(["Measured"] * len(LABELS)),
    ]
    if head:
        lines.append("Frame\tTime\t" + "\t".join(f"{n} {axis}" for n in LABELS for axis in "XYZ"))
    start = [[], ["1"], ["1", "0.0"]][columns]
    rows = write_rows(
        1e3 * np.nan_to_num(MARKERS), lambda k: [str(k + 1), f"{k / RATE:.5f}"][: len(start)], "\t"
    )
    return "\n".join([*lines, *(row + "\t" for row in rows), ""])


def write_wide(separator: str, delimiter: str, unit: float, *, decimal: str = ".") -> str:
    names = [f"{name}{separator}{axis}" for name in LABELS for axis in "xyz"]
    rows = write_rows(unit * MARKERS, lambda k: [f"{k / RATE:.6f}"], delimiter)
    text = "\n".join([delimiter.join(["time", *names]), *rows, ""])
    return text if decimal == "." else text.replace(".", ",")


def write_deeplabcut(time: bool = True) -> str:
    first = ["time"] if time else []
    parts = [*first, *(name for name in LABELS for _ in "xyz")]
    axes = [*(["s"] if time else []), *("xyz" * len(LABELS))]
    head = [
        "scorer," + ",".join(["net"] * len(parts)),
        "bodyparts," + ",".join(parts),
        "coords," + ",".join(axes),
    ]
    rows = write_rows(MARKERS, lambda k: [str(k), *([f"{k / RATE:.6f}"] if time else [])])
    return "\n".join([*head, *rows, ""])


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("motive.csv", write_motive()),
        ("motive3.csv", write_motive(parent=True)),
        ("motive_expected.csv", write_motive(expected=True)),
        ("vicon.csv", write_vicon()),
        ("qtm.tsv", write_qualisys(0, False)),
        ("qtm1.tsv", write_qualisys(1, False)),
        ("qtm2.tsv", write_qualisys(2, True)),
        ("wide.csv", write_wide("_", ",", 1.0)),
        ("wide_mm.csv", write_wide(" ", ";", 1e3)),
        ("wide_comma.csv", write_wide(".", ";", 1e2, decimal=",").replace(",x", ".x")),
        ("dlc.csv", write_deeplabcut()),
    ],
)
def test_every_layout_gives_the_same_markers(tmp_path: Path, name: str, content: str) -> None:
    (tmp_path / name).write_text(content)
    if "comma" in name:
        (tmp_path / name).write_text(
            "\n".join([write_wide(".", ";", 1e2).split("\n", 1)[0], content.split("\n", 1)[1]])
        )
    found = read_recording(tmp_path / name)
    assert found.labels == LABELS
    np.testing.assert_allclose(found.markers, MARKERS, atol=2e-6)
    np.testing.assert_allclose(found.times, np.arange(FRAMES) / RATE, atol=2e-5)
    assert found.rate_hz == pytest.approx(RATE, rel=1e-3)


@pytest.mark.parametrize(
    ("content", "field"),
    [
        ("a,b\n1,2\n", "columns"),
        ("marker,segment,x_mm,y_mm,z_mm\nRASIS,pelvis,1,2,3\n", "columns"),
        (write_deeplabcut(time=False), "time"),
        (write_motive().replace("Global", "Local"), "Coordinate Space"),
        (write_motive().replace("Marker", "Bone"), "Type"),
        (write_motive().replace("Meters", "Inches"), "unit"),
        (write_wide("_", ",", 8.0), "unit"),
        (write_deeplabcut().replace("x,y,z", "x,y,likelihood"), "coords"),
        (write_vicon().replace("\n2,0,", "\n2,0,x"), "column 3"),
    ],
)
def test_what_cannot_be_read_is_refused_by_field(tmp_path: Path, content: str, field: str) -> None:
    (tmp_path / "walk.csv").write_text(content)
    with pytest.raises((FileUnreadable, TrialUnusable)) as caught:
        read_recording(tmp_path / "walk.csv")
    assert caught.value.field == field
    assert caught.value.remedy


def test_persons_of_several_have_prefixes(tmp_path: Path) -> None:
    text = write_deeplabcut()
    persons = "individuals,,Anna,Anna,Anna,Anna,Anna,Anna,Ben,Ben,Ben,Ben,Ben,Ben"
    (tmp_path / "walk.csv").write_text(text.replace("bodyparts", persons + "\nbodyparts", 1))
    assert read_recording(tmp_path / "walk.csv").labels[0] == "Anna:S01:LASI"


@pytest.mark.parametrize("seed", range(40))
def test_damage_gives_a_recording_or_a_clear_refusal(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    name, content = [("a.csv", write_motive()), ("a.csv", write_vicon()), ("a.tsv", write_qualisys(2, True))][
        seed % 3
    ]
    damaged = bytearray(content.encode())
    for at in rng.integers(0, len(damaged), 1 + seed // 4):
        damaged[at] = rng.integers(32, 127)
    (tmp_path / name).write_bytes(damaged[: int(rng.integers(1, len(damaged)))] if seed % 2 else damaged)
    found = outcome(read_recording, tmp_path / name)
    if isinstance(found, InputError):
        assert found.remedy
    else:
        assert (np.diff(found.times) > 0).all()
