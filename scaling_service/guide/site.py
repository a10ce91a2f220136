"""The guide as web pages that need nothing else: served as they are, or written into a folder."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cache
from html import escape
from pathlib import Path
from types import MappingProxyType

from markdown_it import MarkdownIt
from markdown_it.token import Token

from scaling_service.guide import notebooks
from scaling_service.guide.pages import PARTS, list_pages, list_sections, parse, read_title

_HERE = Path(__file__).parent
_AS_THEY_ARE = (".svg", ".png", ".ipynb")

_OPTIONS = MarkdownIt("commonmark").options
_SEARCH = (
    '<form role="search" id="search"><input type="search" id="words" placeholder="Search the guide" '
    'aria-label="Search the guide" autocomplete="off"></form>'
)


@cache
def make_site() -> Mapping[str, bytes]:
    """Make all files of the guide, by name; ``index.html`` is the first page."""
    files = {f"{name}.html": _render_page(name).encode() for name in list_pages()}
    files["index.html"] = files[f"{list_pages()[0]}.html"]
    found = [asdict(section) for section in list_sections()]
    files["sections.js"] = f"const SECTIONS = {json.dumps(found, ensure_ascii=False)};\n".encode()
    for file in (_HERE / "guide.css", _HERE / "guide.js", *notebooks.FOLDER.iterdir()):
        if file.suffix in (".css", ".js", *_AS_THEY_ARE):
            files[file.name] = file.read_bytes()
    for name in list_pages():
        if name.startswith(notebooks.NOTEBOOK):
            files |= notebooks.draw_images(name)
    return MappingProxyType(files)


def write_site(folder: Path) -> list[str]:
    """Write the guide into a folder, to be opened without a service; returns the names of the files."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in make_site().items():
        (folder / name).write_bytes(content)
    return sorted(make_site())


def _render_page(name: str) -> str:
    tokens = parse(name)
    for token in tokens:
        for child in token.children or ():
            if child.type == "link_open":
                child.attrSet("href", _rewrite_address(str(child.attrGet("href"))))
    body = MarkdownIt("commonmark").enable("table").renderer.render(_in_frames(tokens), _OPTIONS, {})
    at = list_pages().index(name)
    around = [
        f'<a rel="{rel}" href="{list_pages()[k]}.html">{escape(read_title(list_pages()[k]))}</a>'
        for rel, k in (("prev", at - 1), ("next", at + 1))
        if 0 <= k < len(list_pages())
    ]
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark">'
        f"<title>{escape(read_title(name))} · scaling-service</title>"
        '<link rel="icon" href="data:,"><link rel="stylesheet" href="guide.css">'
        '<script src="sections.js" defer></script><script src="guide.js" defer></script>'
        '<a class="skip" href="#page">To the text</a>'
        f'<header><a class="brand" href="index.html">scaling-service guide</a>{_SEARCH}</header>'
        f'<div class="columns">{_render_contents(name)}<main id="page">'
        f'<ol id="found" hidden></ol><article>{body}</article>'
        f'<nav class="around" aria-label="Pages before and after">{"".join(around)}</nav></main></div></html>'
    )


def _rewrite_address(href: str) -> str:
    """Of a link: other pages are ``.md`` files where they are written and ``.html`` here."""
    page, mark, anchor = href.partition("#")
    return f"{page.removesuffix('.md')}.html{mark}{anchor}" if page.endswith(".md") else href


def _in_frames(tokens: Sequence[Token]) -> list[Token]:
    """Every table in a frame of its own, which scrolls where the screen is narrow."""
    framed: list[Token] = []
    for token in tokens:
        if token.type == "table_open":
            framed.append(Token("html_block", "", 0, content='<div class="table">'))
        framed.append(token)
        if token.type == "table_close":
            framed.append(Token("html_block", "", 0, content="</div>"))
    return framed


def _render_contents(current: str) -> str:
    parts = "".join(
        f"<h2>{escape(part)}</h2><ul>{''.join(_render_entry(name, current) for name in pages)}</ul>"
        for part, pages in PARTS.items()
    )
    inside = f"<details open><summary>Contents</summary>{parts}</details>"
    return f'<nav id="contents" aria-label="Contents">{inside}</nav>'


def _render_entry(name: str, current: str) -> str:
    here = ' aria-current="page"' if name == current else ""
    return f'<li><a href="{name}.html"{here}>{escape(read_title(name))}</a></li>'
