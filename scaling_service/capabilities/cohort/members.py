"""Who belongs to a cohort: the rows of a CSV file, or the subject files of a folder."""

from __future__ import annotations

import csv
import dataclasses
from collections import abc
from pathlib import Path

from scaling_service.core import errors
from scaling_service.documents import reading

COLUMN = "subject"
_SUFFIXES = (".yaml", ".yml", ".json")
_SEPARATORS = ",;\t"
"""What spreadsheets of different countries write; the one that the header's ``subject`` stands between."""


@dataclasses.dataclass(frozen=True, slots=True)
class Listed:
    """One subject of a list: its file, that file as the list writes it, and further columns as groups."""

    file: Path
    shown: str
    groups: abc.Mapping[str, str] = dataclasses.field(default_factory=dict)


def read_members(cohort: Path) -> tuple[tuple[Listed, ...], tuple[str, ...]]:
    """The members of a cohort, and what was passed over.

    ``cohort``: a CSV file with the column ``subject`` (paths relative to it), or a folder with subject files
    or with folders that each hold a ``subject.yaml``, ``.yml`` or ``.json``. InputError: there are none, one
    of them does not exist, or one is named twice.
    """
    if cohort.is_dir():
        members, passed = [], []
        for path in sorted(p for p in cohort.iterdir() if not p.name.startswith(".")):
            for file in _list_candidates(path):
                shown = file.relative_to(cohort).as_posix()
                if file.parent != cohort or _is_subject(file):
                    members.append(Listed(file, shown))
                else:
                    passed.append(f"{shown} was passed over: it is no subject file")
        if not members:
            raise errors.InputError(
                "there is no subject file in this folder",
                file=cohort,
                remedy=f"Put subject files ({', '.join(_SUFFIXES)}) there, or folders with a subject.yaml "
                "each",
            )
        return tuple(members), tuple(passed)
    if cohort.suffix.lower() in _SUFFIXES:
        raise errors.InputError(
            "a cohort is a CSV file or a folder, and this looks like a subject file",
            file=cohort,
            remedy=f"Name it in a CSV file with the column `{COLUMN}`, or give its folder",
        )
    return tuple(_in_table(cohort)), ()


def _list_candidates(path: Path) -> list[Path]:
    if path.is_file():
        return [path] if path.suffix.lower() in _SUFFIXES else []
    return [file for suffix in _SUFFIXES if (file := path / f"subject{suffix}").is_file()]


def _is_subject(file: Path) -> bool:
    """Whether a document says anything of a subject; one that cannot be read counts, to be reported."""
    try:
        content = reading.read_content(file)
    except errors.InputError:
        return True
    return isinstance(content, abc.Mapping) and (
        "trials" in content or isinstance(content.get("subject"), abc.Mapping)
    )


def _in_table(file: Path) -> abc.Iterator[Listed]:
    lines = reading.read_text(file, "a table of subjects").splitlines()
    # The header's names, and the other rows that are not blank with their line numbers
    filled = next((k for k, line in enumerate(lines) if line.strip()), None)
    if filled is None:
        raise errors.InputError(
            "it is empty", file=file, remedy=f"Write a header with `{COLUMN}`, then a row each"
        )
    for separator in _SEPARATORS:
        table = _split(lines, filled, separator, file)
        header = [name.strip() for name in table[0][1]]
        if COLUMN in header:
            break
    else:
        raise errors.InputError(
            f"there is no column `{COLUMN}`; the header is '{lines[filled].strip()}'",
            file=file,
            field="header",
            remedy=f"Name the column with the subject files `{COLUMN}`",
        )
    for name in header:
        if not name or header.count(name) > 1:
            raise errors.InputError(
                f"two columns are called '{name}'" if name else "a column has no name",
                file=file,
                field="header",
                remedy="Give every column a name of its own",
            )
    rows = [(number, cells) for number, cells in table[1:] if any(cell.strip() for cell in cells)]
    if not rows:
        raise errors.InputError("it names no subject", file=file, remedy="Write a row for each subject file")
    column = header.index(COLUMN)
    seen: dict[Path, int] = {}
    for number, cells in rows:
        place = f"line {number}"
        shown = cells[column].strip() if column < len(cells) else ""
        if len(cells) > len(header) or not shown:
            raise errors.InputError(
                "no subject file is named"
                if not shown
                else f"it has {len(cells)} cells, the header {len(header)}",
                file=file,
                field=place,
                remedy="Correct or remove the line; put texts with separators in quotes",
            )
        path = (file.parent / Path(shown).expanduser()).absolute()
        if not path.is_file():
            problem = "is a folder, not a file" if path.is_dir() else "does not exist"
            raise errors.InputError(
                f"'{shown}' {problem} (looked for {path})",
                file=file,
                field=f"{place}, {COLUMN}",
                remedy="Paths are relative to the cohort file: correct the path, or remove the line",
            )
        if (before := seen.setdefault(path.resolve(), number)) != number:
            raise errors.InputError(
                f"'{shown}' stands in line {before} already",
                file=file,
                field=place,
                remedy="Remove one of the two lines",
            )
        cells += [""] * (len(header) - len(cells))
        yield Listed(path, shown, {name: cells[k].strip() for k, name in enumerate(header) if k != column})


def _split(lines: abc.Sequence[str], first: int, separator: str, file: Path) -> list[tuple[int, list[str]]]:
    reader = csv.reader(lines[first:], delimiter=separator, skipinitialspace=True)
    try:
        return [(first + reader.line_num, cells) for cells in reader]
    except csv.Error as error:
        raise errors.FileUnreadable(
            f"it is no table: {error}", file=file, remedy="Save it as CSV in UTF-8"
        ) from None
