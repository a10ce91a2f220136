"""A report: one file that loads nothing, runs the page's own script only, and holds the result."""

from __future__ import annotations

import base64
import gzip
import hashlib
import re
from pathlib import Path

import pytest

from scaling_service.documents.results import TrustNote
from scaling_service.report import onefile
from scaling_service.report.onefile import Report, collect_files
from scaling_service.report.summary import Summary
from tests.report.reading import Node, data, read
from tests.report.test_tables import NASTY

REPORT = Report(
    kind="nothing",
    name="result.json",
    summary=Summary(title=NASTY, headline=NASTY),
    document=TrustNote(topic=NASTY, level="good", text="<!--<script>"),
    files={"scene/one.f32": b"\0\1\2"},
    beside=["model.json"],
)


@pytest.fixture
def bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Stands in for what npm builds."""
    for name, text in (("report.js", "go()"), ("style.css", "p{}"), ("licences.txt", "MIT <a>")):
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.setattr(onefile, "BUNDLE", tmp_path)
    onefile._read_part.cache_clear()
    return tmp_path


@pytest.fixture(autouse=True)
def _forget() -> None:
    onefile._read_part.cache_clear()


@pytest.fixture
def root(bundle: Path) -> Node:
    return read(REPORT.html().removeprefix("<!doctype html>"))


def test_nothing_is_loaded(root: Node) -> None:
    loading = [
        (node.tag, name, value)
        for tag in ("script", "link", "img", "iframe", "source", "video", "audio", "object", "embed", "a")
        for node in root.all(tag)
        for name, value in node.attributes.items()
        if name in ("src", "href", "data", "srcset")
    ]
    assert loading == []


def test_the_policy_admits_just_the_bundle(root: Node) -> None:
    (policy,) = [m for m in root.all("meta") if m.attributes.get("http-equiv") == "Content-Security-Policy"]
    content = policy.attributes["content"] or ""
    assert content.startswith("default-src 'none';")
    allowed = re.findall(r"'sha256-([^']+)'", content)
    scripts = [s.text for s in root.all("script") if "type" not in s.attributes]
    assert [base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts] == allowed
    assert len(scripts) == 1
    assert "unsafe-eval" not in content
    assert "unsafe-inline" not in content.split("style-src")[0]


def test_names_from_files_stay_text(root: Node) -> None:
    assert root.all("h1")[0].text == NASTY
    assert [s.attributes.get("type") for s in root.all("script")] == ["application/json", None]
    (held,) = data(root)
    assert held["document"] == {"topic": NASTY, "level": "good", "text": "<!--<script>"}


def test_it_holds_what_its_views_ask_for(root: Node) -> None:
    (held,) = data(root)
    assert gzip.decompress(base64.b64decode(held["files"]["scene/one.f32"])) == b"\0\1\2"
    assert held["beside"] == ["result.json", "model.json"]
    assert held["summary"]["headline"] == NASTY


def test_without_the_page_it_is_the_summary_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(onefile, "BUNDLE", tmp_path / "none")
    root = read(REPORT.html().removeprefix("<!doctype html>"))
    assert root.all("script") == []
    assert root.all("noscript") == []
    assert "built without the web page" in root.all("main")[0].text
    assert "script-src 'none'" in str([m.attributes for m in root.all("meta")])


def test_what_is_written_is_collected_by_its_names() -> None:
    def write(folder: Path) -> None:
        (folder / "a").mkdir()
        (folder / "a" / "b.txt").write_bytes(b"1")

    assert collect_files(write) == {"a/b.txt": b"1"}
