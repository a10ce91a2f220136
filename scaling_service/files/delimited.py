"""CSV and TSV: trajectories as motion capture systems and video pipelines write them into tables.

Each layout is told by its header and becomes one description: which column holds which axis of which marker.
Layouts are those of the vendors' manuals: Motive (CSV, from format 1.2), Vicon Nexus (CSV, "Trajectories"),
Qualisys Track Manager (TSV), DeepLabCut (CSV, three or four lines of header), and one column per axis
(``LASI_x``), as Anipose writes.
"""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scaling_service.core import errors
from scaling_service.core.arrays import Array
from scaling_service.files import tables
from scaling_service.files.recording import Recording
from scaling_service.files.trc import restore_clock
from scaling_service.model import trial
from scaling_service.model.anatomy.markers import is_computed

FIELD = "columns"
"""Field of the error which means that a table holds no markers at all."""

_EXTENTS_M = (0.3, 2.6)  # chosen: what a leg or a whole person spans; units are a factor of ten apart or more
_AXIS = re.compile(r"^(.*?)[\s_.-]+([xyz])\s*(?:[\[(]\s*([a-z]+)\s*[\])])?$", re.IGNORECASE)
_TIMES = re.compile(r"^time(stamp)?s?([\s_.(\[].*)?$", re.IGNORECASE)
_NUMBER = re.compile(r"^[+-]?[\d.]")
_KIND = "a table of markers"

Row = list[str]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Layout:
    """Where the numbers stand."""

    columns: dict[str, list[int]]  # key of a marker to the columns of its x, y and z
    labels: dict[str, str]  # key of a marker to its label
    first_row: int
    last_row: int | None = None
    time: int | None = None  # column
    per_second: float = 1.0  # what a second is in the unit of the times
    rate_hz: float = float("nan")
    unit: str = ""  # as stated


@errors.name_file
def read_delimited(path: str | os.PathLike[str]) -> Recording:
    """Read a CSV or TSV file of markers.

    Returns positions in m in the file's own axes, NaN where not seen. Raises FileUnreadable if the file is
    absent, empty, or no table of markers that is known, or a unit is not known; TrialUnusable if it has no
    frame, only results (rigid bodies, 2-D points), or neither times nor a rate.
    """
    file = Path(path)
    text, repairs = tables.read_text(file, _KIND)
    # Cells of all lines; between tabs, semicolons or commas, whichever there are most of.
    delimiter = max("\t;,", key=text.count)
    rows = [
        [cell.strip() for cell in row]
        for row in csv.reader(text.splitlines(), delimiter=delimiter, strict=False)
    ]
    if delimiter != "," and not re.search(r"\d\.\d", text):  # decimal commas
        rows = [[re.sub(r"^([+-]?\d+),(\d+)$", r"\1.\2", cell) for cell in row] for row in rows]
    # The first layout that fits counts.
    for find in (_find_motive, _find_vicon, _find_qualisys, _find_deeplabcut, _find_wide):
        layout = find(rows)
        if layout is not None:
            break
    if layout is None or not layout.columns:
        raise errors.FileUnreadable(
            "this is no table of markers",
            field=FIELD,
            remedy="Export C3D or TRC, or one column for each axis: time, LASI_x, LASI_y, LASI_z, …",
        )
    body = [
        (k + 1, row)
        for k, row in enumerate(rows[: layout.last_row])
        if k >= layout.first_row and any(cell for cell in row)
    ]
    if not body:
        raise errors.TrialUnusable("the table has a header but no frame", remedy="Export it again")
    keys = [key for key in layout.columns if not trial.is_unlabelled(layout.labels[key])]
    if not keys:
        raise errors.TrialUnusable(
            "the table holds no labelled marker", field=FIELD, remedy="Export labelled markers"
        )
    columns = [column for key in keys for column in layout.columns[key]]
    positions = _read_numbers(body, columns).reshape(len(body), -1, 3)
    labels = tuple(layout.labels[key] for key in keys)
    notes: list[trial.Repair] = []
    if dropped := len(layout.columns) - len(keys):
        detail = f"{dropped} markers without a label were left out"
        notes.append(trial.Repair("unlabelled", "columns", detail))
    metres, of_unit = _find_unit(layout.unit, positions)
    if layout.time is not None:
        times = _read_numbers(body, [layout.time])[:, 0] / layout.per_second
    elif np.isfinite(layout.rate_hz):
        times = np.arange(len(body)) / layout.rate_hz
    else:
        raise errors.TrialUnusable(
            "the table states neither times nor a frame rate",
            field="time",
            remedy="Add a column 'time' with the time of each row in seconds",
        )
    tables.check_times(times, [number for number, _ in body])
    times, positions, rate, clock = restore_clock(times, positions * metres, layout.rate_hz)
    positions, lost = tables.clean_positions(positions, labels)
    labels, twice = tables.separate_duplicates(labels, positions)
    return Recording(
        name=file.stem,
        times=times,
        labels=labels,
        markers=positions,
        rate_hz=rate,
        repairs=(*repairs, *notes, *of_unit, *clock, *lost, *twice),
        unit=layout.unit or of_unit[0].where,
    )


