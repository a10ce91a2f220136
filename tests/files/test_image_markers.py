"""Markers located in an image."""

from __future__ import annotations

from pathlib import Path

import pytest

from scaling_service.core.errors import FileUnreadable
from scaling_service.files.image_markers import read_image_markers

GOOD = "marker,segment,x_mm,y_mm,z_mm\nRASI,pelvis,-114.19,-126.25,-127.36\nRKNE,femur_r,1,2,3\n"


def test_positions_come_in_metres_with_their_segments(tmp_path: Path) -> None:
    file = tmp_path / "markers.csv"
    file.write_text(GOOD)
    found = read_image_markers(file)
    assert found["RASI"][0] == "pelvis"
    assert found["RASI"][1] == pytest.approx((-0.11419, -0.12625, -0.12736))
    assert list(found) == ["RASI", "RKNE"]


def test_columns_may_stand_in_any_order(tmp_path: Path) -> None:
    file = tmp_path / "markers.csv"
    file.write_text(
        "\ufeffz_mm,y_mm,x_mm,note,segment,marker\n3,2,1,left out,pelvis,RASI\n", encoding="utf-8"
    )
    assert read_image_markers(file)["RASI"] == ("pelvis", (0.001, 0.002, 0.003))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the file is empty"),
        ("marker,segment,x,y,z\nA,pelvis,1,2,3\n", "no column 'x_mm'"),
        (GOOD + "RASI,pelvis,1,2,3\n", "'RASI' stands twice"),
        (GOOD + ",pelvis,1,2,3\n", "has no name"),
        (GOOD + "A,pelvis,1,two,3\n", "line 4, y_mm"),
        (GOOD + "A,pelvis,1,nan,3\n", "line 4, y_mm"),
        (GOOD + "A,pelvis,1,2\n", "line 4, z_mm"),
    ],
)
def test_wrong_tables_are_refused_by_line(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "markers.csv"
    file.write_text(text)
    with pytest.raises(FileUnreadable, match=said):
        read_image_markers(file)


def test_an_absent_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileUnreadable, match="there is no such file"):
        read_image_markers(tmp_path / "none.csv")
