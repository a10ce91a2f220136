"""What the readers of recordings share: text to rows of numbers, and positions that cannot be positions."""

from __future__ import annotations

from collections import Counter, abc
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scaling_service.core import errors
from scaling_service.core.arrays import Array
from scaling_service.model import trial

METRES = {
    spelling: metres
    for metres, spellings in {
        1e-3: "mm mms millimeter millimeters millimetre millimetres mill",
        1e-2: "cm cms centimeter centimeters centimetre centimetres cent",
        1.0: "m meter meters metre metres mete metr",
    }.items()
    for spelling in spellings.split()
}
"""Unit of length, lower case, in m; writers with a field of four letters cut the words."""

MISSING = frozenset(("", "-", "--", "na", "n/a", "nan", "nan(ind)", "-nan(ind)", "-nan", "null", "none"))
MISSING |= {"-1.#ind", "1.#qnan", "-1.#qnan"}
"""Spellings of "not seen" (lower case): blanks, C and Windows run-times, spreadsheets, databases."""

FARTHEST_M = 1e6
"""A coordinate beyond this is no position (chosen: a laboratory in mm read as m stays far below)."""

LONGEST_S = 1e7  # a time beyond this is no time of a recording (chosen: four months)
_TOGETHER = 100  # rows; measured: fewer or many more take longer

Flags = NDArray[np.bool_]

Line = tuple[int, str]  # line number in the file, from 1, and its text

_REPAIRS = {
    "blank": ("blank_cells", "blank cells were taken as missing"),
    "short": ("short_rows", "rows shorter than the header: the cells at their end were taken as missing"),
    "unplaced": (
        "short_rows",
        "rows with too few numbers and no tabs: which value is missing is unknown, so all were dropped",
    ),
    "extra": ("extra_cells", "cells beyond the last column were dropped"),
    "comma": ("decimal_comma", "decimal commas were read as points"),
    "infinite": ("infinite_values", "infinite values were taken as missing"),
}
"""What a row can need, to the kind of repair and what is said of it."""


