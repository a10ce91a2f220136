"""Notebooks among the pages: Jupyter files that were executed, shown as Markdown."""

from __future__ import annotations

import base64
import json
from collections import abc
from functools import lru_cache
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).with_name("pages")
NOTEBOOK = "notebook-"
"""Names of pages that are notebooks begin so."""

COMMAND = "!"
"""In a cell of a notebook a line that begins so is for the shell."""


@lru_cache(maxsize=16)
def read_notebook(name: str) -> Any:
    """Read a notebook as its file has it (nbformat 4)."""
    return json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))


def render_notebook(name: str) -> str:
    """Render a notebook as Markdown: its words, its code, and what the code printed and drew."""
    head, *cells = read_notebook(name)["cells"]
    title, _, words = "".join(head["source"]).partition("\n")
    link = f"This page is a notebook: [{name}.ipynb]({name}.ipynb)."
    blocks = [title, link, words.strip()]
    for cell in cells:
        blocks += _render_cell(cell, name)
    return "\n\n".join(blocks) + "\n"


def _render_cell(cell: abc.Mapping[str, Any], name: str) -> abc.Iterator[str]:
    source = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        yield source
        return
    if source.startswith(COMMAND):
        yield f"```bash\n{source.removeprefix(COMMAND)}\n```"
    else:
        yield f"```python\n{source}\n```"
    if printed := "\n".join(text for output in cell["outputs"] if (text := read_output(output))):
        yield f"```text\n{printed}\n```"
    if any(map(_render_image, cell["outputs"])):
        yield f"![Figure]({_name_image(name, cell)})"


def read_output(output: abc.Mapping[str, Any]) -> str:
    """What an output says in words; empty for a figure."""
    if _render_image(output):
        return ""
    text = output["text"] if output["output_type"] == "stream" else output["data"]["text/plain"]
    return "".join(text).rstrip()


def draw_images(name: str) -> dict[str, bytes]:
    """The figures of a notebook by the names under which its page shows them."""
    return {
        _name_image(name, cell): base64.b64decode(image)
        for cell in read_notebook(name)["cells"]
        for output in cell.get("outputs", ())
        if (image := _render_image(output))
    }


def _render_image(output: abc.Mapping[str, Any]) -> str:
    return str(output.get("data", {}).get("image/png", ""))


def _name_image(name: str, cell: abc.Mapping[str, Any]) -> str:
    return f"{name}-{cell['execution_count']}.png"
