"""Names that a module offers and that are loaded when they are first used."""

from __future__ import annotations

import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

_OFFERED = re.compile(r"^from (\S+) import (?:\(\s*)?(\w+) as \2\b", re.MULTILINE)


def offer_names(
    module: str, file: str
) -> tuple[dict[str, str], Callable[[str], object], Callable[[], list[str]]]:
    """What the stub beside a module offers: name to its module, and what ``__getattr__`` and ``__dir__`` are.

    The stub (``.pyi``) imports every name under its own name, which is also what type checkers read.
    """
    stub = Path(file).with_suffix(".pyi").read_text(encoding="utf-8")
    homes = {name: home for home, name in sorted(_OFFERED.findall(stub), key=lambda found: str(found[1]))}

    def load(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module '{module}' has no attribute '{name}'")
        return getattr(import_module(homes[name]), name)

    return homes, load, lambda: sorted([*vars(import_module(module)), *homes])
