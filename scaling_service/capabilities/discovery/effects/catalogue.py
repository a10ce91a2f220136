"""All effects that are known: those of this package's files and those of other distributions."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass, fields
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any

from scaling_service.capabilities.discovery import effects
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate
from scaling_service.capabilities.discovery.laws.scene import Scene

ENTRY_POINTS = "scaling_service.effects"
"""Group of entry points, each of a module with ``EFFECTS`` or of an object with the attributes of one."""


@dataclass(frozen=True, slots=True)
class Effect:
    """One kind of effect.

    Parameters
    ----------
    kind, meaning : str
        The name in results, and what it is in a sentence for a person.
    candidates : callable, optional
        The places where it could sit and its columns there; of an effect that is a sum of columns. How large
        its numbers are in laboratories stands in ``reference_models/effect_sizes.yaml``, or else between the
        columns' ``low`` and ``high``.
    details : callable, optional
        Numbers that no column holds, by the names of the results: axes, spans of time, frequencies.
    spreads : callable, optional
        Standard deviations of these.
    of_recording : bool
        Whether what was recorded or declared is at fault, neither person nor model: mended, so told first.
    """

    kind: str
    meaning: str
    candidates: Callable[[Scene], Iterable[Candidate]] = lambda _scene: ()
    _: KW_ONLY
    details: Callable[[Estimate, Fit], Mapping[str, float]] = lambda _effect, _after: {}
    spreads: Callable[[Estimate, Fit], Mapping[str, float]] = lambda _effect, _after: {}
    of_recording: bool = False


@cache
def find_effects() -> Mapping[str, Effect]:
    """Every effect by its kind, in the order of their names."""
    names = [info.name for info in pkgutil.iter_modules(effects.__path__) if not info.name.startswith("_")]
    sources: list[Any] = [import_module(f"{effects.__name__}.{name}") for name in names]
    sources += [point.load() for point in entry_points(group=ENTRY_POINTS)]
    found = [_require_effect(each) for source in sources for each in _list_held(source)]
    return {effect.kind: effect for effect in sorted(found, key=lambda effect: effect.kind)}


def _list_held(source: Any) -> Iterable[Any]:
    """What a module or object holds: its ``EFFECTS``, itself, or nothing."""
    held: Iterable[Any] = getattr(source, "EFFECTS", [source] if hasattr(source, "meaning") else [])
    return held


def _require_effect(source: Any) -> Effect:
    """An effect, or whatever has its attributes."""
    if isinstance(source, Effect):
        return source
    return Effect(**{f.name: getattr(source, f.name) for f in fields(Effect) if hasattr(source, f.name)})


def propose_candidates(scene: Scene, kinds: Collection[str] | None = None) -> Iterator[Candidate]:
    """All effects (or those kinds) that are sums of columns, at all places where they could be."""
    for effect in find_effects().values():
        if kinds is None or effect.kind in kinds:
            yield from effect.candidates(scene)