@errors.name_file
def read_bytes(path: Path, kind: str) -> bytes:
    """The content of a file that must exist and hold something.

    ``kind``: what it should be, for the message: ``"a TRC file"``. Raises FileUnreadable.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise errors.FileUnreadable("there is no such file", remedy="Check its name and folder") from None
    except IsADirectoryError:
        raise errors.FileUnreadable(f"this is a folder, not {kind}", remedy="Name a file") from None
    except OSError as error:
        reason = (error.strerror or "unknown reason").lower()
        raise errors.FileUnreadable(f"cannot be read: {reason}", remedy="Check its permissions") from None
    if not content.strip():
        raise errors.FileUnreadable("the file is empty", remedy="Export or copy it again")
    return content


@errors.name_file
def read_text(path: Path, kind: str) -> tuple[str, tuple[trial.Repair, ...]]:
    """The text of a file, as UTF-8 or, where it is not, Latin-1.

    Returns ``text``: without byte order mark, lines ended by a line feed. Raises FileUnreadable if it is
    absent, empty or not text.
    """
    content = read_bytes(path, kind)
    repairs: tuple[trial.Repair, ...] = ()
    if content[:1] < b"\x80" and content[1:2] == b"\x50" and b"\x00" in content[:512]:
        raise errors.FileUnreadable(f"this is a C3D file, not {kind}", remedy="Name it .c3d")
    if b"\x00" in content:
        raise errors.FileUnreadable(f"this is binary, not {kind}", remedy="Export it again as plain text")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
        repairs = (trial.Repair("encoding", "file", "bytes that are not UTF-8 were read as Latin-1"),)
    return text.replace("\r\n", "\n").replace("\r", "\n"), repairs


def number_lines(text: str) -> list[Line]:
    """All lines with their numbers from 1."""
    return list(enumerate(text.split("\n"), start=1))


def split_cells(line: str) -> list[str]:
    """The cells of a line: between tabs, or between blanks where it has no tab."""
    return [cell.strip() for cell in line.split("\t")] if "\t" in line else line.split()


def parse_rows(
    lines: abc.Sequence[Line], columns: abc.Sequence[str]
) -> tuple[Array, tuple[trial.Repair, ...]]:
    """Rows of numbers under named columns.

    ``lines`` sequence of (number, text): blank ones are skipped. ``columns``: their names, for messages.
    Returns ``data`` (n_rows, n_columns): NaN where a cell is blank or says that it is missing. Raises
    FileUnreadable if a cell holds something that is neither a number nor a sign of absence.

    A tab-delimited row that ends early lacks its last cells. In a row delimited by blanks an absent cell
    leaves no trace, so which number belongs to which column is unknown: all but the first two are dropped.
    """
    wanted = len(columns)
    texts = [text for _, text in lines]
    if texts and all(text.count("\t") == wanted - 1 for text in texts):
        with suppress(ValueError):  # rows that are all whole, at once
            data = np.loadtxt(texts, delimiter="\t", comments=None, ndmin=2)
            if data.shape == (len(texts), wanted) and not np.isinf(data).any():
                return data, ()
    tally: Counter[str] = Counter()
    rows = [_parse_row(number, text, columns, tally) for number, text in lines if text.strip()]
    data = np.array(rows, dtype=float).reshape(len(rows), wanted)
    infinite = np.isinf(data)
    tally["infinite"] = int(infinite.any(axis=1).sum())
    data[infinite] = np.nan
    return data, tuple(
        trial.Repair(kind, "rows", detail, frames=tally[need])
        for need, (kind, detail) in _REPAIRS.items()
        if tally[need]
    )


def _parse_row(number: int, text: str, columns: abc.Sequence[str], tally: Counter[str]) -> list[float]:
    wanted = len(columns)
    if "_" not in text:  # float() would read 1_000 as a number
        try:
            values = [float(cell) for cell in (text.split("\t") if "\t" in text else text.split())]
        except ValueError:
            values = []
        if len(values) == wanted:
            return values
    cells = split_cells(text)
    tabbed = "\t" in text
    if tabbed and any(" " in cell for cell in cells):
        cells, tabbed = text.split(), False
    while len(cells) > wanted and not cells[-1]:
        cells.pop()
    if len(cells) > wanted:
        tally["extra"] += 1
        cells = cells[:wanted]
    values = [_number(cell, tally, number, column) for cell, column in zip(cells, columns, strict=False)]
    if any(not cell for cell in cells):
        tally["blank"] += 1
    if len(values) < wanted and tabbed:
        tally["short"] += 1
    elif len(values) < wanted:
        tally["unplaced"] += 1
        values = values[:2]
    return values + [np.nan] * (wanted - len(values))


def _number(cell: str, tally: Counter[str], line: int, column: str) -> float:
    if cell.lower() in MISSING:
        return float("nan")
    if "_" not in cell:
        try:
            return float(cell)
        except ValueError:
            pass
        try:
            value = float(cell.replace(",", ".", 1))
        except ValueError:
            pass
        else:
            tally["comma"] += 1
            return value
    raise errors.FileUnreadable(
        f"line {line} holds {cell[:20]!r} where a number is expected",
        field=column,
        remedy="Correct the cell, or leave it blank if the value is missing",
    )


def format_rows(form: str, data: Array) -> abc.Iterator[str]:
    """Rows as text, many at a time.

    ``form``: of one row, for the ``%`` operator. ``data``: (n_rows, n_columns).
    """
    for start in range(0, len(data), _TOGETHER):
        part = data[start : start + _TOGETHER]
        yield (f"{form}\n" * len(part)) % tuple(part.ravel().tolist())


def trim_cut_line(text: str, lines: list[Line], wanted: int) -> tuple[list[Line], tuple[trial.Repair, ...]]:
    """Rows without the number, or the row, in which the file breaks off.

    A last line that has no line feed and too few cells was cut while it was written. Its last number may be
    cut too, so it is not used; nor is the row if that number is its time.
    """
    if text.endswith("\n") or not lines or len(split_cells(lines[-1][1])) >= wanted:
        return lines, ()
    number, last = lines[-1]
    kept, _, _ = last.rpartition("\t")
    if len(split_cells(kept)) < 2 or "\t" not in kept:
        return lines[:-1], (
            trial.Repair(
                "cut_row", f"line {number}", "the file breaks off here; the row was dropped", frames=1
            ),
        )
    detail = "the file breaks off here; the last number was not used"
    return [*lines[:-1], (number, kept)], (trial.Repair("cut_row", f"line {number}", detail, frames=1),)


def separate_duplicates(
    labels: abc.Sequence[str], markers: Array, descriptions: abc.Sequence[str] = ()
) -> tuple[tuple[str, ...], tuple[trial.Repair, ...]]:
    """Labels of which each stands once, and what was decided.

    ``markers`` (n_frames, n_markers, 3): NaN where not seen. Of two points of one name the first that is ever
    seen keeps it, the others get a number: ``RASI#2``. Where most labels stand twice there are two persons:
    the second one's get a prefix, ``#2:RASI``.
    """
    seen = np.atleast_1d(np.isfinite(markers).all(-1).any(0))
    places: dict[str, list[int]] = {}
    for k in sorted(range(len(labels)), key=lambda k: not seen[k]):
        places.setdefault(labels[k], []).append(k)
    twice = {label: found for label, found in places.items() if len(found) > 1}
    persons = len(twice) > 2 and 2 * len(twice) > len(places)
    names, repairs = list(labels), []
    for label, (_, *others) in twice.items():
        for n, k in enumerate(others, start=2):
            names[k] = f"#{n}:{label}" if persons else f"{label}#{n}"
        about = {names[k]: descriptions[k] for k in others if k < len(descriptions) and descriptions[k]}
        shown = "".join(f"; {name} is described as '{said}'" for name, said in about.items())
        detail = (
            f"{len(others) + 1} points have this name; called {', '.join(names[k] for k in others)} from "
        )
        detail += f"the second on{shown}"
        repairs.append(trial.Repair("duplicate", label, detail))
    return tuple(names), tuple(repairs)


def check_times(times: Array, lines: abc.Sequence[int] | None = None) -> None:
    """Raise unless times are known and increase from row to row.

    ``times``: (n_rows,), s. ``lines``: line number of each row, for the message. Raises TrialUnusable.
    """
    bad = ~np.isfinite(times) | (np.abs(times) > LONGEST_S)
    if bad.any():
        row = int(np.argmax(bad))
        problem = "has no usable time"
    else:
        bad = np.diff(times) <= 0
        if not bad.any():
            return
        row = int(np.argmax(bad)) + 1
        problem = f"has time {times[row]:g} s, not later than {times[row - 1]:g} s before it"
    place = f"line {lines[row]}" if lines is not None else f"row {row + 1}"
    raise errors.TrialUnusable(
        f"{place} {problem}", field="time", remedy="Times must increase from row to row; export it again"
    )


def clean_positions(markers: Array, labels: abc.Sequence[str]) -> tuple[Array, tuple[trial.Repair, ...]]:
    """Mark as missing what cannot be a position.

    ``markers``: (n_frames, n_markers, 3), m. Returns ``markers`` (n_frames, n_markers, 3), m: all three
    coordinates NaN where one is missing, where all are exactly zero (how several systems write a lost
    marker) or where one is impossibly large.
    """
    known = np.isfinite(markers)
    zero: Flags = np.all(np.equal(markers, 0.0), axis=-1)
    whole: Flags = np.all(known, axis=-1)
    partial: Flags = np.any(known, axis=-1) & ~whole
    far: Flags = np.any(np.abs(np.where(known, markers, 0.0)) > FARTHEST_M, axis=-1) & ~partial
    missing = "a coordinate is missing, so the marker was taken as not seen"
    repairs = (
        *trial.repair_each(zero, labels, "lost_marker", "exactly (0, 0, 0) was taken as not seen"),
        *trial.repair_each(partial, labels, "partial_position", missing),
        *trial.repair_each(
            far, labels, "impossible_position", "farther than 1000 km away, taken as not seen"
        ),
    )
    unusable = zero | far | ~whole
    return np.where(unusable[..., None], np.nan, markers), repairs
