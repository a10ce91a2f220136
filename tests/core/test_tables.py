"""Results as tables: numbers stay, and what is drawn is what is there."""

from __future__ import annotations

from scaling_service.core.tables import ResultTable

LENGTHS = ResultTable(
    "lengths", ("method", "segment", "length_mm"), (("MB", "femur_r", 419.9), ("EB", "<b>", 416.7))
)
CURVE = ResultTable("walk", ("time_s", "knee_deg"), ((0.0, 1.0), (0.1, 2.0)))


def test_a_frame_has_the_rows() -> None:
    frame = LENGTHS.to_frame()
    assert list(frame.columns) == list(LENGTHS.columns)
    assert frame["length_mm"].to_list() == [419.9, 416.7]


def test_words_are_drawn_as_bars_and_numbers_as_curves() -> None:
    bars = [(bar.type, bar.name, list(bar.x), list(bar.y)) for bar in LENGTHS.plot().data]
    assert bars == [("bar", "MB", [419.9], ["femur_r"]), ("bar", "EB", [416.7], ["<b>"])]
    (curve,) = CURVE.plot().data
    assert (curve.type, list(curve.x), list(curve.y)) == ("scatter", [0.0, 0.1], [1.0, 2.0])


def test_a_table_without_rows_says_so() -> None:
    assert repr(ResultTable("effects", ("kind", "value"), ())) == "effects\nnone"


def test_a_notebook_shows_a_table_and_no_foreign_marks() -> None:
    shown = LENGTHS._repr_html_()
    assert "<table" in shown
    assert "<b>" not in shown.removeprefix("<b>lengths</b>")
