"""A cohort onto disk: its document, its numbers as CSV tables and its report, over nobody else's files."""

from __future__ import annotations

import json
import math
from collections import abc
from pathlib import Path

from scaling_service.capabilities.cohort import result as documents
from scaling_service.capabilities.cohort import summary as summaries
from scaling_service.capabilities.cohort.outcomes import Outcome
from scaling_service.capabilities.cohort.words import summarise
from scaling_service.core import errors
from scaling_service.core.tables import ResultTable
from scaling_service.documents import writing
from scaling_service.numerics.statistics.waveforms import NODES
from scaling_service.report.onefile import Report

DOCUMENT = "cohort.json"

Row = abc.Mapping[str, str | float | int | None]


def save_cohort(
    document: documents.CohortDocument, outcomes: abc.Sequence[Outcome], folder: Path
) -> tuple[str, ...]:
    """Write the cohort's own files, all or none, and name them."""
    with writing.all_or_nothing(folder) as scratch:
        writing.write_json(scratch / DOCUMENT, document)
        for name in list_tables():
            table = tabulate_outcomes(name, outcomes).to_frame()
            (scratch / name).write_text(table.to_csv(index=False, lineterminator="\n"), encoding="utf-8")
        Report(
            kind="batch",
            name=DOCUMENT,
            summary=summarise(document),
            document=document,
            beside=list(list_tables()),
        ).write(scratch)
        return tuple(sorted(path.name for path in scratch.iterdir()))


def _list_lengths(summary: summaries.SubjectSummary) -> abc.Iterator[Row]:
    by_method = {name: method.lengths for name, method in summary.methods.items()}
    for method, lengths in (by_method | {summaries.TRUTH: summary.true_lengths}).items():
        for segment, length in lengths.items():
            yield {"method": method, "segment": segment, "length_mm": round(1e3 * length, 4)}


def _list_errors(summary: summaries.SubjectSummary) -> abc.Iterator[Row]:
    for name, method in summary.methods.items():
        for trial, found in method.trials.items():
            values = {"mean_mm": found.mean, "rms_mm": found.rms, "max_mm": found.max}
            # A trial without any marker seen has no error: the cells stay empty.
            shown = {k: round(1e3 * v, 4) if math.isfinite(v) else None for k, v in values.items()}
            yield {"method": name, "trial": trial, "role": found.role, **shown}


def _list_angles(summary: summaries.SubjectSummary) -> abc.Iterator[Row]:
    for name, method in summary.methods.items():
        for coordinate, curve in method.curves.items():
            strides = summary.strides[coordinate.rpartition("_")[2]]
            angles = {f"deg_at_{k}_percent": round(math.degrees(value), 4) for k, value in enumerate(curve)}
            yield {"method": name, "coordinate": coordinate, "strides": strides, **angles}


def list_tables() -> abc.Mapping[
    str, tuple[tuple[str, ...], abc.Callable[[summaries.SubjectSummary], abc.Iterable[Row]]]
]:
    """File to its columns after the subject's and its groups, and to where the rows come from."""
    return {
        "lengths.csv": (("method", "segment", "length_mm"), _list_lengths),
        "errors.csv": (("method", "trial", "role", "mean_mm", "rms_mm", "max_mm"), _list_errors),
        "angles.csv": (
            ("method", "coordinate", "strides", *(f"deg_at_{k}_percent" for k in range(NODES))),
            _list_angles,
        ),
    }


def tabulate_outcomes(name: str, outcomes: abc.Sequence[Outcome]) -> ResultTable:
    """One of :func:`list_tables` over the members that are done; labels stand in columns ``group_…``."""
    columns, read = list_tables()[name]
    groups = dict.fromkeys(f"group_{group}" for outcome in outcomes for group in outcome.groups)
    rows = [
        {"subject": o.summary.subject, **{f"group_{k}": v for k, v in o.groups.items()}, **row}
        for o in outcomes
        if o.summary is not None
        for row in read(o.summary)
    ]
    names = ("subject", *groups, *columns)
    return ResultTable(name.removesuffix(".csv"), names, tuple(tuple(map(row.get, names)) for row in rows))


def check_names(members: abc.Iterable[tuple[str, str, Path]], source: str | Path) -> None:
    """Refuse ids (with how each is shown, and its file) that would name one folder or a file of results."""
    seen: dict[str, str] = {}
    for name, shown, file in members:
        key = name.casefold()  # on some disks capitals do not count
        if key in (DOCUMENT, writing.REPORT, *list_tables()):
            raise errors.SubjectInvalid(
                f"'{name}' is the name of a file of results",
                file=file,
                field="subject.id",
                remedy="Give the subject another id",
            )
        if key in seen:
            raise errors.SubjectInvalid(
                f"'{seen[key]}' and '{shown}' are both subject '{name}'",
                file=source,
                field="subject.id",
                remedy="Results are named by it: give each subject an id of its own",
            )
        seen[key] = shown


def refuse_foreign(folder: Path, names: abc.Sequence[str]) -> None:
    """Nothing of anybody else's is written over."""
    if not folder.is_dir():
        return
    document = _read_content(folder / DOCUMENT)
    ours = document.get("kind") == "cohort" and "schema_version" in document
    for name in (DOCUMENT, writing.REPORT, *list_tables()):
        if (folder / name).exists() and not ours:
            raise _refuse_foreign(folder, f"'{name}' there was not written by a batch")
    for name in names:
        place = folder / name
        if place.exists() and not (place.is_dir() and _has_results(place, name)):
            raise _refuse_foreign(folder, f"'{name}' there holds something else than that subject's results")


def _refuse_foreign(folder: Path, problem: str) -> errors.InputError:
    return errors.InputError(
        problem, file=folder, field="--out", remedy="Name another folder, or move it away"
    )


def _has_results(folder: Path, subject: str) -> bool:
    """Whether a subject's results, or nothing, are in a folder."""
    compared = _read_content(folder / "comparison.json").get("subject")
    return (folder / documents.RECORD).is_file() or compared == subject or not any(folder.iterdir())


def _read_content(file: Path) -> abc.Mapping[str, object]:
    """A JSON object; empty where there is none."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}
