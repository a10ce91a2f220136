"""``benchmark.json``: every task's metrics by entry, and the order of the entries."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from pydantic import Field

from scaling_service.core.tables import ResultTable
from scaling_service.documents.base import Part
from scaling_service.report import tables

DOCUMENT = "benchmark.json"


class MetricPart(Part):
    """A column of a task's table."""

    key: str
    title: str
    digits: int


class EntryPart(Part):
    """How an entry did in one task."""

    entry: str
    answered: int = Field(description="Cases that could be judged.")
    values: dict[str, float] = Field(description="Metric to its mean over the cases that could be judged.")
    place: float = Field(
        description="Mean over the task's cases of the entry's place by the first metric, 1 being best; "
        "without an answer a case counts as last."
    )
    cases: dict[str, dict[str, float]] = Field(description="Case to its metrics.")
    failures: dict[str, str] = Field(description="Case to why it could not be judged.")


class TaskPart(Part):
    """One task."""

    name: str
    title: str
    truth: str
    cases: list[str]
    metrics: list[MetricPart]
    entries: list[EntryPart]
    wall_s: float


class BenchmarkDocument(Part):
    """All tasks that were run."""

    schema_version: int = 1
    kind: Literal["benchmark"] = "benchmark"
    code_version: str
    seed: int
    tasks: list[TaskPart]
    left_out: dict[str, str] = Field(description="Task to what its data lack.")
    places: dict[str, float] = Field(description="Entry to its mean place over the tasks, best first.")
    wall_s: float


def tabulate_figures(document: BenchmarkDocument) -> dict[str, ResultTable]:
    """Every metric of every case and entry; the metric's title names the unit."""
    rows = tuple(
        (task.name, case, entry.entry, titles[key], value)
        for task in document.tasks
        for titles in [{metric.key: metric.title for metric in task.metrics}]
        for entry in task.entries
        for case, found in entry.cases.items()
        for key, value in found.items()
    )
    return {"benchmark": ResultTable("Benchmark", ("task", "case", "entry", "metric", "value"), rows)}


def make_tables(document: BenchmarkDocument) -> Iterator[tables.Table]:
    """A table for every task, and one of the whole."""
    for task in document.tasks:
        columns = [task.title, "answered", *(metric.title for metric in task.metrics), "mean place"]
        # A metric's mean, or a dash where no answer states it.
        rows = [
            tables.Row(
                entry.entry,
                [
                    f"{entry.answered}/{len(task.cases)}",
                    *(
                        (
                            f"{entry.values[metric.key]:.{metric.digits}f}"
                            if metric.key in entry.values
                            else "–"
                        )
                        for metric in task.metrics
                    ),
                    f"{entry.place:.2f}",
                ],
            )
            for entry in task.entries
        ]
        yield tables.Table(caption="", columns=columns, rows=rows, note=f"Truth: {task.truth}")
    cases = sum(len(task.cases) for task in document.tasks)
    answered = {
        name: sum(e.answered for task in document.tasks for e in task.entries if e.entry == name)
        for name in document.places
    }
    rows = [tables.Row(n, [f"{answered[n]}/{cases}", f"{place:.2f}"]) for n, place in document.places.items()]
    yield tables.Table(caption="", columns=["All tasks", "answered", "mean place"], rows=rows)


def read_document(file: Path) -> BenchmarkDocument:
    """A document that a run wrote."""
    return BenchmarkDocument.model_validate_json(file.read_bytes())
