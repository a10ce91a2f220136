"""A cohort's numbers as CSV tables, one row for each subject, method and quantity."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType

from scaling_service.capabilities.cohort.scaling_items import Outcome
from scaling_service.capabilities.cohort.subject_summary import TRUTH, SubjectSummary
from scaling_service.numerics.statistics.cycles import NODES

Row = Sequence[str | float | int]


def _lengths(summary: SubjectSummary) -> Iterator[Row]:
    by_method = {name: method.lengths for name, method in summary.methods.items()}
    if summary.true_lengths:
        by_method[TRUTH] = summary.true_lengths
    for method, lengths in by_method.items():
        for segment, length in lengths.items():
            yield method, segment, round(1e3 * length, 4)


def _errors(summary: SubjectSummary) -> Iterator[Row]:
    for name, method in summary.methods.items():
        for trial, found in method.trials.items():
            values = (found.mean, found.rms, found.max)
            # A trial without any marker seen has no error: the cells stay empty.
            yield name, trial, found.role, *(round(1e3 * v, 4) if math.isfinite(v) else "" for v in values)


def _angles(summary: SubjectSummary) -> Iterator[Row]:
    for name, method in summary.methods.items():
        for coordinate, curve in method.curves.items():
            strides = summary.strides[coordinate.rpartition("_")[2]]
            yield name, coordinate, strides, *(round(math.degrees(value), 4) for value in curve)


TABLES: Mapping[str, tuple[tuple[str, ...], Callable[[SubjectSummary], Iterable[Row]]]] = MappingProxyType(
    {
        "lengths.csv": (("method", "segment", "length_mm"), _lengths),
        "errors.csv": (("method", "trial", "role", "mean_mm", "rms_mm", "max_mm"), _errors),
        "angles.csv": (
            ("method", "coordinate", "strides", *(f"deg_at_{k}_percent" for k in range(NODES))),
            _angles,
        ),
    }
)
"""File to its columns after the subject's and its groups, and to where the rows come from."""


def table(name: str, outcomes: Sequence[Outcome]) -> str:
    """One of :data:`TABLES` as CSV, over the subjects that are done.

    Group labels stand in columns named ``group_`` and the label's name.
    """
    columns, read = TABLES[name]
    groups = list(dict.fromkeys(group for outcome in outcomes for group in outcome.groups))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["subject", *(f"group_{group}" for group in groups), *columns])
    for outcome in outcomes:
        if outcome.summary is not None:
            person = [outcome.summary.subject, *(outcome.groups.get(group, "") for group in groups)]
            writer.writerows([*person, *row] for row in read(outcome.summary))
    return text.getvalue()
