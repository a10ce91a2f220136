"""All effects that are known, found by their files."""

from __future__ import annotations

import pkgutil
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from types import ModuleType

from scaling_service.discovery import effects
from scaling_service.discovery.candidates import Candidate
from scaling_service.discovery.scene import Scene


@cache
def kinds() -> dict[str, ModuleType]:
    """Every effect's module by its kind."""
    modules = [
        import_module(f"{effects.__name__}.{info.name}")
        for info in pkgutil.iter_modules(effects.__path__)
        if not info.name.startswith("_")
    ]
    return {module.KIND: module for module in modules}


def candidates(scene: Scene) -> Iterator[Candidate]:
    """All effects at all places where they could be in this scene."""
    for module in kinds().values():
        yield from module.candidates(scene)
