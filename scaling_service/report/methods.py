"""What all reports share: one colour and one kind of line for each method, numbers and names as text."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files

from scaling_service.report.blocks import Cell, Legend

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


_STYLES = json.loads(files("scaling_service.report").joinpath("assets", "methods.json").read_text("utf-8"))
_KNOWN = {name: Style(**style) for name, style in _STYLES["known"].items()}
_OTHERS = [Style(**style) for style in _STYLES["others"]]


def list_styles(methods: Sequence[str]) -> dict[str, Style]:
    """The style of each method; those that are not of the paper take what colours are left, in turn.

    Examples
    --------
    >>> list_styles(["MB_am"])["MB_am"].colour
    '#0072B2'
    """
    others = [name for name in methods if name not in _KNOWN]
    return {
        name: _KNOWN[name] if name in _KNOWN else _OTHERS[others.index(name) % len(_OTHERS)]
        for name in methods
    }


def list_method_columns(methods: Sequence[str]) -> list[Cell]:
    """A column header for each method, with its colour."""
    known = list_styles(methods)
    return [Cell(name, colour=known[name].colour) for name in methods]


def make_method_legend(methods: Sequence[str]) -> Legend:
    """The lines of the methods."""
    return Legend([(name, style.colour, style.dash) for name, style in list_styles(methods).items()])


def number(value: float | None, digits: int = 1) -> str:
    """A number as shown, a dash where there is none."""
    return "–" if value is None else f"{value:.{digits}f}"


def format_signed(value: float | None, digits: int = 1) -> str:
    """A difference as shown, with its sign."""
    return "–" if value is None else f"{value:+.{digits}f}"


def describe_spans(spans: Iterable[tuple[float, float]]) -> str:
    """Where along a cycle something holds.

    Examples
    --------
    >>> describe_spans([(10.0, 32.0)]), describe_spans([])
    ('10–32', 'nowhere')
    """
    return ", ".join(f"{start:.0f}–{end:.0f}" for start, end in spans) or "nowhere"


def unite_keys(mappings: Iterable[Mapping[str, object]]) -> list[str]:
    """All keys, in the order in which they first appear."""
    return list(dict.fromkeys(name for mapping in mappings for name in mapping))


def spell_name(name: str) -> str:
    """A coordinate's or a joint's name for people.

    Examples
    --------
    >>> spell_name("hip_flexion_r")
    'hip flexion, right'
    """
    stem, _, side = name.rpartition("_")
    if stem and side in ("r", "l"):
        return f"{stem.replace('_', ' ')}, {'right' if side == 'r' else 'left'}"
    return name.replace("_", " ")
