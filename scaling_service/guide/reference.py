"""The Python interface described from its source, without importing what computes."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from inspect import cleandoc
from pathlib import Path

import scaling_service


@cache
def describe_interface() -> str:
    """Describe every public name in Markdown: its signature, and its docstring as it stands."""
    return "\n\n".join(_describe(name) for name in scaling_service.__all__)


def _describe(name: str) -> str:
    node = _find(name)
    if isinstance(node, ast.FunctionDef):
        returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
        signature = f"{name}({ast.unparse(node.args)}){returns}"
    else:
        signature = f"class {name}"
    documented = "\n\n".join(_documented(node))
    return f"### {name}\n\n```\n{signature}\n```\n\n```\n{documented}\n```"


def _find(name: str) -> ast.FunctionDef | ast.ClassDef:
    module = f"scaling_service.{scaling_service.HOMES[name]}"
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        raise ImportError(module)
    body = ast.parse(Path(spec.origin).read_text(encoding="utf-8")).body
    return next(
        node for node in body if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == name
    )


def _documented(node: ast.FunctionDef | ast.ClassDef) -> Iterator[str]:
    """The docstring; of a class its fields and what it offers, too."""
    yield cleandoc(ast.get_docstring(node) or "")
    if isinstance(node, ast.ClassDef):
        yield from map(_describe_field, (part for part in node.body if isinstance(part, ast.AnnAssign)))
        for part in node.body:
            if isinstance(part, ast.FunctionDef) and not part.name.startswith("_"):
                summary = (ast.get_docstring(part) or "").partition("\n")[0]
                called = "" if any("property" in ast.unparse(d) for d in part.decorator_list) else "()"
                yield f"{part.name}{called}\n    {summary}"


def _describe_field(field: ast.AnnAssign) -> str:
    """A field's name, default and description, where it has them."""
    name, value = ast.unparse(field.target), field.value
    if not isinstance(value, ast.Call):
        return name if value is None else f"{name} = {ast.unparse(value)}"
    given = {keyword.arg: keyword.value for keyword in value.keywords}
    default = f" = {ast.unparse(given['default'])}" if "default" in given else ""
    said = f"\n    {ast.literal_eval(d)}" if isinstance(d := given.get("description"), ast.Constant) else ""
    return f"{name}{default}{said}"
