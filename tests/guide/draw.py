"""``python -m tests.guide.draw``: what pages hold that is made from the code.

The layers in ARCHITECTURE.md come from the contract that is checked, the guide's page on HTTP from the
OpenAPI document, the README's figure from the benchmark's measured tables.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import Any

from scaling_service.guide.pages import FOLDER, read_figures
from scaling_service.service.http.documentation import describe
from scaling_service.service.page.schema import make_openapi
from scaling_service.studies.benchmark.parts import OPENSIM, OURS
from scaling_service.studies.benchmark.tasks import TASKS

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / ".github" / "ARCHITECTURE.md"
HTTP = FOLDER / "http.md"
FIGURE = ROOT / ".github" / "benchmark.svg"
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


_COLOURS = {OURS: "#1f6feb", OPENSIM: "#d29922"}
_WIDE, _ROW, _LEFT, _LONGEST = 860, 44, 430, 300  # px


def draw_benchmark() -> str:
    """Mean places in every task of the benchmark, as SVG: the shorter, the nearer to the truth."""
    rows = {name: read_figures()["benchmark"][name] for name in (*TASKS, "whole")}
    height = _ROW * len(rows) + 50
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_WIDE}" height="{height}" font-family="sans-serif" '
        'font-size="13"><rect width="100%" height="100%" fill="white"/>',
        '<text x="12" y="24" font-weight="bold">Mean place, 1 being nearest to the truth</text>',
    ]
    for k, (entry, colour) in enumerate(_COLOURS.items()):
        x = _LEFT + 150 * k
        lines += [f'<rect x="{x}" y="13" width="12" height="12" fill="{colour}"/>']
        lines += [f'<text x="{x + 18}" y="24">{entry}</text>']
    for k, table in enumerate(rows.values()):
        lines += _draw_task(table, 42 + _ROW * k)
    return "\n".join([*lines, "</svg>", ""])


def _draw_task(table: Mapping[str, Any], top: int) -> Iterator[str]:
    yield f'<text x="12" y="{top + 22}">{escape(table["columns"][0])}</text>'
    places = {row[0]: row[-1] for row in table["rows"]}
    for k, (entry, colour) in enumerate(_COLOURS.items()):
        y, long = top + 6 + 16 * k, round(_LONGEST * float(places[entry]) / len(_COLOURS))
        yield f'<rect x="{_LEFT}" y="{y}" width="{long}" height="13" fill="{colour}"/>'
        yield f'<text x="{_LEFT + long + 8}" y="{y + 11}">{places[entry]}</text>'


def main() -> None:
    """Put everything into its place."""
    PAGE.write_text(_PLACE.sub(draw_layers(), PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    HTTP.write_text(describe_http(), encoding="utf-8")
    FIGURE.write_text(draw_benchmark(), encoding="utf-8")


if __name__ == "__main__":
    main()
