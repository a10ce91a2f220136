"""Read every kind of file that the program writes into a document of few numbers."""

from __future__ import annotations

import csv
import io
import json
import struct
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.safety.sentences import ABOUT_TIME, clean_sentence, sort_sentences, split_page

MOST_KEPT = 32
"""A longer array becomes a summary."""

SUMMARISED = "summary"
SUMMARY = ("count", "missing", "mean", "rms", "min", "max", "order")
"""``order`` is the mean of the numbers times the cosine of their place: an exchange of two shows in it."""

_DROPPED = frozenset(("code_version", "wall_s", "slowest_subject_s", "seconds"))
_HASHES = "input_hashes"

Replaced = Mapping[str, str]


def read_folder(folder: Path, files: Sequence[Path], replaced: Replaced) -> dict[str, Any]:
    """Each file's document under its name."""
    return {path.relative_to(folder).as_posix(): read_file(path, replaced) for path in files}


def read_file(path: Path, replaced: Replaced) -> Any:
    """A file's document; one of an unknown kind is refused, so that none goes unseen."""
    return _READERS[path.suffix](path, replaced)


def summarise(numbers: np.ndarray | Sequence[float]) -> dict[str, Any]:
    """What is kept of many numbers, in the order of ``SUMMARY``; null where there are none."""
    values = np.asarray(numbers, dtype=float).ravel()
    seen = values[np.isfinite(values)]
    reported: list[float | None] = [None] * 5
    if len(seen):
        order = np.mean(seen * np.cos(np.arange(len(seen))))
        found = (seen.mean(), np.sqrt(np.mean(seen**2)), seen.min(), seen.max(), order)
        reported = [float(value) for value in found]
    return {SUMMARISED: [len(values), len(values) - len(seen), *reported]}


def reduce_document(value: Any, replaced: Replaced) -> Any:
    """A JSON value without what may vary, long arrays of numbers summarised."""
    if isinstance(value, dict):
        timed = [
            one for one in value.values() if isinstance(one, str) and ABOUT_TIME in clean_sentence(one, {})
        ]
        if timed:
            return {"claim": clean_sentence(timed[0], replaced)}
        return {
            clean_sentence(key, replaced): _unhashed(key, reduce_document(one, replaced))
            for key, one in value.items()
            if key not in _DROPPED
        }
    if isinstance(value, list):
        numbers = _numbers_of(value)
        if numbers is not None and len(numbers) > MOST_KEPT:
            return summarise(numbers)
        return [reduce_document(one, replaced) for one in value]
    return clean_sentence(value, replaced) if isinstance(value, str) else value


def _unhashed(key: str, value: Any) -> Any:
    return sorted(value) if key == _HASHES and isinstance(value, dict) else value


def _numbers_of(value: Any) -> list[float] | None:
    """All numbers of nested lists, or None if there is anything else."""
    if value is None:
        return [np.nan]
    if isinstance(value, int | float) and not isinstance(value, bool):
        return [value]
    if not isinstance(value, list):
        return None
    parts = [_numbers_of(one) for one in value]
    return None if any(part is None for part in parts) else [x for part in parts for x in part or ()]


def _read_json(path: Path, replaced: Replaced) -> Any:
    return reduce_document(json.loads(path.read_text(encoding="utf-8")), replaced)


def _read_yaml(path: Path, replaced: Replaced) -> Any:
    return reduce_document(yaml.safe_load(path.read_text(encoding="utf-8")), replaced)


def _read_page(path: Path, replaced: Replaced) -> Any:
    return sort_sentences(split_page(path.read_text(encoding="utf-8")), replaced)


def _read_sto(path: Path, replaced: Replaced) -> Any:
    head, _, body = path.read_text(encoding="utf-8").partition("endheader\n")
    return {"head": head.split()} | _columns(list(csv.reader(io.StringIO(body), delimiter="\t")))


def _read_csv(path: Path, replaced: Replaced) -> Any:
    return _columns(list(csv.reader(io.StringIO(path.read_text(encoding="utf-8")))))


def _read_trc(path: Path, replaced: Replaced) -> Any:
    rows = [line.split("\t") for line in path.read_text(encoding="utf-8").splitlines()]
    numbers = [[_number(cell) for cell in row if cell != "\t"] for row in rows[5:] if any(row)]
    labels = [cell for cell in rows[3] if cell][2:]
    table = np.array([row[: 2 + 3 * len(labels)] for row in numbers], dtype=float)
    found = {label: summarise(table[:, 2 + 3 * k : 5 + 3 * k]) for k, label in enumerate(labels)}
    return {"head": rows[2], "time": summarise(table[:, 1])} | found


def _columns(rows: list[list[str]]) -> dict[str, Any]:
    """A table's columns: summaries of numbers, and the words of the others."""
    names, *body = [row for row in rows if row]
    return {name: _column([row[k] for row in body]) for k, name in enumerate(names)}


def _column(cells: list[str]) -> Any:
    numbers = [_number(cell) for cell in cells]
    if None not in numbers:
        return summarise(np.array(numbers, dtype=float))
    return {"count": len(cells), "words": sorted(set(cells))}


def _number(cell: str) -> float | None:
    try:
        return float(cell) if cell else np.nan
    except ValueError:
        return None


def _read_osim(path: Path, replaced: Replaced) -> Any:
    """Names, numbers and words of each kind of element; ``model.json`` has the numbers singly."""
    names: dict[str, list[str]] = defaultdict(list)
    numbers: dict[str, list[float]] = defaultdict(list)
    words: dict[str, set[str]] = defaultdict(set)
    for element in ET.parse(path).iter():
        if "name" in element.attrib:
            names[element.tag].append(element.attrib["name"])
        cells = (element.text or "").split()
        found = [_number(cell) for cell in cells]
        if cells and None not in found:
            numbers[element.tag] += [x for x in found if x is not None]
        elif cells:
            words[element.tag].add(" ".join(cells))
    return {
        "names": {tag: " ".join(sorted(found)) for tag, found in sorted(names.items())},
        "numbers": {tag: summarise(found) for tag, found in sorted(numbers.items())},
        "words": {tag: " ".join(sorted(found)) for tag, found in sorted(words.items())},
    }


def _read_stl(path: Path, replaced: Replaced) -> Any:
    """A binary surface: 80 bytes, the number of triangles, and for each its normal and corners."""
    content = path.read_bytes()
    (count,) = struct.unpack_from("<I", content, 80)
    rows = np.frombuffer(content, np.uint8, 50 * count, 84).reshape(count, 50)[:, 12:48]
    corners = np.frombuffer(rows.tobytes(), "<f4").reshape(-1, 3)
    return {axis: summarise(corners[:, k]) for k, axis in enumerate("xyz")}


def _read_glb(path: Path, replaced: Replaced) -> Any:
    """The description that a binary glTF begins with; it has the range of every array."""
    content = path.read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    return reduce_document(json.loads(content[20 : 20 + length]), replaced)


def _read_floats(path: Path, replaced: Replaced) -> Any:
    return summarise(np.fromfile(path, "<f4"))


_READERS: Mapping[str, Callable[[Path, Replaced], Any]] = {
    ".json": _read_json,
    ".yaml": _read_yaml,
    ".html": _read_page,
    ".mot": _read_sto,
    ".sto": _read_sto,
    ".csv": _read_csv,
    ".trc": _read_trc,
    ".osim": _read_osim,
    ".stl": _read_stl,
    ".glb": _read_glb,
    ".f32": _read_floats,
}
