"""``python -m tests.guide.notebooks [NAME…]``: execute the guide's notebooks, keep what they print and draw.

Each runs from its first cell to its last in a Python and a folder of its own, as Jupyter would run it.
"""

from __future__ import annotations

import ast
import base64
import io
import json
import os
import shlex
import subprocess
import sys
import tempfile
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

from scaling_service.guide.notebooks import COMMAND, FOLDER, NOTEBOOK
from tests.service.page.visitor import ARGUMENTS, CHROMIUM

ROOT = Path(__file__).resolve().parents[2]
NAMES = sorted(file.stem for file in FOLDER.glob(f"{NOTEBOOK}*.ipynb"))


def execute(name: str, *, draw: bool) -> list[list[dict[str, Any]]]:
    """Outputs of every cell of a notebook (nbformat 4); figures as pictures only if ``draw``."""
    words = [sys.executable, "-m", "tests.guide.notebooks", "--run", name, *(["--draw"] if draw else [])]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "COLUMNS": "100"}
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr)
    outputs: list[list[dict[str, Any]]] = json.loads(done.stdout.splitlines()[-1])
    return outputs


def read(name: str) -> dict[str, Any]:
    """A notebook's file."""
    content: dict[str, Any] = json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))
    return content


def write(name: str, content: dict[str, Any]) -> None:
    """Write a notebook as Jupyter does."""
    text = json.dumps(content, indent=1, ensure_ascii=False)
    (FOLDER / f"{name}.ipynb").write_text(text + "\n", encoding="utf-8")


def _run(name: str, *, draw: bool) -> list[list[dict[str, Any]]]:
    space: dict[str, Any] = {}
    return [
        _run_cell("".join(cell["source"]), k, space, draw) if cell["cell_type"] == "code" else []
        for k, cell in enumerate(read(name)["cells"])
    ]


def _run_cell(source: str, number: int, space: dict[str, Any], draw: bool) -> list[dict[str, Any]]:
    """Run one cell; what its last line is worth is shown, as a notebook shows it."""
    if source.startswith(COMMAND):
        for line in source.splitlines():
            _run_command(shlex.split(line.removeprefix(COMMAND)))
        return []
    body = ast.parse(source).body
    last = body.pop() if isinstance(body[-1], ast.Expr) else None
    printed, value = io.StringIO(), None
    with redirect_stdout(printed):
        exec(compile(ast.Module(body, []), f"cell {number}", "exec"), space)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), f"cell {number}", "eval"), space)
    outputs: list[dict[str, Any]] = []
    if printed.getvalue():
        outputs.append({"output_type": "stream", "name": "stdout", "text": _lines(printed.getvalue())})
    if value is not None:
        data = _show(value, draw)
        outputs.append(
            {"output_type": "execute_result", "execution_count": number, "metadata": {}, "data": data}
        )
    return outputs


def _run_command(words: list[str]) -> None:
    assert words[0] == "scaling-service", words
    subprocess.run([sys.executable, "-m", "scaling_service", *words[1:]], check=True, stdout=sys.stderr)


def _show(value: Any, draw: bool) -> dict[str, Any]:
    if hasattr(value, "to_plotly_json"):
        said = {"text/plain": ["Figure"]}
        return said | {"image/png": _photograph(value)} if draw else said
    data = {"text/plain": _lines(repr(value))}
    if hasattr(value, "_repr_html_"):
        data["text/html"] = _lines(value._repr_html_())
    return data


def _photograph(figure: Any) -> str:
    from playwright.sync_api import sync_playwright

    figure.update_layout(
        width=760, height=380, template="plotly_white", margin={"l": 10, "r": 10, "t": 50, "b": 40}
    )
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        page = browser.new_page(viewport={"width": 776, "height": 396})
        page.set_content(figure.to_html(include_plotlyjs=True, config={"displayModeBar": False}))
        page.wait_for_selector(".main-svg")
        picture = page.screenshot()
        browser.close()
    return base64.b64encode(picture).decode()


def _lines(text: str) -> list[str]:
    return text.rstrip("\n").splitlines(keepends=True)


def renew(name: str) -> None:
    """Execute a notebook, and keep its outputs in its file."""
    content = read(name)
    for number, (cell, outputs) in enumerate(zip(content["cells"], execute(name, draw=True), strict=True)):
        if cell["cell_type"] == "code":
            cell |= {"outputs": outputs, "execution_count": number}
    write(name, content)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--run"]:
        made = json.dumps(_run(sys.argv[2], draw="--draw" in sys.argv))
        sys.stdout.write(f"{made}\n")
    else:
        for each in sys.argv[1:] or NAMES:
            renew(each)
