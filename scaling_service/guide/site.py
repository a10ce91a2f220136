"""The guide as web pages that need nothing else: served as they are, or written into a folder."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from functools import cache
from html import escape
from pathlib import Path
from string import Template
from types import MappingProxyType

from markdown_it import MarkdownIt
from markdown_it.token import Token

from scaling_service.guide import notebooks
from scaling_service.guide.pages import PARTS, list_pages, list_sections, parse, read_title

_HERE = Path(__file__).parent
_AS_THEY_ARE = (".svg", ".png", ".ipynb")

_OPTIONS = MarkdownIt("commonmark").options


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
    framed: list[Token] = []
    for token in tokens:
        # Other pages are `.md` files where they are written and `.html` here.
        for child in token.children or ():
            if child.type == "link_open":
                page, mark, anchor = str(child.attrGet("href")).partition("#")
                if page.endswith(".md"):
                    child.attrSet("href", f"{page.removesuffix('.md')}.html{mark}{anchor}")
        # A table stands in a frame of its own, which scrolls where the screen is narrow.
        if token.type == "table_open":
            framed.append(Token("html_block", "", 0, content='<div class="table">'))
        framed.append(token)
        if token.type == "table_close":
            framed.append(Token("html_block", "", 0, content="</div>"))
    body = MarkdownIt("commonmark").enable("table").renderer.render(framed, _OPTIONS, {})
    at = list_pages().index(name)
    around = [
        f'<a rel="{rel}" href="{list_pages()[k]}.html">{escape(read_title(list_pages()[k]))}</a>'
        for rel, k in (("prev", at - 1), ("next", at + 1))
        if 0 <= k < len(list_pages())
    ]
    parts = []
    for part, pages in PARTS.items():
        here = {page: ' aria-current="page"' if page == name else "" for page in pages}
        links = (f'<a href="{page}.html"{here[page]}>{escape(read_title(page))}</a>' for page in pages)
        parts.append(f"<h2>{escape(part)}</h2><ul>{''.join(f'<li>{link}</li>' for link in links)}</ul>")
    return Template((_HERE / "page.html").read_text(encoding="utf-8")).substitute(
        title=escape(read_title(name)), contents="".join(parts), body=body, around="".join(around)
    )
