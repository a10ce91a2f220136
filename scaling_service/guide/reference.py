"""The Python interface described from its source, without importing what computes."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import lru_cache
from importlib.util import find_spec
from inspect import cleandoc
from pathlib import Path
from textwrap import dedent

import scaling_service

_SECTION = re.compile(r"^([A-Z][a-z]+)\n-{3,}\n", re.MULTILINE)
_ENTRY = re.compile(r"^(\S.*)\n?((?:(?: .*)?\n?(?!\S))*)", re.MULTILINE)


@lru_cache(maxsize=64)
def describe_interface() -> str:
    """Describe every public name in Markdown: its signature, and what its docstring says."""
    names = scaling_service.__all__
    contents = ", ".join(f"[{name}](#{name.lower()})" for name in names)
    return "\n\n".join([contents, *(_describe(name) for name in names)])


def _describe(name: str) -> str:
    module = f"scaling_service.{scaling_service.HOMES[name]}"
    node = _find(module, name)
    if isinstance(node, ast.FunctionDef):
        returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
        arguments = [*_arguments(node.args)]
        signature = f"{name}(\n{''.join(f'    {argument},{chr(10)}' for argument in arguments)}){returns}"
        parts = _translate(ast.get_docstring(node))
    else:
        signature, parts = f"class {name}", _describe_class(module, node)
    return "\n\n".join([f"## {name}", f"```\n{signature}\n```", *parts])


def _arguments(arguments: ast.arguments) -> Iterator[str]:
    """Each as it is written, with ``*`` before those by keyword only."""
    defaults = [None] * (len(arguments.args) - len(arguments.defaults)) + list(arguments.defaults)
    yield from map(_argument, arguments.args, defaults)
    if arguments.kwonlyargs:
        yield "*"
    yield from map(_argument, arguments.kwonlyargs, arguments.kw_defaults)


def _argument(argument: ast.arg, default: ast.expr | None) -> str:
    return ast.unparse(argument) + (f" = {ast.unparse(default)}" if default else "")


def _find(module: str, name: str) -> ast.FunctionDef | ast.ClassDef:
    return next(
        node
        for node in _parse(module).body
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == name
    )


@lru_cache(maxsize=64)
def _parse(module: str) -> ast.Module:
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        raise ImportError(module)
    return ast.parse(Path(spec.origin).read_text(encoding="utf-8"))


def _describe_class(module: str, node: ast.ClassDef) -> Iterator[str]:
    """The docstring; the fields that describe themselves, inherited ones first; and what it offers."""
    docstring = ast.get_docstring(node) or ""
    before, mark, examples = docstring.partition("\nExamples\n")
    yield from _translate(before)
    if fields := "\n".join(_fields(module, node)):
        yield f"**Fields**\n\n{fields}"
    offered = [part for part in node.body if isinstance(part, ast.FunctionDef) and part.name[0] != "_"]
    if offered:
        yield "**Offers**\n\n" + "\n".join(map(_describe_method, offered))
    yield from _translate(f"Examples\n{examples}" if mark else "")


def _fields(module: str, node: ast.ClassDef) -> Iterator[str]:
    for base in node.bases:
        if isinstance(base, ast.Name) and (home := _home_of(module, base.id)):
            yield from _fields(home, _find(home, base.id))  # type: ignore[arg-type]  # a class's base is a class
    for part in node.body:
        if isinstance(part, ast.AnnAssign) and isinstance(part.value, ast.Call):
            given = {keyword.arg: keyword.value for keyword in part.value.keywords}
            if "description" in given:
                default = f" = {ast.unparse(given['default'])}" if "default" in given else ""
                yield f"- `{ast.unparse(part.target)}{default}`: {_text(given['description'])}"


def _home_of(module: str, name: str) -> str | None:
    """The module of ours in which a class stands that another names."""
    for node in _parse(module).body:
        if isinstance(node, ast.ClassDef) and node.name == name:
            return module
        if isinstance(node, ast.ImportFrom) and name in (alias.name for alias in node.names):
            return node.module if str(node.module).startswith("scaling_service.") else None
    return None


def _text(node: ast.expr) -> str:
    """A string, of which parts may stand in other modules."""
    if isinstance(node, ast.JoinedStr):
        parts = (part.value if isinstance(part, ast.Constant) else "…" for part in node.values)
        return "".join(map(str, parts))
    return str(ast.literal_eval(node))


def _describe_method(method: ast.FunctionDef) -> str:
    summary = (ast.get_docstring(method) or "").partition("\n")[0]
    called = "" if any("property" in ast.unparse(d) for d in method.decorator_list) else "()"
    return f"- `{method.name}{called}`: {_inline(summary)}"


def _translate(docstring: str | None) -> Iterator[str]:
    """A docstring of numpy's form as blocks of Markdown."""
    prose, *sections = _SECTION.split(cleandoc(docstring or ""))
    yield _inline(prose).strip()
    for title, body in zip(sections[::2], sections[1::2], strict=True):
        if title == "Examples":
            yield f"```pycon\n{body.strip()}\n```"
        elif title == "Notes":
            yield _inline(body).strip()
        else:
            entries = "\n".join(_entry(*found) for found in _ENTRY.findall(body))
            yield f"**{title}**\n\n{entries}"


def _entry(head: str, body: str) -> str:
    name, _, kind = head.partition(" : ")
    said = " ".join(dedent(body).split())
    return f"- `{name}`{f' ({kind})' if kind else ''}: {_inline(said)}"


def _inline(text: str) -> str:
    """Code as Markdown has it."""
    return re.sub(r":\w+:(?=`)", "", text).replace("``", "`")
