"""A developer's checks as tests, so that one command runs them all. They need the whole repository."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Container, Iterator
from graphlib import TopologicalSorter
from itertools import takewhile
from pathlib import Path

import pytest

from tests.house import ROOT, read_modules

Modules = dict[Path, ast.Module]

CHANGING = ("add", "append", "clear", "discard", "extend", "insert", "pop", "remove", "setdefault", "update")
"""Methods that change a list, a set or a mapping."""

MOST_POSITIONAL = 4
"""Fields of a dataclass that its constructor takes by their places."""

PARTICIPLES = ("resolved", "smoothed")
"""Public methods that keep their names."""

UNCOLLECTED = "import gc; gc.enable = gc.disable; from mypy.__main__ import console_entry; console_entry()"
"""The check of types holds what it makes to its end: a fifth of its time went by in looking for garbage."""

CHECKS = {
    "lint": ["ruff", "check", "--no-cache", "."],
    "format": ["ruff", "format", "--check", "--no-cache", "."],
    "types": ["python", "-c", UNCOLLECTED],
    "layers": ["lint-imports", "--no-cache"],
}


@pytest.mark.parametrize("name", CHECKS)
def test_check(name: str) -> None:
    program, *arguments = CHECKS[name]
    # The tools of this environment, not whatever the shell would find.
    command = [str(Path(sys.executable).with_name(program)), *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def modules() -> dict[Path, ast.Module]:
    """All of the package, parsed once."""
    return read_modules()


def test_functions_are_verbs(modules: Modules) -> None:
    """Of what is no verb, participles can be told by their ends: what is ``scaled`` is a value."""
    found = {
        function.name: f"{path}:{function.lineno}"
        for path, module in modules.items()
        for function in ast.walk(module)
        if isinstance(function, ast.FunctionDef) and not function.decorator_list
        if function.name.strip("_").partition("_")[0].endswith("ed")
    }
    assert {name: place for name, place in found.items() if name not in PARTICIPLES} == {}


def test_constructors_of_many_fields_take_keywords(modules: Modules) -> None:
    found = [
        f"{path}:{node.lineno}"
        for path, module in modules.items()
        for node in ast.walk(module)
        if isinstance(node, ast.ClassDef) and len(positional_fields(node)) > MOST_POSITIONAL
    ]
    assert found == []


def positional_fields(node: ast.ClassDef) -> list[str]:
    """Fields that the constructor of a dataclass takes by their places."""
    decorators = [ast.unparse(decorator) for decorator in node.decorator_list]
    if not any(text.startswith("dataclass") and "kw_only=True" not in text for text in decorators):
        return []
    fields = [ast.unparse(field) for field in node.body if isinstance(field, ast.AnnAssign)]
    placed = takewhile(lambda text: "KW_ONLY" not in text, fields)
    return [text for text in placed if "ClassVar" not in text and "init=False" not in text]


def test_no_imports_run_in_circles(modules: Modules) -> None:
    """Neither those at the top of a module, nor those within functions or for types alone."""
    named = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): module
        for path, module in modules.items()
    }
    imported = {name: set(imports(module, named)) for name, module in named.items()}
    TopologicalSorter(imported).prepare()  # raises CycleError


def imports(module: ast.Module, known: Container[str]) -> Iterator[str]:
    """The known modules that a module imports; a package where it imports what is no module in it."""
    for node in ast.walk(module):
        if isinstance(node, ast.ImportFrom):
            inside = (f"{node.module}.{alias.name}" for alias in node.names)
            named = {name if name in known else str(node.module) for name in inside}
        elif isinstance(node, ast.Import):
            named = {alias.name for alias in node.names}
        else:
            continue
        yield from (name for name in named if name in known)


def test_no_module_holds_state_that_changes(modules: Modules) -> None:
    """No ``global``, no function writes to what its module binds, and no cache grows without bound."""
    assert list(changes(ast.parse("KNOWN = {}\ndef f(): KNOWN['a'] = 1"))) == [2]
    found = [f"{path}:{line}" for path, module in modules.items() for line in changes(module)]
    assert found == []


def changes(module: ast.Module) -> Iterator[int]:
    """Lines at which a function changes what its module holds."""
    assigned = [node for node in module.body if isinstance(node, ast.Assign | ast.AnnAssign)]
    bound = {name for node in assigned for name in stored(node)}
    functions = [
        node for node in ast.walk(module) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    for function in functions:
        own = {node.arg for node in ast.walk(function) if isinstance(node, ast.arg)} | stored(function)
        decorators = {ast.unparse(decorator) for decorator in function.decorator_list}
        if function.args.args and decorators & {"cache", "lru_cache(None)", "lru_cache(maxsize=None)"}:
            yield function.lineno
        for node in ast.walk(function):
            match node:
                case ast.Global():
                    yield node.lineno
                case (
                    ast.Subscript(value=ast.Name(id=name), ctx=ast.Store() | ast.Del())
                    | ast.Attribute(value=ast.Name(id=name), ctx=ast.Store() | ast.Del())
                ) if name in bound - own:
                    yield node.lineno
                case ast.Call(func=ast.Attribute(value=ast.Name(id=name), attr=method)) if (
                    name in bound - own and method in CHANGING
                ):
                    yield node.lineno


def stored(tree: ast.AST) -> set[str]:
    """Names that are given a value."""
    names = (node for node in ast.walk(tree) if isinstance(node, ast.Name))
    return {name.id for name in names if isinstance(name.ctx, ast.Store)}
