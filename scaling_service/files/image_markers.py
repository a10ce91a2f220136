"""Skin markers located in an image: a CSV file with one marker a row."""

from __future__ import annotations

import csv
import math
from pathlib import Path

from scaling_service.core.errors import FileUnreadable
from scaling_service.files.tables import read_text
from scaling_service.model.body import Vector

COLUMNS = ("marker", "segment", "x_mm", "y_mm", "z_mm")


def read_image_markers(path: Path) -> dict[str, tuple[str, Vector]]:
    """Read markers with their segments, in the image's frame.

    ``path``: columns ``marker,segment,x_mm,y_mm,z_mm``, in any order; further ones are not read. Returns
    label to (segment, position in m). Raises FileUnreadable: a column is missing, a number is not one, or a
    marker stands twice.
    """
    text, _ = read_text(path, "a table of image markers")
    rows = csv.DictReader(text.splitlines(), skipinitialspace=True)
    missing = [name for name in COLUMNS if name not in (rows.fieldnames or ())]
    if missing:
        raise FileUnreadable(
            f"there is no column '{missing[0]}'",
            file=path,
            field=missing[0],
            remedy=f"The first line must be {','.join(COLUMNS)}",
        )
    found: dict[str, tuple[str, Vector]] = {}
    for number, row in enumerate(rows, start=2):
        name = (row["marker"] or "").strip()
        if not name or name in found:
            problem = "the marker has no name" if not name else f"marker '{name}' stands twice"
            raise FileUnreadable(problem, file=path, field=f"line {number}", remedy="Correct the table")
        x, y, z = (_to_metres(path, number, column, row[column]) for column in COLUMNS[2:])
        found[name] = ((row["segment"] or "").strip(), (x, y, z))
    return found


def _to_metres(path: Path, number: int, column: str, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FileUnreadable(
            f"'{text}' is not a number of mm",
            file=path,
            field=f"line {number}, {column}",
            remedy="Give a number",
        )
    return value / 1e3
