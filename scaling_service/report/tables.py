"""Tables of results as values: the terminal prints them, and a report without JavaScript shows them.

Every text is escaped here, so that callers hand over what files and labels say as is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from scaling_service.documents.base import Tone


@dataclass(frozen=True, slots=True)
class Cell:
    """A table's cell.

    ``tone``: a coloured mark before the text; the text itself must say the same.
    """

    text: str
    tone: Tone = "plain"

    def html(self, tag: str = "td", attributes: str = "", *, words: bool = False) -> str:
        """One cell.

        Examples
        --------
        >>> Cell("a < b").html()
        '<td>a &lt; b</td>'
        """
        classes = [*(["words"] if words else []), *([] if self.tone == "plain" else ["tone", self.tone])]
        styled = f' class="{" ".join(classes)}"' if classes else ""
        return f"<{tag}{attributes}{styled}>{escape(self.text)}</{tag}>"


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
    ``words``: whether cells hold sentences, not numbers: they are then aligned left and may wrap.
    """

    caption: str
    columns: Sequence[str]
    rows: Sequence[Row]
    note: str = ""
    words: bool = False

    def describe(self) -> dict[str, Any]:
        """As JSON; every cell is its text and its tone."""
        rows = [[to_cell(cell) for cell in (row.header, *row.cells)] for row in self.rows]
        return {
            "caption": self.caption,
            "columns": list(self.columns),
            "rows": [[(cell.text, cell.tone) for cell in row] for row in rows],
            "note": self.note,
            "words": self.words,
        }

    def html(self) -> str:
        """One ``figure`` with a ``table`` that scrolls sideways where it is wider than the page."""
        words = ' class="words"' if self.words else ""
        head = "".join(f'<th scope="col"{words}>{escape(column)}</th>' for column in self.columns)
        body = ""
        for row in self.rows:
            span = "" if row.cells else f' colspan="{len(self.columns)}"'
            header = to_cell(row.header).html("th", f' scope="row"{span}')
            shown = (to_cell(cell).html(words=self.words) for cell in row.cells)
            body += f"<tr>{header}{''.join(shown)}</tr>"
        note = f'<p class="note">{escape(self.note)}</p>' if self.note else ""
        return (
            f'<figure class="tabular"><figcaption class="caption">{escape(self.caption)}</figcaption>'
            f'<div class="table" role="region" tabindex="0" aria-label="{escape(self.caption)}">'
            f'<table aria-label="{escape(self.caption)}">'
            f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>{note}</figure>"
        )


def to_cell(cell: str | Cell) -> Cell:
    """A text as a cell without a tone."""
    return cell if isinstance(cell, Cell) else Cell(cell)
