"""What a result says in a minute: a headline, what it rests on, what to beware of, the main tables.

A report shows it to who has no JavaScript. Its sentences are those of the result's document, which terminal
and page show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from scaling_service.documents.base import Tone
from scaling_service.report.tables import Table


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """A result in short.

    ``title``, ``subtitle``: whose result it is, and how it came about.
    ``headline``, ``tone``: the verdict, and whether it is good news.
    ``why``: what the verdict rests on.
    ``cautions``: what to beware of.
    """

    title: str
    subtitle: str = ""
    headline: str = ""
    tone: Tone = "plain"
    why: Sequence[str] = ()
    cautions: Sequence[str] = ()
    tables: Sequence[Table] = ()

    def describe(self) -> dict[str, Any]:
        """As JSON, for views that show tables as they are."""
        tables = [table.describe() for table in self.tables]
        return {"headline": self.headline, "tone": self.tone, "why": list(self.why), "tables": tables}

    def html(self) -> str:
        """The content of a page's ``main``."""
        subtitle = f'<p class="quiet">{escape(self.subtitle)}</p>' if self.subtitle else ""
        verdict = (
            f'<div class="callout {self.tone}"><p class="headline">{escape(self.headline)}</p>'
            f"{_list_items(self.why)}</div>"
        )
        return "".join(
            (
                f"<h1>{escape(self.title)}</h1>{subtitle}",
                verdict if self.headline else "",
                f"<h2>What to beware of</h2>{_list_items(self.cautions)}" if self.cautions else "",
                *(table.html() for table in self.tables),
            )
        )


def _list_items(items: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{escape(item)}</li>' for item in items)}</ul>" if items else ""
