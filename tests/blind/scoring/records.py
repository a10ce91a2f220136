"""What became of each case in one line, so that runs of many hours can be kept and put together."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, get_type_hints


@dataclass(frozen=True)
class Record:
    """A case, judged.

    Parameters
    ----------
    id, group, size, movement : str
        As in the label.
    kinds : tuple of str
    forces : bool
    hidden, named : tuple of str
        Each as its kind and place.
    everywhere : bool
        Whether the (first) hidden thing is in all trials.
    verdict : str
        ``failed`` where the program did.
    matches : tuple of str
        For each hidden thing: exact, class or no.
    ratio : float, optional
        Size of the (first) hidden thing over the result's own smallest nameable size.
    closed : float, optional
        Share of the held-out gap that was closed.
    parameters : tuple of bool
        Of exactly named things: whether each is right.
    opposite : bool
        Whether a thing came out as its own negative.
    superfluous : int
        Effects named that are not hidden.
    stranger_seen : bool
        Whether nothing was named and the stranger's place stands highest.
    seconds, withheld : float, optional
    code : str
        Fingerprint of the search that found it.
    intervals : tuple of bool
        Of exactly named things: whether each stated 95 % interval holds the truth.
    floor : float, optional
        The markers' floor over what the noise put in leaves.
    stands : float, optional
        How far a stranger's places stand above what is ordinary for people there, before anything is named.
    """

    id: str
    group: str
    kinds: tuple[str, ...]
    size: str
    movement: str
    forces: bool
    hidden: tuple[str, ...]
    everywhere: bool
    verdict: str
    named: tuple[str, ...]
    matches: tuple[str, ...]
    ratio: float | None
    closed: float | None
    parameters: tuple[bool, ...]
    opposite: bool
    superfluous: int
    stranger_seen: bool
    seconds: float | None
    withheld: float | None
    code: str
    intervals: tuple[bool, ...] = ()
    floor: float | None = None
    stands: float | None = None

    @property
    def right(self) -> bool:
        """Whether everything hidden was named."""
        return bool(self.hidden) and "no" not in self.matches

    @property
    def first_name(self) -> str:
        """For the confusion matrix: the first kind named, else the verdict."""
        return self.named[0].split(" ")[0] if self.named else self.verdict


def write_records(records: Iterable[Record], file: Path) -> None:
    """Write a table of records in the order of their names."""
    with file.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, [f.name for f in fields(Record)], lineterminator="\n")
        writer.writeheader()
        for record in sorted(records, key=lambda r: r.id):
            writer.writerow({name: _text(value) for name, value in asdict(record).items()})


def read_records(file: Path) -> list[Record]:
    """Read what :func:`write_records` wrote; none where there is no such file."""
    if not file.is_file():
        return []
    hints = get_type_hints(Record)
    with file.open(encoding="utf-8", newline="") as stream:
        return [Record(**{k: _value(v, hints[k]) for k, v in row.items()}) for row in csv.DictReader(stream)]


def joined(before: Sequence[Record], after: Sequence[Record]) -> list[Record]:
    """Both; of a case that is in both, the later one."""
    return list(({r.id: r for r in before} | {r.id: r for r in after}).values())


def _text(value: object) -> str:
    if isinstance(value, tuple):
        return "; ".join(_text(each) for each in value)
    if isinstance(value, float):
        return f"{value:.4g}"
    return "" if value is None else str(value)


def _value(text: str, kind: Any) -> Any:
    if kind == tuple[str, ...]:
        return tuple(text.split("; ")) if text else ()
    if kind == tuple[bool, ...]:
        return tuple(each == "True" for each in text.split("; ")) if text else ()
    if kind is bool:
        return text == "True"
    if kind == float | None:
        return float(text) if text else None
    return kind(text)
