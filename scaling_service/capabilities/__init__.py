"""What can be asked for, one folder each; commands and kinds of jobs are found by their modules' names."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from pkgutil import iter_modules
from types import ModuleType


def import_modules_named(name: str) -> Iterator[ModuleType]:
    """The module of that name in each capability's folder that has one."""
    for folder in iter_modules(__path__, f"{__name__}."):
        if find_spec(f"{folder.name}.{name}") is not None:
            yield import_module(f"{folder.name}.{name}")