def _read_numbers(body: Sequence[tuple[int, Row]], columns: Sequence[int]) -> Array:
    """Cells of some columns, (n_rows, n_columns); NaN where blank."""
    values = np.full((len(body), len(columns)), np.nan)
    for k, (number, row) in enumerate(body):
        for j, column in enumerate(columns):
            cell = row[column] if column < len(row) else ""
            if cell.lower() in tables.MISSING:
                continue
            try:
                values[k, j] = float(cell)
            except ValueError:
                raise errors.FileUnreadable(
                    f"line {number} holds {cell[:20]!r} where a number is expected",
                    field=f"column {column + 1}",
                    remedy="Correct the cell, or leave it blank if the value is missing",
                ) from None
    return values


def _find_unit(unit: str, positions: Array) -> tuple[float, tuple[trial.Repair, ...]]:
    """What a unit of length is in m; where none is stated, the one in which a person has a person's size."""
    plain = unit.strip().lower()
    if plain in tables.METRES:
        return tables.METRES[plain], ()
    if plain:
        raise errors.FileUnreadable(
            f"unit '{unit[:20]}' is not known", field="unit", remedy="Export positions in mm or m"
        )
    seen = positions[np.isfinite(positions).all(-1).sum(1) >= 2]
    extent = 0.0
    if len(seen):
        extent = float(np.median((np.nanmax(seen, axis=1) - np.nanmin(seen, axis=1)).max(axis=1)))
    for name in ("mm", "cm", "m"):
        if _EXTENTS_M[0] <= extent * tables.METRES[name] <= _EXTENTS_M[1]:
            detail = f"no unit is stated; {name} was taken, in which the markers span "
            detail += f"{extent * tables.METRES[name]:.2f} m"
            return tables.METRES[name], (trial.Repair("unit", f"{name} (not stated)", detail),)
    raise errors.FileUnreadable(
        f"no unit is stated, and in none do the markers span a person (they span {extent:.3g})",
        field="unit",
        remedy="State it behind the name of a column, such as LASI_x (mm)",
    )


def _read_rate(text: str) -> float:
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        return float("nan")
    return value if 0 < value < 1e6 else float("nan")


def _collect(named: Sequence[tuple[int, str, str, str]]) -> tuple[dict[str, list[int]], dict[str, str]]:
    """Markers from (column, key, label, axis): those of which x, y and z are there, each once."""
    found: dict[str, dict[str, int]] = {}
    labels: dict[str, str] = {}
    for column, key, label, axis in named:
        found.setdefault(key, {}).setdefault(axis.lower(), column)
        labels[key] = label
    whole = {key: [axes[a] for a in "xyz"] for key, axes in found.items() if set(axes) == set("xyz")}
    return whole, labels


def _find_motive(rows: list[Row]) -> _Layout | None:
    """Motive: a line of settings, lines of Type, Name, ID (and Parent), Position or Rotation, then axes."""
    if not rows or not rows[0] or rows[0][0].lower() != "format version":
        return None
    stated = {key.lower(): value for key, value in zip(rows[0][::2], rows[0][1::2], strict=False)}
    if stated.get("coordinate space", "global").lower() != "global":
        raise errors.FileUnreadable(
            "positions are relative to an asset, not to the laboratory",
            field="Coordinate Space",
            remedy="Export in global coordinates",
        )
    at = next((k for k, row in enumerate(rows[:20]) if row and row[0].lower() == "frame"), None)
    if at is None or at < 3:
        return None
    above = [row for row in rows[1:at] if any(row)]
    kinds, names, what = above[0], above[1], above[-1]
    width = min(len(rows[at]), len(kinds), len(names), len(what))
    # The same marker can stand there as it was measured and as a skeleton expects it: only the first counts.
    named = [
        (k, f"{names[k]}|{above[2][k] if k < len(above[2]) else ''}", names[k], rows[at][k])
        for k in range(2, width)
        if kinds[k].lower() == "marker" and what[k].lower() == "position" and rows[at][k].lower() in "xyz"
    ]
    columns, labels = _collect(named)
    if not columns:
        raise errors.TrialUnusable(
            "the table holds rigid bodies or bones and no measured marker",
            field="Type",
            remedy="Export it with markers",
        )
    rate = _read_rate(stated.get("export frame rate", stated.get("capture frame rate", "")))
    return _Layout(
        columns=columns,
        labels=labels,
        first_row=at + 1,
        time=1 if len(rows[at]) > 1 and _TIMES.match(rows[at][1]) else None,
        rate_hz=rate,
        unit=stated.get("length units", ""),
    )


