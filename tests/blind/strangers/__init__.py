"""Effects outside the catalogue: to be called unexplained, not named after the nearest kind."""

from __future__ import annotations

import importlib
import pkgutil

from tests.blind.hidden import Effect


def _found() -> dict[str, Effect]:
    names = sorted(m.name for m in pkgutil.iter_modules(__path__))
    strangers = [importlib.import_module(f"{__name__}.{name}").EFFECT for name in names]
    return {stranger.kind: stranger for stranger in strangers}


STRANGERS: dict[str, Effect] = _found()
"""By kind."""
