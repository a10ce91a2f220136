"""``python -m tests.guide.draw``: what pages hold that is made from the code.

The layers in ARCHITECTURE.md come from the contract that is checked, the guide's page on HTTP from the
OpenAPI document.
"""

from __future__ import annotations

import re
import tomllib
from itertools import pairwise
from pathlib import Path

from scaling_service.guide.pages import FOLDER
from scaling_service.service.http.documentation import describe
from scaling_service.service.page.schema import make_openapi

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / ".github" / "ARCHITECTURE.md"
HTTP = FOLDER / "http.md"
_PLACE = re.compile(r"(?<=<!-- layers -->\n).*?(?=<!-- end -->)", re.DOTALL)


def draw_layers() -> str:
    """The layers as a Mermaid diagram, capabilities among themselves in one box."""
    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    whole, capabilities = (c["layers"] for c in pyproject["tool"]["importlinter"]["contracts"][:2])
    inside = [f"    {line}" for line in _edges(capabilities)]
    box = ["  subgraph capabilities", "    direction TB", *inside, "  end"]
    return "\n".join(
        ["```mermaid", "flowchart TB", *(f"  {line}" for line in _edges(whole)), *box, "```", ""]
    )


def _edges(layers: list[str]) -> list[str]:
    groups = [[name.strip() for name in layer.split("|")] for layer in layers]
    return [f"{' & '.join(above)} --> {' & '.join(below)}" for above, below in pairwise(groups)]


def describe_http() -> str:
    """The page on HTTP, with a service on this machine."""
    return describe(make_openapi(), "http://127.0.0.1:8000") + "\n"


def main() -> None:
    """Put everything into its place."""
    PAGE.write_text(_PLACE.sub(draw_layers(), PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    HTTP.write_text(describe_http(), encoding="utf-8")


if __name__ == "__main__":
    main()
