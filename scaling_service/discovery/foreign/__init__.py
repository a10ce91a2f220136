"""Laws that recordings can follow and no entry of the catalogue has: told as unexplained, never corrected.

A lens that bends the volume, a camera that trembles: each looks somewhat like several effects at once, and
these would be named in its stead. So such laws are looked for beside the catalogue, one small file each. A
file yields what it finds, with what that explains; a new one is added by adding a file.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from types import ModuleType

from scaling_service.discovery.candidates import Contact, FreeMotion
from scaling_service.discovery.findings import Foreign
from scaling_service.discovery.fitting import Account, scene_of
from scaling_service.discovery.options import Options
from scaling_service.discovery.strictness import DiscoverySettings

CLEARLY = 1.15
"""How much more a foreign law must explain than any effect (chosen: beside one that is there it explains the
same at most, having a few numbers more)."""

NEARLY = 0.8
"""Share of what a motion or a force of any course explains that a foreign law must explain: such a course
follows every law (chosen: what is left to it is what the law's few numbers miss)."""


@cache
def _files() -> tuple[ModuleType, ...]:
    return tuple(import_module(f"{__name__}.{info.name}") for info in pkgutil.iter_modules(__path__))


def foreign(now: Account, options: Options, settings: DiscoverySettings) -> Foreign | None:
    """The law that explains most, if it does so clearly better than any effect."""
    found = _found(now, settings.stretch_s)
    sure = [law for law in found if max(law.p * options.count, law.unseen) <= settings.level]
    clear = [law for law in sure if law.expected > _rivals(law, options)]
    return max(clear, key=lambda law: law.expected, default=None)


def _found(now: Account, stretch_s: float) -> Iterator[Foreign]:
    scene = scene_of(now)
    for file in _files():
        yield from file.found(now, scene, stretch_s)


def _rivals(law: Foreign, options: Options) -> float:
    """What the effects explain, each held to its own standard."""
    most = 0.0
    for option in options.best:
        if option.candidate.of_forces == law.of_forces:
            any_course = isinstance(option.candidate.change, FreeMotion | Contact)
            most = max(most, (NEARLY if any_course else CLEARLY) * option.fitted.expected)
    return most
