"""Skin markers located in an image: a CSV file with one marker a row."""

from __future__ import annotations

import csv
import math
from pathlib import Path

from scaling_service.core.errors import FileUnreadable, name_file
from scaling_service.files.tables import read_text
from scaling_service.model import body

COLUMNS = ("marker", "segment", "x_mm", "y_mm", "z_mm")


@name_file
def read_image_markers(path: Path) -> dict[str, tuple[str, body.Vector]]:
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
            field=missing[0],
            remedy=f"The first line must be {','.join(COLUMNS)}",
        )
    found: dict[str, tuple[str, body.Vector]] = {}
    for number, row in enumerate(rows, start=2):
        name = (row["marker"] or "").strip()
        if not name or name in found:
            problem = "the marker has no name" if not name else f"marker '{name}' stands twice"
            raise FileUnreadable(problem, field=f"line {number}", remedy="Correct the table")
        at = []
        for column in COLUMNS[2:]:
            try:
                at.append(float(row[column] or "") / 1e3)
            except ValueError:
                at.append(math.nan)
            if not math.isfinite(at[-1]):
                raise FileUnreadable(
                    f"'{row[column]}' is not a number of mm",
                    field=f"line {number}, {column}",
                    remedy="Give a number",
                )
        found[name] = ((row["segment"] or "").strip(), body.to_vector(at))
    return found
