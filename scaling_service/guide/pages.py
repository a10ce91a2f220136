"""The pages of the guide as text: their order, the measured figures in them, and what a search finds.

The pages on Python are made from its source, without importing what computes.
"""

from __future__ import annotations

import ast
import json
import re
from collections import abc
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.util import find_spec
from inspect import cleandoc
from itertools import pairwise
from pathlib import Path
from textwrap import dedent
from typing import Any

from markdown_it import MarkdownIt
from markdown_it.token import Token

import scaling_service
from scaling_service import plugins
from scaling_service.core.errors import InputError
from scaling_service.guide.notebooks import FOLDER, NOTEBOOK, render_notebook
from scaling_service.model.reference import read_reference

_SECTION = re.compile(r"^([A-Z][a-z]+)\n-{3,}\n", re.MULTILINE)
_ENTRY = re.compile(r"^(\S.*)\n?((?:(?: .*)?\n?(?!\S))*)", re.MULTILINE)

FIGURES = Path(__file__).with_name("figures.json")

PARTS: abc.Mapping[str, list[str]] = read_reference(Path(__file__).with_name("contents.yaml"))
"""Headings of the table of contents, and the pages under each: file names without suffix."""

_FIGURE = re.compile(r"\{\{(table )?([\w.]+)(?::([^{}]+))?\}\}")


@lru_cache(maxsize=64)
def describe_interface() -> str:
    """Describe every public name in Markdown: its signature, and what its docstring says."""
    names = scaling_service.__all__
    contents = ", ".join(f"[{name}](#{name.lower()})" for name in names)
    return "\n\n".join([contents, *(_describe(name) for name in names)])


@lru_cache(maxsize=1)
def describe_plugins() -> str:
    """Name in a table what other distributions may import, with the first sentence of each docstring."""
    rows = [
        f"| `{name}` | {_format_inline(_summarise(home, name))} |" for name, home in plugins.HOMES.items()
    ]
    return "\n".join(["| name | what |", "|---|---|", *rows])


def _summarise(module: str, name: str) -> str:
    """The first line of a definition's docstring, which for an alias stands below it."""
    for node, after in pairwise([*_parse(module).body, ast.Pass()]):
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == name:
            return (ast.get_docstring(node) or "").partition("\n")[0]
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == name:
            return str(ast.literal_eval(after.value)) if isinstance(after, ast.Expr) else ""
    raise LookupError(name)


def _describe(name: str) -> str:
    module = scaling_service.HOMES[name]
    node = _find(module, name)
    if isinstance(node, ast.FunctionDef):
        returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
        # Each as it is written, with `*` before those by keyword only
        own = node.args
        defaults = [None] * (len(own.args) - len(own.defaults)) + list(own.defaults)
        arguments = [*map(_format_argument, own.args, defaults), *(["*"] if own.kwonlyargs else [])]
        arguments += map(_format_argument, own.kwonlyargs, own.kw_defaults)
        signature = f"{name}(\n{''.join(f'    {argument},{chr(10)}' for argument in arguments)}){returns}"
        parts = [*_translate(ast.get_docstring(node))]
    else:
        # The docstring; the fields that describe themselves, inherited ones first; and what it offers
        signature = f"class {name}"
        before, mark, examples = (ast.get_docstring(node) or "").partition("\nExamples\n")
        parts = [*_translate(before)]
        if fields := "\n".join(_list_fields(module, node)):
            parts.append(f"**Fields**\n\n{fields}")
        offered = [part for part in node.body if isinstance(part, ast.FunctionDef) and part.name[0] != "_"]
        if offered:
            parts.append("**Offers**\n\n" + "\n".join(map(_describe_method, offered)))
        parts += _translate(f"Examples\n{examples}" if mark else "")
    return "\n\n".join([f"## {name}", f"```\n{signature}\n```", *parts])


def _format_argument(argument: ast.arg, default: ast.expr | None) -> str:
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


def _list_fields(module: str, node: ast.ClassDef) -> abc.Iterator[str]:
    for base in node.bases:
        if isinstance(base, ast.Name) and (home := _find_home(module, base.id)):
            yield from _list_fields(home, _find(home, base.id))  # type: ignore[arg-type]  # a class's base is a class
    for part in node.body:
        if isinstance(part, ast.AnnAssign) and isinstance(part.value, ast.Call):
            given = {keyword.arg: keyword.value for keyword in part.value.keywords}
            if "description" in given:
                default = f" = {ast.unparse(given['default'])}" if "default" in given else ""
                yield f"- `{ast.unparse(part.target)}{default}`: {_read_text(given['description'])}"


def _find_home(module: str, name: str) -> str | None:
    """The module of ours in which a class stands that another names."""
    for node in _parse(module).body:
        if isinstance(node, ast.ClassDef) and node.name == name:
            return module
        if isinstance(node, ast.ImportFrom) and name in (alias.name for alias in node.names):
            return node.module if str(node.module).startswith("scaling_service.") else None
    return None


def _read_text(node: ast.expr) -> str:
    """A string, of which parts may stand in other modules."""
    if isinstance(node, ast.JoinedStr):
        parts = (part.value if isinstance(part, ast.Constant) else "…" for part in node.values)
        return "".join(map(str, parts))
    return str(ast.literal_eval(node))


def _describe_method(method: ast.FunctionDef) -> str:
    summary = (ast.get_docstring(method) or "").partition("\n")[0]
    called = "" if any("property" in ast.unparse(d) for d in method.decorator_list) else "()"
    return f"- `{method.name}{called}`: {_format_inline(summary)}"


