"""What a page is built of: text, lists, tables, callouts and grids, each giving its own HTML; the page.

A block is a frozen value with one method, :meth:`Block.html`. Every text is escaped here, so that callers
hand over what files and labels say as is. Figures are in ``figures``, the interactive overlay in ``scene``.
A report of a cohort or a study needs no block of its own: it is a function from results to a list of these.
A page puts them together into one HTML file that needs nothing else::

    Page("Report of S01", [Section("Results", [Text("…"), Table(…), Figure(…)])]).html()

Scripts and styles are inside; a content security policy forbids the page to load or send anything and lets no
script run but its own two, whatever text comes from files.
"""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from html import escape
from importlib.resources import files
from typing import Literal, Protocol

from plotly.offline import get_plotlyjs

Tone = Literal["good", "fair", "poor", "unknown", "plain"]


class Block(Protocol):
    """A piece of a page."""

    def html(self) -> str:
        """Its HTML, all text escaped."""


@dataclass(frozen=True, slots=True)
class Text:
    """A paragraph.

    Examples
    --------
    >>> Text("a < b").html()
    '<p>a &lt; b</p>'
    """

    text: str
    quiet: bool = False

    def html(self) -> str:
        """One ``p``."""
        return f"<p{_write_class('quiet' if self.quiet else '')}>{escape(self.text)}</p>"


@dataclass(frozen=True, slots=True)
class Heading:
    """A heading within a section."""

    text: str

    def html(self) -> str:
        """One ``h3``."""
        return f"<h3>{escape(self.text)}</h3>"


@dataclass(frozen=True, slots=True)
class Bullets:
    """A list of sentences."""

    items: Sequence[str]
    numbered: bool = False

    def html(self) -> str:
        """One ``ul`` or ``ol``; nothing where there is no item."""
        if not self.items:
            return ""
        tag = "ol" if self.numbered else "ul"
        return f"<{tag}>{''.join(f'<li>{escape(item)}</li>' for item in self.items)}</{tag}>"


@dataclass(frozen=True, slots=True)
class Callout:
    """What must not be overlooked: a headline and what belongs to it."""

    headline: str
    blocks: Sequence[Block] = ()
    tone: Tone = "plain"

    def html(self) -> str:
        """One ``div`` of the tone's class."""
        inside = "".join(block.html() for block in self.blocks)
        return (
            f'<div class="callout {self.tone}"><p class="headline">{escape(self.headline)}</p>{inside}</div>'
        )


@dataclass(frozen=True, slots=True)
class Cell:
    """A table's cell.

    ``shade``: 0 to 1: how dark its background is, so that a table reads as a heat map. The number stays
        readable.
    ``tone``: a coloured mark before the text; the text itself must say the same.
    ``colour``: CSS colour of a chip before the text, as of a method.
    """

    text: str
    shade: float | None = None
    tone: Tone = "plain"
    colour: str | None = None

    def html(self, tag: str = "td", attributes: str = "") -> str:
        """One cell."""
        named = _write_class("" if self.tone == "plain" else f"tone {self.tone}")
        style = "" if self.shade is None else f' style="--shade:{min(max(self.shade, 0.0), 1.0):.2f}"'
        chip = "" if self.colour is None else f'<i class="chip" style="background:{escape(self.colour)}"></i>'
        return f"<{tag}{attributes}{named}{style}>{chip}{escape(self.text)}</{tag}>"


