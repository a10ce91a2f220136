"""Effects in plain English: what an effect is, where it sits, how large it is."""

from __future__ import annotations

import math
from collections.abc import Mapping

from scaling_service.capabilities.discovery.document import QuantityDocument
from scaling_service.capabilities.discovery.effects.catalogue import known_effects
from scaling_service.core.text import few
from scaling_service.report.methods import words

_SUFFIXES = (
    ("_mm_per_deg", " mm/deg"),
    ("_deg_per_deg", " deg/deg"),
    ("_kgmm", " kg mm"),
    ("_mm", " mm"),
    ("_deg", " deg"),
    ("_Nm", " N m"),
    ("_N", " N"),
    ("_hz", " Hz"),
    ("_s", " s"),
)


def meaning(kind: str) -> str:
    """What an effect is, in a sentence without its place."""
    return known_effects()[kind].meaning


def known_kinds() -> tuple[str, ...]:
    """All kinds of effects that the search knows."""
    return tuple(known_effects())


def sentence(
    kind: str,
    where: tuple[str, ...],
    driver: tuple[str, ...],
    trials: tuple[str, ...],
    parameters: Mapping[str, QuantityDocument],
) -> str:
    """An effect for people: place, meaning, size.

    Examples
    --------
    >>> sentence("plate_gain", ("plate_1",), (), (), {"factor": QuantityDocument(value=1.02, sd=0.001)})
    'plate_1: the plate measures a multiple of the true force: factor 1.02'
    """
    place = few(where)
    following = f", here {few([words(d) for d in driver])}" if driver else ""
    only = f", in {few(trials)} only" if trials else ""
    sizes = ", ".join(shown(name, quantity) for name, quantity in parameters.items())
    return f"{place}: {meaning(kind)}{following}{only}" + (f": {sizes}" if sizes else "")


def shown(name: str, quantity: QuantityDocument, *, spread: bool = False) -> str:
    """A number of an effect with its unit, and its standard deviation where asked for.

    Examples
    --------
    >>> shown("x_mm_per_deg", QuantityDocument(value=0.2013, sd=0.011), spread=True)
    'x 0.201 ± 0.011 mm/deg'
    """
    stem, unit = split(name)
    if isinstance(quantity.value, tuple):
        return f"{stem} ({', '.join(f'{v:.2f}' for v in quantity.value)}){unit}"
    sd = quantity.sd if spread else None
    if sd is None or sd <= 0.0:
        return f"{stem} {quantity.value:.3g}{unit}".strip()
    digits = max(0, 1 - math.floor(math.log10(sd)))
    return f"{stem} {quantity.value:.{digits}f} ± {sd:.{digits}f}{unit}".strip()


def split(name: str) -> tuple[str, str]:
    """The name of a number without its unit, and the unit with a space before it; empty where it has none.

    Examples
    --------
    >>> split("delay_s")
    ('delay', ' s')
    """
    for suffix, unit in _SUFFIXES:
        if name.endswith(suffix):
            return name.removesuffix(suffix).replace("_", " "), unit
    return ("", f" {name}") if name == "kg" else (name.replace("_", " "), "")
