"""OpenSim tables (STO, MOT): named columns over time, read leniently and written strictly."""

from __future__ import annotations

import dataclasses
import os
import re
from collections import abc
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from scaling_service.core import errors
from scaling_service.core.arrays import Array
from scaling_service.files import tables
from scaling_service.model.trial import Repair

_KIND = "an OpenSim table"
_TRUE, _FALSE = frozenset({"yes", "true", "y", "1"}), frozenset({"no", "false", "n", "0"})
_OWN_KEYS = frozenset({"version", "nrows", "ncolumns", "indegrees", "datatype"})
"""Header keys that the writer sets from the table itself (lower case)."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Table:
    """Columns of numbers over time, in the units of the file.

    ``in_degrees``: whether rotations are in degrees (translations never are); None where the file does not
    say, which is ambiguous: decide by context, never by default. ``header``: all keys of the header as they
    stand.
    """

    name: str
    columns: tuple[str, ...]  # the first is ``time``
    data: Array  # (n, k); NaN where a value is missing; time in s, strictly increasing
    in_degrees: bool | None = None
    header: abc.Mapping[str, str] = dataclasses.field(default_factory=lambda: MappingProxyType({}))
    repairs: tuple[Repair, ...] = ()

    def __post_init__(self) -> None:
        if self.data.ndim != 2 or self.data.shape[1] != len(self.columns):
            raise ValueError(f"data {self.data.shape} do not fit {len(self.columns)} columns")
        self.data.setflags(write=False)

    @property
    def times(self) -> Array:
        """The first column, (n,), s."""
        return self.data[:, 0]

    def column(self, name: str) -> Array:
        """One column, (n,).

        Raises TrialUnusable if there is none of that name.
        """
        if name not in self.columns:
            shown = ", ".join(self.columns[:12]) + (", …" if len(self.columns) > 12 else "")
            raise errors.TrialUnusable(
                f"there is no column '{name}'; there are {shown}",
                file=self.name,
                field=name,
                remedy="Check its name",
            )
        return self.data[:, self.columns.index(name)]


@errors.name_file
def read_sto(path: str | os.PathLike[str]) -> Table:
    """Read a STO or MOT file of any header version.

    Returns values as in the file; ``repairs`` lists what did not follow the format. Raises FileUnreadable
    if it is absent, empty, something else, has two columns of one name, no ``time``, cells that are no
    numbers or a data type other than double. Raises TrialUnusable if it has no row, or times that do not
    increase.
    """
    file = Path(path)
    text, repairs = tables.read_text(file, _KIND)
    lines = tables.number_lines(text)
    end = next((k for k, (_, line) in enumerate(lines) if line.strip().lower() == "endheader"), None)
    if end is None:
        raise errors.FileUnreadable(
            f"this is not {_KIND}: there is no line 'endheader'", remedy="Export it as STO or MOT"
        )
    header = read_header([line for _, line in lines[:end]])
    kind = look_up(header, "datatype")
    if kind is not None and kind.lower() not in ("double", "float"):
        raise errors.FileUnreadable(
            f"cells of type {kind[:20]} are not supported, only plain numbers",
            field="DataType",
            remedy="Flatten the table to DataType=double",
        )
    rows = [line for line in lines[end + 1 :] if line[1].strip()]
    columns = read_columns(rows)
    body, cut = tables.trim_cut_line(text, rows[1:], len(columns))
    data, row_repairs = tables.parse_rows(body, columns)
    if not len(data):
        raise errors.TrialUnusable("the table has a header but no row", remedy="Export it again")
    tables.check_times(data[:, 0], [number for number, _ in body])
    stated = look_up(header, "indegrees")
    word = (stated or "").strip().lower()
    degrees = word in _TRUE if word in _TRUE or word in _FALSE else None
    notes = []
    if degrees is None:
        said = "is absent" if stated is None else f"says '{stated[:20]}'"
        detail = f"{said}: whether rotations are in degrees is ambiguous"
        notes = [Repair("in_degrees", "inDegrees", detail)]
    for key, found in zip(("nRows", "nColumns"), data.shape, strict=True):
        count = look_up(header, key.lower())
        if count is not None and count != str(found):
            detail = f"the header says {count[:20]}, the file holds {found}"
            notes.append(Repair("header", key, detail))
    return Table(
        name=file.stem,
        columns=columns,
        data=data,
        in_degrees=degrees,
        header=MappingProxyType(header),
        repairs=(*repairs, *notes, *cut, *row_repairs),
    )


def read_header(lines: abc.Sequence[str]) -> dict[str, str]:
    """Keys and values; of version 1 and later (``key=value``) and of SIMM motions (``datarows 100``)."""
    header: dict[str, str] = {}
    for line in lines:
        key, sign, value = line.strip().partition("=")
        if sign:
            header[key.strip()] = value.strip()
            continue
        words = line.split()
        if len(words) == 2 and words[0].lower() in ("datarows", "datacolumns"):
            header[f"n{words[0][4:].capitalize()}"] = words[1]
    return header


def look_up(header: abc.Mapping[str, str], key: str) -> str | None:
    """A key's value, whatever its case; ``key`` is in lower case."""
    return next((value for name, value in header.items() if name.lower() == key), None)


