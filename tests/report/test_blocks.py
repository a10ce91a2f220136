"""Blocks: well-formed, every text escaped, headers where tables need them."""

from __future__ import annotations

import pytest

from scaling_service.report.blocks import (
    Block,
    Bullets,
    Callout,
    Cell,
    Details,
    Grid,
    Heading,
    Legend,
    Row,
    Table,
    Text,
)
from scaling_service.report.figures import Figure, escape_plain, make_chart
from tests.report.reading import Node, data, read, tables

NASTY = "<script>alert('1')</script> & \"quoted\" </td></style>"

BLOCKS: list[Block] = [
    Text(NASTY),
    Text(NASTY, quiet=True),
    Heading(NASTY),
    Bullets([NASTY, NASTY]),
    Bullets([NASTY], numbered=True),
    Callout(NASTY, [Text(NASTY)], "poor"),
    Table(
        caption=NASTY,
        columns=["", NASTY],
        rows=[Row(NASTY), Row(NASTY, [Cell(NASTY, shade=0.5, tone="good")])],
        note=NASTY,
    ),
    Details(NASTY, [Grid([Text(NASTY)])]),
    Legend([(NASTY, "#000000", "dash")]),
    Figure(make_chart([{"type": "scatter", "x": [0], "y": [1], "name": NASTY}], x_title=NASTY), NASTY, NASTY),
]


@pytest.mark.parametrize("block", BLOCKS, ids=lambda b: type(b).__name__)
def test_text_stays_text(block: Block) -> None:
    root = read(block.html())
    assert NASTY in shown(root)
    executable = [s for s in root.all("script") if s.attributes.get("type") != "application/json"]
    assert executable == []


def shown(node: Node) -> str:
    """Text and labels as a browser shows them, data left out."""
    parts = [node.attributes.get("aria-label") or ""]
    for child in node.children:
        if isinstance(child, str):
            parts.append(child)
        elif child.tag != "script":
            parts.append(shown(child))
    return "".join(parts)


def test_an_empty_list_is_nothing() -> None:
    assert Bullets([]).html() == ""


def test_a_table_has_headers_for_columns_and_rows() -> None:
    table = Table(
        caption="Sizes",
        columns=["", "left", Cell("right", colour="#123456")],
        rows=[Row("leg"), Row("thigh", ["1", "2"])],
    )
    root = read(table.html())
    scopes = [(th.text, th.attributes.get("scope")) for th in root.all("th")]
    assert scopes == [("", "col"), ("left", "col"), ("right", "col"), ("leg", "rowgroup"), ("thigh", "row")]
    assert tables(root)["Sizes"][2] == ["thigh", "1", "2"]
    (title,) = [th for th in root.all("th") if th.text == "leg"]
    assert title.attributes["colspan"] == "3"


@pytest.mark.parametrize(("shade", "written"), [(-1.0, "0.00"), (0.25, "0.25"), (7.0, "1.00")])
def test_shades_stay_between_nothing_and_full(shade: float, written: str) -> None:
    assert f"--shade:{written}" in Cell("x", shade=shade).html()


def test_a_figure_carries_its_data_and_is_described() -> None:
    figure = make_chart([{"type": "scatter", "x": [0.0, 1.0], "y": [2.0, 3.0]}], y_title="mm")
    root = read(Figure(figure, "Errors", "Errors rise from 2 to 3 mm.").html())
    (drawn,) = data(root)
    assert drawn["data"][0]["y"] == [2.0, 3.0]
    (place,) = root.all("div", "plot")
    assert place.attributes["role"] == "img"
    assert place.attributes["aria-label"] == "Errors rise from 2 to 3 mm."


def test_plotly_shows_names_as_they_are() -> None:
    # plotly takes some tags in text for markup; as entities they are shown.
    assert escape_plain("<a href='x'>S1 & S2</a>") == "&lt;a href='x'&gt;S1 &amp; S2&lt;/a&gt;"
