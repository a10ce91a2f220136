"""One colour and one kind of line for each method, safe for colour-blind readers and for grey prints.

Colours: Okabe & Ito 2008, "Color Universal Design". Lines differ in their dashes too, so that no reader
depends on colours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

INK = "#1f2933"
"""Text, and what was measured. Chosen: nearly black."""

FAINT = "#9aa5b1"
"""Grids and marks of no method. Chosen: light grey that still prints."""

BONE = "#d9c9a8"
"""Imaged bones. Chosen: as bones are drawn in atlases."""


@dataclass(frozen=True, slots=True)
class Style:
    """How a method is drawn."""

    colour: str
    dash: str


_KNOWN = {
    "MB": Style("#E69F00", "dot"),
    "MB_lam": Style("#CC79A7", "dash"),
    "MB_am": Style("#0072B2", "solid"),
    "EB": Style("#009E73", "dashdot"),
    "EB_am": Style("#D55E00", "solid"),
}
_OTHERS = (Style("#56B4E9", "dash"), Style("#000000", "dot"), Style("#F0E442", "dashdot"))


def styles(methods: Sequence[str]) -> dict[str, Style]:
    """The style of each method; those that are not of the paper take what colours are left, in turn.

    Examples
    --------
    >>> styles(["MB_am"])["MB_am"].colour
    '#0072B2'
    """
    others = [name for name in methods if name not in _KNOWN]
    return {
        name: _KNOWN[name] if name in _KNOWN else _OTHERS[others.index(name) % len(_OTHERS)]
        for name in methods
    }
