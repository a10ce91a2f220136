"""What is bundled comes with its licences."""

from __future__ import annotations

import json
from pathlib import PurePosixPath

from tests.service.page.conftest import Visit
from tests.service.page.node import WEB


def test_every_package_has_its_notice(visit: Visit, url: str) -> None:
    visitor = visit(url)
    visitor.go()
    visitor.follow("Licences of what this page is made of")
    visitor.page.wait_for_function("document.body.innerText.includes('Permission is hereby granted')")
    text = visitor.page.locator("body").inner_text()
    named = json.loads((WEB / "package.json").read_text(encoding="utf-8"))["dependencies"]
    for package, version in named.items():
        if package != "esbuild":  # it bundles, and is not bundled
            assert f"{package} {version} (" in text, PurePosixPath(visitor.page.url).name
    assert text.count("Permission is hereby granted") >= 1  # MIT
    assert "Permission to use, copy, modify, and/or distribute" in text  # ISC