@dataclass(frozen=True, slots=True)
class Row:
    """A row: its header and its cells. A row without cells is a title of the rows below it."""

    header: str | Cell
    cells: Sequence[str | Cell] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table with headers for its columns and rows.

    ``columns``: the first is above the row headers.
    ``note``: below the table.
    ``words``: whether cells hold sentences, not numbers: they are then aligned left and may wrap, and on a
        narrow screen each row is a block of its own.
    ``long``: whether it has many short rows: it then runs on in a second column where there is room.
    """

    caption: str
    columns: Sequence[str | Cell]
    rows: Sequence[Row]
    note: str = ""
    words: bool = False
    long: bool = False

    def html(self) -> str:
        """One ``figure`` with a ``table`` that scrolls sideways where it is wider than the page."""
        head = "".join(_to_cell(column).html("th", ' scope="col"') for column in self.columns)
        body = "".join(self._row(row) for row in self.rows)
        note = f'<p class="note">{escape(self.note)}</p>' if self.note else ""
        kinds = ["table", *(["words"] if self.words else []), *(["long"] if self.long else [])]
        return (
            f'<figure class="tabular"><figcaption class="caption">{escape(self.caption)}</figcaption>'
            f'<div{_write_class(" ".join(kinds))} role="region" tabindex="0" '
            f'aria-label="{escape(self.caption)}">'
            f'<table aria-label="{escape(self.caption)}"><thead><tr>{head}</tr></thead><tbody>{body}</tbody>'
            f"</table></div>{note}</figure>"
        )

    def _row(self, row: Row) -> str:
        if not row.cells:
            span = f' scope="rowgroup" colspan="{len(self.columns)}"'
            return f'<tr class="title">{_to_cell(row.header).html("th", span)}</tr>'
        cells = "".join(_to_cell(cell).html() for cell in row.cells)
        header = _to_cell(row.header).html("th", ' scope="row"')
        return f"<tr>{header}{cells}</tr>"


@dataclass(frozen=True, slots=True)
class Grid:
    """Blocks side by side where there is room, one below the other where there is not."""

    blocks: Sequence[Block]

    def html(self) -> str:
        """One ``div``."""
        return f'<div class="grid">{"".join(block.html() for block in self.blocks)}</div>'


@dataclass(frozen=True, slots=True)
class Details:
    """What is hidden until it is asked for; printed open."""

    summary: str
    blocks: Sequence[Block]

    def html(self) -> str:
        """One ``details``."""
        inside = "".join(block.html() for block in self.blocks)
        return f"<details><summary>{escape(self.summary)}</summary>{inside}</details>"


@dataclass(frozen=True, slots=True)
class Legend:
    """What the colours of the figures around it mean.

    ``entries`` ((name, colour, dash)): ``dash`` is ``solid``, ``dash``, ``dot`` or ``dashdot``.
    """

    entries: Sequence[tuple[str, str, str]]

    def html(self) -> str:
        """One ``ul``."""
        items = "".join(
            f'<li><i class="line {escape(dash)}" style="color:{escape(colour)}"></i>{escape(name)}</li>'
            for name, colour, dash in self.entries
        )
        return f'<ul class="legend">{items}</ul>'


def _write_class(classes: str) -> str:
    return f' class="{classes}"' if classes else ""


def _to_cell(cell: str | Cell) -> Cell:
    return cell if isinstance(cell, Cell) else Cell(cell)


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a page under a heading of its own.

    ``new_page``: whether it starts a new page in print.
    """

    title: str
    blocks: Sequence[Block]
    new_page: bool = False

    @property
    def anchor(self) -> str:
        """Its name within the page."""
        return re.sub(r"[^a-z0-9]+", "-", self.title.lower()).strip("-")

    def html(self) -> str:
        """One ``section``."""
        inside = "".join(block.html() for block in self.blocks)
        named = ' class="new-page"' if self.new_page else ""
        return (
            f'<section{named} aria-labelledby="{self.anchor}">'
            f'<h2 id="{self.anchor}">{escape(self.title)}</h2>{inside}</section>'
        )


@dataclass(frozen=True, slots=True)
class Page:
    """A page of sections, with a list of them at its top."""

    title: str
    sections: Sequence[Section]
    subtitle: str = ""
    footer: str = ""

    def html(self) -> str:
        """The whole document."""
        scripts = (get_plotlyjs(), _read_asset("report.js"))
        links = "".join(f'<li><a href="#{s.anchor}">{escape(s.title)}</a></li>' for s in self.sections)
        subtitle = f'<p class="subtitle">{escape(self.subtitle)}</p>' if self.subtitle else ""
        return (
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            f'<meta http-equiv="Content-Security-Policy" content="{_write_policy(scripts)}">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{escape(self.title)}</title><style>{_read_asset('report.css')}</style></head><body>"
            f"<header><h1>{escape(self.title)}</h1>{subtitle}"
            f'<nav aria-label="Contents"><ul>{links}</ul></nav></header>'
            f"<main>{''.join(section.html() for section in self.sections)}</main>"
            f"<footer><p>{escape(self.footer)}</p></footer>"
            f"{''.join(f'<script>{script}</script>' for script in scripts)}</body></html>\n"
        )


def _write_policy(scripts: Sequence[str]) -> str:
    """Nothing from elsewhere, and only these scripts."""
    hashes = " ".join(f"'sha256-{_digest(script)}'" for script in scripts)
    return (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )


@lru_cache(maxsize=8)
def _digest(script: str) -> str:
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


@lru_cache(maxsize=8)
def _read_asset(name: str) -> str:
    return files("scaling_service.report").joinpath("assets", name).read_text(encoding="utf-8")
