"""A page read back with the standard library's parser: its tree, tables, scripts and links."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from html.parser import HTMLParser
from typing import Any

import pytest

VOID = {"meta", "input", "br", "link", "img", "circle", "path"}


@dataclass
class Node:
    """An element."""

    tag: str
    attributes: dict[str, str | None]
    children: list[Node | str] = field(default_factory=list)

    @property
    def text(self) -> str:
        return "".join(child if isinstance(child, str) else child.text for child in self.children)

    def all(self, tag: str, kind: str | None = None) -> list[Node]:
        """Every element of a tag (and a class) within, in order."""
        found = []
        for child in self.children:
            if isinstance(child, Node):
                classes = (child.attributes.get("class") or "").split()
                if child.tag == tag and (kind is None or kind in classes):
                    found.append(child)
                found += child.all(tag, kind)
        return found


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.root = Node("", {})
        self._open = [self.root]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        node = Node(tag, dict(attrs))
        self._open[-1].children.append(node)
        if tag not in VOID:
            self._open.append(node)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._open[-1].children.append(Node(tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        if tag in VOID:
            return
        assert self._open[-1].tag == tag, f"</{tag}> closes <{self._open[-1].tag}>"
        self._open.pop()

    def handle_data(self, data: str) -> None:
        self._open[-1].children.append(data)

    def finished(self) -> Node:
        assert [n.tag for n in self._open] == [""], "an element is not closed"
        return self.root


def read(html: str) -> Node:
    """The tree; fails where elements are not closed in order."""
    reader = _Reader()
    reader.feed(html)
    reader.close()
    return reader.finished()


def tables(root: Node) -> dict[str, list[list[str]]]:
    """Caption to rows of texts, the header first."""
    found = {}
    for figure in root.all("figure", "tabular"):
        (caption,) = figure.all("figcaption")
        rows = [[c.text for c in row.children if isinstance(c, Node)] for row in figure.all("tr")]
        found[caption.text] = rows
    return found


def data(root: Node) -> list[Any]:
    """What every block of data holds."""
    return [json.loads(s.text) for s in root.all("script") if s.attributes.get("type") == "application/json"]


def held(root: Node) -> Any:
    """What a report holds for its views; who built the package without the page has none."""
    found = data(root)
    if not found:
        pytest.skip("this installation was built without the web page")
    (one,) = found
    return one
