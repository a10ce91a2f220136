"""What all reports share: lines and legends of methods, numbers and names as text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import plotly.graph_objects as go

from scaling_service.model.results import Array
from scaling_service.report.blocks import Cell, Legend
from scaling_service.report.figures import plain
from scaling_service.report.palette import styles


def method_columns(methods: Sequence[str]) -> list[Cell]:
    """A column header for each method, with its colour."""
    known = styles(methods)
    return [Cell(name, colour=known[name].colour) for name in methods]


def method_legend(methods: Sequence[str]) -> Legend:
    """The lines of the methods."""
    return Legend([(name, style.colour, style.dash) for name, style in styles(methods).items()])


def lines(x: Array, values: Mapping[str, Array], digits: int = 1) -> list[go.Scatter]:
    """One line for each method."""
    known = styles(list(values))
    return [
        go.Scatter(
            x=np.round(x, 4),
            y=np.round(y, 3).astype(np.float32),
            name=plain(name),
            mode="lines",
            line={"color": known[name].colour, "dash": known[name].dash, "width": 2},
            hovertemplate=f"%{{y:.{digits}f}}",
        )
        for name, y in values.items()
    ]


def number(value: float | None, digits: int = 1) -> str:
    """A number as shown, a dash where there is none."""
    return "–" if value is None else f"{value:.{digits}f}"


def signed(value: float | None, digits: int = 1) -> str:
    """A difference as shown, with its sign."""
    return "–" if value is None else f"{value:+.{digits}f}"


def union(mappings: Iterable[Mapping[str, object]]) -> list[str]:
    """All keys, in the order in which they first appear."""
    return list(dict.fromkeys(name for mapping in mappings for name in mapping))


def words(name: str) -> str:
    """A coordinate's or a joint's name for people.

    Examples
    --------
    >>> words("hip_flexion_r")
    'hip flexion, right'
    """
    stem, _, side = name.rpartition("_")
    if stem and side in ("r", "l"):
        return f"{stem.replace('_', ' ')}, {'right' if side == 'r' else 'left'}"
    return name.replace("_", " ")
