"""The table of what can be asked for: what each capability's ``job`` module offers."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pkgutil import iter_modules

from scaling_service import capabilities
from scaling_service.capabilities.shared.job import Kind, Parts

__all__ = ["KINDS", "Kind", "Parts"]


def _kinds() -> Mapping[str, Kind]:
    found: dict[str, Kind] = {}
    for folder in iter_modules(capabilities.__path__, f"{capabilities.__name__}."):
        if any(module.name == "job" for module in iter_modules(import_module(folder.name).__path__)):
            found |= getattr(import_module(f"{folder.name}.job"), "KINDS", {})
    return found


KINDS = _kinds()