def _find_vicon(rows: list[Row]) -> _Layout | None:
    """Vicon Nexus: sections parted by blank lines; Trajectories, rate, names, axes, units."""
    at = next((k for k, row in enumerate(rows) if row and row[0].lower() == "trajectories"), None)
    if at is None or at + 5 > len(rows):
        return None
    names, axes, units = rows[at + 2 : at + 5]
    named, label = [], ""
    for k in range(2, len(axes)):
        label = names[k] if k < len(names) and names[k] else label
        if label and axes[k].lower() in ("x", "y", "z"):
            named.append((k, label, label, axes[k]))
    columns, labels = _collect(named)
    end = next((k for k in range(at + 5, len(rows)) if not any(rows[k])), None)
    stated = {units[k] for found in columns.values() for k in found if k < len(units)}
    return _Layout(
        columns=columns,
        labels=labels,
        first_row=at + 5,
        last_row=end,
        rate_hz=_read_rate(rows[at + 1][0] if rows[at + 1] else ""),
        unit=min(stated, default=""),
    )


def _find_qualisys(rows: list[Row]) -> _Layout | None:
    """Qualisys: lines of a key and its values, MARKER_NAMES among them; then rows, in mm."""
    keys = {row[0].upper(): (k, row[1:]) for k, row in enumerate(rows[:100]) if row and row[0]}
    if "NO_OF_FRAMES" not in keys or "MARKER_NAMES" not in keys:
        return None
    if keys.get("DATA_INCLUDED", (0, ["3D"]))[1][:1] not in ([], ["3D"]):
        raise errors.TrialUnusable(
            "the table holds 2-D data", field="DATA_INCLUDED", remedy="Export 3-D data"
        )
    at, names = keys["MARKER_NAMES"]
    names = [name for name in names if name]
    first = next((k for k in range(at + 1, len(rows)) if rows[k] and _NUMBER.match(rows[k][0])), len(rows))
    head = next((row for row in rows[at + 1 : first] if row and row[0].lower() == "frame"), [])
    width = max((len(row) - (not row[-1]) for row in rows[first : first + 1]), default=0)
    before = 2 if head else min(max(width - 3 * len(names), 0), 2)
    return _Layout(
        columns={str(k): [before + 3 * k + axis for axis in range(3)] for k in range(len(names))},
        labels={str(k): name for k, name in enumerate(names)},
        first_row=first,
        time=1 if before == 2 else None,
        rate_hz=_read_rate(next(iter(keys.get("FREQUENCY", (0, []))[1]), "")),
        unit="mm",
    )


def _find_deeplabcut(rows: list[Row]) -> _Layout | None:
    """DeepLabCut: lines that begin with scorer, individuals (where there are several), bodyparts, coords."""
    heads = {row[0].lower(): (k, row) for k, row in enumerate(rows[:6]) if row}
    if "bodyparts" not in heads or "coords" not in heads:
        return None
    parts, (at, axes) = heads["bodyparts"][1], heads["coords"]
    persons = heads.get("individuals", (0, []))[1]
    named = []
    for k in range(1, min(len(parts), len(axes))):
        label = f"{persons[k]}:{parts[k]}" if k < len(persons) and persons[k] else parts[k]
        named.append((k, label, label, axes[k]))
    columns, labels = _collect([entry for entry in named if entry[3].lower() in ("x", "y", "z")])
    if not columns:
        raise errors.TrialUnusable(
            "the table holds 2-D points of a video", field="coords", remedy="Triangulate them first"
        )
    times = [k for k, part in enumerate(parts) if k and _TIMES.match(part)]
    return _Layout(columns=columns, labels=labels, first_row=at + 1, time=times[0] if times else None)


def _find_wide(rows: list[Row]) -> _Layout | None:
    """One column per axis under names such as LASI_x, LASI X or LASI.x (mm)."""
    for at, row in enumerate(rows[:20]):
        matched = [(k, m) for k, cell in enumerate(row) if (m := _AXIS.match(cell)) and m[1]]
        columns, labels = _collect([(k, m[1], m[1], m[2]) for k, m in matched])
        # A table of results (angles, joint centres) is none of markers.
        columns = {k: found for k, found in columns.items() if not is_computed(k) and k.lower() != "center"}
        if len(columns) < 2:
            continue
        times = [k for k, cell in enumerate(row) if _TIMES.match(cell)]
        units = {m[3].lower() for k, m in matched if m[3]}
        in_ms = bool(times) and re.search(r"\bms\b|_ms$|milli", row[times[0]], re.IGNORECASE)
        return _Layout(
            columns=columns,
            labels=labels,
            first_row=at + 1,
            time=times[0] if times else None,
            per_second=1e3 if in_ms else 1.0,
            unit=" and ".join(sorted(units)),
        )
    return None