def read_columns(rows: list[tables.Line]) -> tuple[str, ...]:
    """Names of the columns from the line after the header.

    Raises FileUnreadable: there is none, the first is not time, one has no name, or two have the same.
    """
    if not rows:
        raise errors.FileUnreadable("the file ends after its header", remedy="Export it again")
    cells = tables.split_cells(rows[0][1])
    while cells and not cells[-1]:
        cells.pop()
    if not cells or cells[0].lower() not in ("time", "t"):
        first = cells[0][:20] if cells else ""
        raise errors.FileUnreadable(
            f"the first column is '{first}', not time",
            field=f"line {rows[0][0]}",
            remedy="Put the column 'time' first, and the column names on the line after 'endheader'",
        )
    if "" in cells:
        raise errors.FileUnreadable(
            f"column {cells.index('') + 1} has no name", field=f"line {rows[0][0]}", remedy="Name it"
        )
    if len(set(cells)) < len(cells):
        again, name = next((k, name) for k, name in enumerate(cells) if name in cells[:k])
        raise errors.FileUnreadable(
            f"two columns are called '{name}': in columns {cells.index(name) + 1} and {again + 1}",
            field=name,
            remedy="Rename or delete one of them in the recording",
        )
    return ("time", *cells[1:])


def write_sto(path: str | os.PathLike[str], table: Table) -> None:
    """Write a STO or MOT file that OpenSim reads (header version 1).

    ``table``: twelve significant digits are written; NaN as ``nan``. ``inDegrees`` is written if it is
    known. OpenSim 4.6 reads ``nan`` as a TimeSeriesTable, but its older Storage stops at that row, whatever
    the spelling: give its tools motions without NaN. Raises TrialUnusable if a column name cannot stand in
    a tab-delimited file.
    """
    for name in table.columns:
        if not name or name != name.strip() or re.search(r"[\t\r\n]", name):
            raise errors.TrialUnusable(
                f"column name {name!r} cannot be written", file=table.name, field=name, remedy="Rename it"
            )
    rows, columns = table.data.shape
    lines = [re.sub(r"\s+", " ", table.name) or "table", "version=1", f"nRows={rows}", f"nColumns={columns}"]
    if table.in_degrees is not None:
        lines.append(f"inDegrees={'yes' if table.in_degrees else 'no'}")
    lines += [
        f"{key}={value}"
        for key, value in table.header.items()
        if key.lower() not in _OWN_KEYS and "\n" not in value
    ]
    lines += ["endheader", "\t".join(table.columns), ""]
    with Path(path).open("w", encoding="utf-8") as stream:
        stream.write("\n".join(lines))
        stream.writelines(tables.format_rows("\t".join(["%.12g"] * columns), table.data))


def tabulate_motion(
    name: str,
    times: ArrayLike,
    coordinates: abc.Sequence[str],
    kinds: abc.Sequence[Literal["rotation", "translation"]],
    values: ArrayLike,
) -> Table:
    """An OpenSim motion: rotations in degrees, translations in m, ``inDegrees=yes``.

    ``times``: (n,), s. ``coordinates``, ``kinds``: names, and whether each is a rotation or a translation.
    ``values``: (n, k), rad or m.
    """
    data = np.asarray(values, float)
    factors = np.array([180.0 / np.pi if kind == "rotation" else 1.0 for kind in kinds])
    return Table(
        name=name,
        columns=("time", *coordinates),
        data=np.concatenate((np.asarray(times, float)[:, None], data * factors), axis=1),
        in_degrees=True,
    )
