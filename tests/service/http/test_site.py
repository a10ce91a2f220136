"""The web page is served whole, by itself, and with a policy that lets nothing else in."""

from __future__ import annotations

import re
import socket
from importlib.metadata import files
from pathlib import Path

import pytest

from scaling_service.service.http import site
from tests.service.http.served import Served

BUILT = Path(site.__file__).parents[1] / "page" / "built"


@pytest.fixture
def bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A bundle made by hand."""
    folder = tmp_path / "built"
    (folder / "assets").mkdir(parents=True)
    (folder / "index.html").write_text('<script src="/assets/page-ABC.js"></script>', encoding="utf-8")
    (folder / "assets" / "page-ABC.js").write_text("// nothing\n" * 500, encoding="utf-8")
    (tmp_path / "secret.txt").write_text("no", encoding="utf-8")
    monkeypatch.setattr(site, "_BUNDLE", folder)
    return folder


def test_the_page_lets_in_nothing_but_its_own_scripts_and_styles(served: Served) -> None:
    if not (BUILT / "index.html").is_file():
        pytest.skip("the page was not bundled; install the package to have it")
    page = served.call("GET", "/")
    policy = dict(part.split(" ", 1) for part in page.headers["Content-Security-Policy"].split("; "))
    assert policy["default-src"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == "'self'"
    assert policy["frame-ancestors"] == policy["base-uri"] == policy["form-action"] == "'none'"
    assert not re.search(r"<script(?![^>]*\bsrc=)|<style|\son\w+=|\sstyle=", page.text)
    named = re.findall(r'(?:src|href)="([^"]+)"', page.text)
    assert any(name.endswith(".js") for name in named)
    for name in named:
        assert name.startswith(("/assets/", "data:,")), name
        if name.startswith("/"):
            assert served.call("GET", name).headers["Cache-Control"] == site.FOREVER


def test_what_is_installed_holds_the_bundle_and_not_its_sources() -> None:
    found = [str(file) for file in files("scaling-service") or ()]
    web = [name for name in found if "service/page/" in name]
    if not any(name.endswith("scaling_service/service/http/site.py") for name in found):
        pytest.skip("the package is installed where its sources are")
    assert any(name.endswith("built/index.html") for name in web)
    assert all("/built/" in name for name in web)


def test_without_a_bundle_the_page_says_so(served: Served, bundle: Path) -> None:
    (bundle / "index.html").unlink()
    page = served.call("GET", "/")
    assert (page.status_code, "<script" in page.text) == (200, False)
    assert 'href="/docs"' in page.text
    assert "built without the web page" in page.text


def test_files_are_compressed_kept_and_asked_for_once(served: Served, bundle: Path) -> None:
    address = "/assets/page-ABC.js"
    plain = served.call("GET", address, headers={"Accept-Encoding": "gzip;q=0"})
    packed = served.call("GET", address)  # requests asks for gzip, and unpacks it
    assert "Content-Encoding" not in plain.headers
    assert packed.headers["Content-Encoding"] == "gzip"
    assert int(packed.headers["Content-Length"]) < len(plain.content) / 10
    assert packed.content == plain.content == (bundle / "assets" / "page-ABC.js").read_bytes()
    assert packed.headers["Content-Type"].startswith("text/javascript")
    known = {"If-None-Match": packed.headers["ETag"]}
    assert served.call("GET", address, headers=known).status_code == 304
    assert served.call("GET", "/").headers["Cache-Control"] == "no-cache"


def test_a_monitor_may_ask_for_the_head_alone(served: Served, bundle: Path) -> None:
    head, whole = served.call("HEAD", "/"), served.call("GET", "/")
    assert (head.status_code, head.content) == (200, b"")
    assert head.headers["ETag"] == whole.headers["ETag"]


def test_a_changed_bundle_is_seen(served: Served, bundle: Path) -> None:
    first = served.call("GET", "/")
    (bundle / "index.html").write_text("<p>new</p>", encoding="utf-8")
    again = served.call("GET", "/", headers={"If-None-Match": first.headers["ETag"]})
    assert (again.status_code, again.text) == (200, "<p>new</p>")


@pytest.mark.parametrize(
    "path",
    [
        "/assets/",
        "/assets/none.js",
        "/assets/..%2f..%2fsecret.txt",
        "/assets/../../secret.txt",
        "/assets/%00",
    ],
)
def test_nothing_beside_the_bundle_is_reached(served: Served, bundle: Path, path: str) -> None:
    host, _, port = served.url.removeprefix("http://").partition(":")
    with socket.create_connection((host, int(port)), timeout=10) as raw:  # as it stands, not tidied
        raw.sendall(f"GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode())
        answer = b"".join(iter(lambda: raw.recv(65536), b""))
    assert answer.startswith(b"HTTP/1.1 404")
    assert b"application/problem+json" in answer


def test_the_page_needs_no_key_and_the_service_asks_for_one(served: Served, bundle: Path) -> None:
    key = served.key("lab")
    assert served.call("GET", "/").status_code == 200
    assert served.call("GET", "/assets/page-ABC.js").status_code == 200
    refused = served.call("GET", "/v1/vocabulary")
    assert (refused.status_code, refused.json()["type"]) == (401, "urn:scaling-service:KeyNeeded")
    assert {m["name"] for m in served.call("GET", "/v1/vocabulary", key).json()["methods"]} >= {"MB", "EB"}


def test_the_guide_is_served_under_the_same_policy(served: Served) -> None:
    page = served.call("GET", "/guide/missing-effect.html")
    assert page.status_code == 200
    assert page.headers["Content-Security-Policy"] == site.POLICY
    assert not re.search(r"<script(?![^>]*\bsrc=)|<style|\son\w+=|\sstyle=", page.text)
    for name in re.findall(r'(?:src|href)="(\w+\.\w+)', page.text):
        assert served.call("GET", f"/guide/{name}").status_code == 200, name
    assert served.call("GET", "/guide").url.endswith("/guide/")
    assert served.call("GET", "/guide/../site.py").status_code == 404