def _translate(docstring: str | None) -> abc.Iterator[str]:
    """A docstring of numpy's form as blocks of Markdown."""
    prose, *sections = _SECTION.split(cleandoc(docstring or ""))
    yield _format_inline(prose).strip()
    for title, body in zip(sections[::2], sections[1::2], strict=True):
        if title == "Examples":
            yield f"```pycon\n{body.strip()}\n```"
        elif title == "Notes":
            yield _format_inline(body).strip()
        else:
            entries = []
            for head, said in _ENTRY.findall(body):
                name, _, kind = head.partition(" : ")
                text = _format_inline(" ".join(dedent(said).split()))
                entries.append(f"- `{name}`{f' ({kind})' if kind else ''}: {text}")
            yield "\n".join([f"**{title}**", "", *entries])


def _format_inline(text: str) -> str:
    """Code as Markdown has it."""
    return re.sub(r":\w+:(?=`)", "", text).replace("``", "`")


class NoSuchPage(InputError):
    """The guide has no page of this name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A heading of a page and the text under it, which is what a search finds."""

    page: str
    page_title: str
    anchor: str  # empty for the page's own heading
    title: str
    text: str


def list_pages() -> tuple[str, ...]:
    """All pages, in reading order."""
    return tuple(name for part in PARTS.values() for name in part)


@lru_cache(maxsize=64)  # more than there are
def read_page(name: str) -> str:
    """Read a page as Markdown, with the measured figures in their places.

    Raises NoSuchPage.
    """
    if name not in list_pages():
        raise NoSuchPage(f"the guide has no page '{name}'", remedy=f"Choose one of {', '.join(list_pages())}")
    if name.startswith(NOTEBOOK):
        return render_notebook(name)
    text = (FOLDER / f"{name}.md").read_text(encoding="utf-8")
    text = text.replace("{{interface}}", describe_interface()).replace("{{plugins}}", describe_plugins())
    return fill(text, read_figures())


@cache
def read_figures() -> Any:
    """Measured figures by name, as ``python -m tests.guide.renew`` wrote them."""
    return json.loads(FIGURES.read_text(encoding="utf-8"))


def fill(text: str, figures: abc.Mapping[str, Any]) -> str:
    """Put figures where a page names them.

    Parameters
    ----------
    text : str
        With ``{{a.b}}``, ``{{a.b:.1f}}`` (as Python formats), or ``{{table a.b}}``.
    figures : mapping
        Nested; a table has ``columns`` and ``rows``.

    Raises
    ------
    KeyError
        There is no such figure.

    Examples
    --------
    >>> fill("{{knee.error_deg:.1f}} degrees", {"knee": {"error_deg": 3.14}})
    '3.1 degrees'
    """

    def one(found: re.Match[str]) -> str:
        value: Any = figures
        for key in found[2].split("."):
            value = value[key]
        if found[1]:
            lines = [value["columns"], ["---"] * len(value["columns"]), *value["rows"]]
            return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)
        return format(value, found[3] or "")

    return _FIGURE.sub(one, text)


def parse(name: str) -> list[Token]:
    """Read a page as tokens of Markdown, every heading with an anchor."""
    tokens = MarkdownIt("commonmark").enable("table").parse(read_page(name))
    for token, inside in pairwise(tokens):
        if token.type == "heading_open":
            token.attrSet("id", make_slug(inside.content))
    return tokens


def make_slug(title: str) -> str:
    """Turn a heading into its anchor, as GitHub does.

    Examples
    --------
    >>> make_slug("Backup, and `restore`")
    'backup-and-restore'
    """
    return re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-")


@cache
def list_sections() -> tuple[Section, ...]:
    """All sections of all pages."""
    found = []
    for name in list_pages():
        page_title, title, anchor, heading = read_title(name), "", "", False
        text: list[str] = []
        for token in (*parse(name), Token("heading_open", "h1", 1)):
            if token.type == "heading_open":
                if title:
                    said = " ".join(text)
                    found.append(
                        Section(page=name, page_title=page_title, anchor=anchor, title=title, text=said)
                    )
                heading, text = True, []
                anchor = "" if token.tag == "h1" else str(token.attrGet("id"))
            elif token.type in ("inline", "fence", "code_block"):
                if heading:
                    title, heading = token.content, False
                else:
                    parts = [child.content or " " for child in token.children or ()]
                    text.append(token.content if token.children is None else "".join(parts))
    return tuple(found)


def read_title(name: str) -> str:
    """The page's own heading."""
    if name.startswith(NOTEBOOK):
        return render_notebook(name).partition("\n")[0].removeprefix("# ")
    with (FOLDER / f"{name}.md").open(encoding="utf-8") as page:
        return page.readline().removeprefix("# ").rstrip()


def search(words: str) -> list[Section]:
    """Find the sections that hold all words, those first that have them in their headings.

    Examples
    --------
    >>> search("soft tissue")[0].page
    'missing-effect'
    """
    wanted = words.lower().split()

    def weigh(section: Section) -> tuple[int, int]:
        title, text = f"{section.title} {section.page_title}".lower(), section.text.lower()
        return sum(word in title for word in wanted), sum(text.count(word) for word in wanted)

    found = [
        s for s in list_sections() if all(w in f"{s.page_title} {s.title} {s.text}".lower() for w in wanted)
    ]
    return sorted(found, key=weigh, reverse=True) if wanted else []
