"""The table of what can be asked for: what each capability's ``job`` module offers."""

from __future__ import annotations

from scaling_service.capabilities import import_modules_named
from scaling_service.capabilities.shared.job import Kind, Parts

__all__ = ["KINDS", "Kind", "Parts"]

KINDS: dict[str, Kind] = {}
for _module in import_modules_named("job"):
    KINDS.update(_module.list_kinds() if hasattr(_module, "list_kinds") else {})
