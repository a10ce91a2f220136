"""Summaries and tables: well-formed, every text escaped, headers where tables need them."""

from __future__ import annotations

import pytest

from scaling_service.report.summary import Summary
from scaling_service.report.tables import Cell, Row, Table
from tests.report.reading import Node, read, tables

NASTY = "<script>alert('1')</script> & \"quoted\" </td></style>"

TABLE = Table(
    caption=NASTY,
    columns=["", NASTY],
    rows=[Row(NASTY), Row(NASTY, [Cell(NASTY, tone="poor")]), Row("plain", ["1.0"])],
    note=NASTY,
    words=True,
)
SUMMARY = Summary(
    title=NASTY,
    subtitle=NASTY,
    headline=NASTY,
    tone="fair",
    why=[NASTY],
    cautions=[NASTY],
    tables=[TABLE],
)


@pytest.fixture(scope="module")
def root() -> Node:
    return read(SUMMARY.html())


def test_every_text_is_escaped(root: Node) -> None:
    assert root.all("script") == []
    assert root.text.count(NASTY) == 11
    assert tables(root)[NASTY] == [["", NASTY], [NASTY], [NASTY, NASTY], ["plain", "1.0"]]


def test_rows_and_columns_have_headers(root: Node) -> None:
    scopes = [th.attributes.get("scope") for th in root.all("th")]
    assert scopes == ["col", "col", "row", "row", "row"]
    (title,) = [th for th in root.all("th") if "colspan" in th.attributes]
    assert title.attributes["colspan"] == "2"


def test_tones_are_those_of_the_pages_styles(root: Node) -> None:
    assert root.all("div", "callout")[0].attributes["class"] == "callout fair"
    assert len(root.all("td", "poor")) == 1


def test_a_summary_travels_as_json() -> None:
    told = SUMMARY.describe()
    assert (told["headline"], told["tone"], told["why"]) == (NASTY, "fair", [NASTY])
    assert told["tables"][0]["rows"][1] == [(NASTY, "plain"), (NASTY, "poor")]


def test_what_is_not_there_leaves_no_trace() -> None:
    assert Summary(title="A").html() == "<h1>A</h1>"
