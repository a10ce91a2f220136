"""The pages of the guide as text: their order, the measured figures in them, and what a search finds."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any

from markdown_it import MarkdownIt
from markdown_it.token import Token

from scaling_service.core.errors import InputError
from scaling_service.guide.notebooks import FOLDER, NOTEBOOK, render_notebook
from scaling_service.guide.reference import describe_interface

FIGURES = Path(__file__).with_name("figures.json")

PARTS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "Use it": (
            "first-steps",
            "own-recording",
            "verdict",
            "joint-angles",
            "forces",
            "missing-effect",
            "cohort",
        ),
        "Run it for others": ("service", "scaling-out"),
        "How it works": (
            "method-scaling",
            "method-lengths",
            "method-motion",
            "method-bones",
            "method-forces",
            "method-effects",
            "studies",
        ),
        "Notebooks": (
            "notebook-scale",
            "notebook-compare",
            "notebook-bones",
            "notebook-cohort",
            "notebook-effect",
        ),
        "Look up": ("files", "python", "python-names", "http"),
    }
)
"""Headings of the table of contents, and the pages under each: file names without suffix."""

_FIGURE = re.compile(r"\{\{(table )?([\w.]+)(?::([^{}]+))?\}\}")


class NoSuchPage(InputError):
    """The guide has no page of this name."""


@dataclass(frozen=True, slots=True)
class Section:
    """A heading of a page and the text under it, which is what a search finds."""

    page: str
    page_title: str
    anchor: str  # empty for the page's own heading
    title: str
    text: str


def names() -> tuple[str, ...]:
    """All pages, in reading order."""
    return tuple(name for part in PARTS.values() for name in part)


@lru_cache(maxsize=64)  # more than there are
def read_page(name: str) -> str:
    """Read a page as Markdown, with the measured figures in their places.

    Raises NoSuchPage.
    """
    if name not in names():
        raise NoSuchPage(f"the guide has no page '{name}'", remedy=f"Choose one of {', '.join(names())}")
    if name.startswith(NOTEBOOK):
        return render_notebook(name)
    text = (FOLDER / f"{name}.md").read_text(encoding="utf-8").replace("{{interface}}", describe_interface())
    return fill(text, read_figures())


@cache
def read_figures() -> Any:
    """Measured figures by name, as ``python -m tests.guide.renew`` wrote them."""
    return json.loads(FIGURES.read_text(encoding="utf-8"))


def fill(text: str, figures: Mapping[str, Any]) -> str:
    """Put figures where a page names them.

    Parameters
    ----------
    text : str
        With ``{{a.b}}``, ``{{a.b:.1f}}`` (as Python formats), or ``{{table a.b}}``.
    figures : mapping
        Nested; a table has ``columns`` and ``rows``.

    Raises
    ------
    KeyError
        There is no such figure.

    Examples
    --------
    >>> fill("{{knee.error_deg:.1f}} degrees", {"knee": {"error_deg": 3.14}})
    '3.1 degrees'
    """

    def one(found: re.Match[str]) -> str:
        value: Any = figures
        for key in found[2].split("."):
            value = value[key]
        if found[1]:
            lines = [value["columns"], ["---"] * len(value["columns"]), *value["rows"]]
            return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)
        return format(value, found[3] or "")

    return _FIGURE.sub(one, text)


def parse(name: str) -> list[Token]:
    """Read a page as tokens of Markdown, every heading with an anchor."""
    tokens = MarkdownIt("commonmark").enable("table").parse(read_page(name))
    for token, inside in pairwise(tokens):
        if token.type == "heading_open":
            token.attrSet("id", slug(inside.content))
    return tokens


def slug(title: str) -> str:
    """Turn a heading into its anchor, as GitHub does.

    Examples
    --------
    >>> slug("Backup, and `restore`")
    'backup-and-restore'
    """
    return re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-")


@cache
def sections() -> tuple[Section, ...]:
    """All sections of all pages."""
    return tuple(section for name in names() for section in _split(name))


def title_of(name: str) -> str:
    """The page's own heading."""
    if name.startswith(NOTEBOOK):
        return render_notebook(name).partition("\n")[0].removeprefix("# ")
    with (FOLDER / f"{name}.md").open(encoding="utf-8") as page:
        return page.readline().removeprefix("# ").rstrip()


def _split(name: str) -> Iterator[Section]:
    page_title, title, anchor = title_of(name), "", ""
    text: list[str] = []
    heading = False
    for token in parse(name):
        if token.type == "heading_open":
            if title:
                yield Section(name, page_title, anchor, title, " ".join(text))
            heading, text = True, []
            anchor = "" if token.tag == "h1" else str(token.attrGet("id"))
        elif token.type in ("inline", "fence", "code_block"):
            if heading:
                title, heading = token.content, False
            else:
                text.append(_plain(token))
    yield Section(name, page_title, anchor, title, " ".join(text))


def _plain(token: Token) -> str:
    """The words of a block, without its marks."""
    if token.children is None:
        return token.content
    return "".join(child.content or " " for child in token.children)


def search(words: str) -> list[Section]:
    """Find the sections that hold all words, those first that have them in their headings.

    Examples
    --------
    >>> search("soft tissue")[0].page
    'missing-effect'
    """
    wanted = words.lower().split()

    def weigh(section: Section) -> tuple[int, int]:
        title, text = f"{section.title} {section.page_title}".lower(), section.text.lower()
        return sum(word in title for word in wanted), sum(text.count(word) for word in wanted)

    found = [s for s in sections() if all(w in f"{s.page_title} {s.title} {s.text}".lower() for w in wanted)]
    return sorted(found, key=weigh, reverse=True) if wanted else []
