"""Counts what makes a reader jump: private functions used once, and names that a file imports.

``python -m tests.house`` prints both; with ``--list`` it names the functions and the files, too.
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def read_modules(folder: Path = ROOT / "scaling_service") -> dict[Path, ast.Module]:
    """Every module of the package."""
    return {path: ast.parse(path.read_bytes()) for path in sorted(folder.rglob("*.py"))}


def list_functions(module: ast.Module) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    """All functions and methods."""
    return [node for node in ast.walk(module) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]


def list_used_once(module: ast.Module) -> Iterator[str]:
    """Private functions that their module names once, or only elsewhere."""
    names = (n.id if isinstance(n, ast.Name) else getattr(n, "attr", "") for n in ast.walk(module))
    uses = Counter(names)
    for function in list_functions(module):
        name = function.name
        if name.startswith("_") and not name.startswith("__") and uses[name] <= 1:
            yield name


def list_imported(module: ast.Module) -> list[str]:
    """Names that a module imports, at its top or within functions."""
    return [
        alias.name
        for node in ast.walk(module)
        if isinstance(node, ast.Import | ast.ImportFrom) and getattr(node, "module", "") != "__future__"
        for alias in node.names
    ]


def count(modules: Mapping[Path, ast.Module]) -> tuple[float, float]:
    """Share of functions that are private and used once, and the mean number of imported names."""
    functions = sum(len(list_functions(module)) for module in modules.values())
    once = sum(len(list(list_used_once(module))) for module in modules.values())
    return once / functions, sum(len(list_imported(m)) for m in modules.values()) / len(modules)


def main(arguments: list[str]) -> None:
    """Print both counts."""
    modules = read_modules()
    share, imported = count(modules)
    if "--list" in arguments:
        for path, module in modules.items():
            names = ", ".join(list_used_once(module))
            said = f"{path.relative_to(ROOT)}: {len(list_imported(module))} names imported; once: {names}"
            sys.stdout.write(f"{said}\n")
    said = f"private functions used once: {100 * share:.1f} %; names that a file imports: {imported:.1f}"
    sys.stdout.write(f"{said}\n")


if __name__ == "__main__":
    main(sys.argv[1:])
