"""All effects that are known, found by their files."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module

from scaling_service.capabilities.discovery import effects
from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.laws.additions import Sized
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate
from scaling_service.capabilities.discovery.search.option import Option
from scaling_service.numerics.multibody.laws import Array


@dataclass(frozen=True, slots=True)
class Effect:
    """What a file of the catalogue holds, in its own words there.

    Parameters
    ----------
    kind, meaning : str
    candidates : callable, optional
        Of an effect that is a sum of columns.
    options : callable, optional
        Of an effect whose course is not known beforehand, which needs a search of its own.
    of_forces : bool
        Whether that search looks at the forces, too, and not at the motion alone.
    details : callable, optional
        Numbers that no column holds.
    plausible : callable, optional
        Whether coefficients, each in its range, are so together.
    spreads : callable, optional
        Standard deviations of these.
    swinging : callable, optional
        A candidate at another frequency and damping.
    """

    kind: str
    meaning: str
    candidates: Callable[[Scene], Iterator[Candidate]] | None
    options: Callable[[Account, Scene, float], Iterator[Option]] | None
    of_forces: bool
    details: Callable[[Sized, Account], Mapping[str, float]] | None
    plausible: Callable[[Array], bool] | None
    spreads: Callable[[Sized, Account, float], Mapping[str, float]] | None
    swinging: Callable[[Candidate, Scene, float, float], Candidate] | None


@cache
def kinds() -> Mapping[str, Effect]:
    """Every effect by its kind."""
    modules = [
        import_module(f"{effects.__name__}.{info.name}")
        for info in pkgutil.iter_modules(effects.__path__)
        if not info.name.startswith("_")
    ]
    hooks = ("candidates", "options", "details", "plausible", "spreads", "swinging")
    return {
        m.KIND: Effect(
            kind=m.KIND,
            meaning=m.MEANING,
            of_forces=getattr(m, "OF_FORCES", False),
            **{hook: getattr(m, hook, None) for hook in hooks},
        )
        for m in modules
    }


def candidates(scene: Scene) -> Iterator[Candidate]:
    """All effects that are sums of columns, at all places where they could be in this scene."""
    for effect in kinds().values():
        if effect.candidates is not None:
            yield from effect.candidates(scene)


def options(now: Account, scene: Scene, stretch_s: float, *, of_forces: bool) -> Iterator[Option]:
    """Effects that need a search of their own, of forces or of the motion, where they are likely."""
    for effect in kinds().values():
        if effect.options is not None and effect.of_forces == of_forces:
            yield from effect.options(now, scene, stretch_s)


def details(effect: Sized, after: Account) -> Mapping[str, float]:
    """What the columns do not say, by the names of the results: axes, spans of time, frequencies."""
    told = kinds()[effect.candidate.kind].details
    return {} if told is None else told(effect, after)


def plausible(candidate: Candidate, size: Array) -> bool:
    """Whether coefficients (SI) are such as a laboratory could meet; foreign laws have but their columns."""
    known = kinds().get(candidate.kind)
    together = None if known is None else known.plausible
    each = all(c.plausible(value) for c, value in zip(candidate.columns, size.tolist(), strict=True))
    return each and (together is None or together(size))


def spreads(effect: Sized, after: Account, stretch_s: float) -> Mapping[str, float]:
    """Standard deviations of the details that have one."""
    told = kinds()[effect.candidate.kind].spreads
    return {} if told is None else told(effect, after, stretch_s)
