"""A page: one file that loads nothing, runs its own scripts only, and can be walked by its headings."""

from __future__ import annotations

import base64
import hashlib
import re

import pytest

from scaling_service.report.blocks import Page, Section, Text
from tests.report.reading import Node, read


@pytest.fixture(scope="module")
def html() -> str:
    sections = [Section("First part", [Text("one")]), Section("Second: part", [Text("two")], new_page=True)]
    return Page("A <title>", sections, "below", "end").html()


@pytest.fixture(scope="module")
def root(html: str) -> Node:
    return read(html)


def test_nothing_is_loaded(root: Node) -> None:
    loading = [
        (node.tag, name, value)
        for tag in ("script", "link", "img", "iframe", "source", "video", "audio", "object", "embed", "a")
        for node in root.all(tag)
        for name, value in node.attributes.items()
        if name in ("src", "href", "data", "srcset") and not (value or "").startswith("#")
    ]
    assert loading == []
    (style,) = root.all("style")
    assert "url(" not in style.text
    assert "@import" not in style.text


def test_the_policy_admits_just_the_scripts_of_the_page(root: Node) -> None:
    (policy,) = [m for m in root.all("meta") if m.attributes.get("http-equiv") == "Content-Security-Policy"]
    content = policy.attributes["content"] or ""
    assert content.startswith("default-src 'none';")
    allowed = set(re.findall(r"'sha256-([^']+)'", content))
    scripts = [s.text for s in root.all("script") if "type" not in s.attributes]
    assert {base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts} == allowed
    assert len(scripts) == 2
    assert "unsafe-eval" not in content
    assert "unsafe-inline" not in content.split("style-src")[0]


def test_contents_lead_to_the_sections(root: Node) -> None:
    links = [a.attributes["href"] for a in root.all("a")]
    assert links == ["#first-part", "#second-part"]
    assert [h.attributes["id"] for h in root.all("h2")] == ["first-part", "second-part"]
    assert [s.attributes["aria-labelledby"] for s in root.all("section")] == ["first-part", "second-part"]


def test_language_title_and_width_are_said(root: Node) -> None:
    (page,) = root.all("html")
    assert page.attributes["lang"] == "en"
    assert [t.text for t in root.all("h1")] == ["A <title>"]
    assert any(m.attributes.get("name") == "viewport" for m in root.all("meta"))


def test_the_same_page_is_the_same_bytes(html: str) -> None:
    sections = [Section("First part", [Text("one")]), Section("Second: part", [Text("two")], new_page=True)]
    assert Page("A <title>", sections, "below", "end").html() == html
