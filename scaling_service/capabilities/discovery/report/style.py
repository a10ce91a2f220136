"""Colours and numbers of the report of a search. Colours: Okabe & Ito 2008, "Color Universal Design"."""

from __future__ import annotations

from typing import Final

from scaling_service.capabilities.discovery.document import PlacedEffect, QuantityDocument

BEFORE: Final = "#E69F00"
"""The model as given."""

AFTER: Final = "#0072B2"
"""The model with what was named."""

FLOOR: Final = "#9aa5b1"
"""What noise leaves."""

CEILING: Final = "#009E73"
"""What a black box reaches."""

OTHER: Final = "#CC79A7"
"""Effects that were tried and not named."""

HEAT: Final = [[0.0, "#ffffff"], [0.25, "#fde3a7"], [0.6, "#e08214"], [1.0, "#7f2704"]]
"""From nothing to much: lightness falls all the way, so that it reads in grey, too."""

_NORMAL_95 = 1.96


def placed(effect: PlacedEffect) -> str:
    """An effect in a line: what, where, along with what, in which recording.

    Examples
    --------
    >>> placed(PlacedEffect(kind="plate_gain", where=["plate_1"]))
    'plate gain at plate_1'
    """
    following = f" with {', '.join(effect.driver)}" if effect.driver else ""
    only = f" in {', '.join(effect.trials)}" if effect.trials else ""
    said = f" ({effect.note})" if effect.note else ""
    return f"{effect.kind.replace('_', ' ')} at {', '.join(effect.where)}{following}{only}{said}"


def digits(value: float | None, figures: int = 3) -> str:
    """A number to some figures, a dash where there is none.

    Examples
    --------
    >>> digits(0.020134), digits(None), digits(1234.5)
    ('0.0201', '–', '1.23e+03')
    """
    return "–" if value is None else f"{value:.{figures}g}"


def chance(p: float | None) -> str:
    """A p-value as shown.

    Examples
    --------
    >>> chance(0.3), chance(3e-9)
    ('0.30', '< 0.001')
    """
    if p is None:
        return "–"
    return "< 0.001" if p < 1e-3 else f"{p:.2f}" if p >= 0.01 else f"{p:.3f}"


def interval(quantity: QuantityDocument) -> str:
    """95 % interval of a number; a dash where its spread is not known."""
    if quantity.sd is None or isinstance(quantity.value, tuple):
        return "–"
    half = _NORMAL_95 * quantity.sd
    return f"{digits(quantity.value - half)} to {digits(quantity.value + half)}"


def value(quantity: QuantityDocument) -> str:
    """A number, or the three of a direction."""
    if isinstance(quantity.value, tuple):
        return ", ".join(f"{v:.2f}" for v in quantity.value)
    return digits(quantity.value)
