"""A page: one HTML file that needs nothing else.

::

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

from plotly.offline import get_plotlyjs

from scaling_service.report.blocks import Block


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
