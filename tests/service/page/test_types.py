"""The page's sources keep to their types."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from scaling_service.service.page.schema import TARGET, make_openapi, write_typescript
from tests.service.page.node import WEB, node


def test_types(npm: Path | None, tmp_path: Path) -> None:
    if npm is None:
        pytest.skip("TypeScript cannot be fetched from the npm registry")
    web = tmp_path / "service" / "page"
    shutil.copytree(WEB / "src", web / "src")
    shutil.copy(WEB / "tsconfig.json", web)
    (web / "node_modules").symlink_to(npm)
    program, _ = node()
    command = [str(program), str(npm / "typescript" / "bin" / "tsc"), "--noEmit"]
    done = subprocess.run(command, cwd=web, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_types_of_documents_are_those_of_the_openapi_document() -> None:
    written = TARGET.read_text(encoding="utf-8")
    assert written == write_typescript(make_openapi()), "run `python scaling_service/service/page/schema.py`"


def test_files_are_short() -> None:
    long = {
        path.name: count
        for folder in ("src", "styles")
        for path in (WEB / folder).rglob("*.*")
        if path.name != "schema.ts" and (count := len(path.read_text(encoding="utf-8").splitlines())) > 300
    }
    assert long == {}
