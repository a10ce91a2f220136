"""The 21 kinds of effects, one file each: every module here with an ``EFFECT`` is one."""

from __future__ import annotations

import importlib
import pkgutil

from tests.blind.hidden import Effect


def _found() -> dict[str, Effect]:
    names = sorted(m.name for m in pkgutil.iter_modules(__path__))
    effects = [importlib.import_module(f"{__name__}.{name}").EFFECT for name in names]
    return {effect.kind: effect for effect in effects}


EFFECTS: dict[str, Effect] = _found()
"""By kind."""
