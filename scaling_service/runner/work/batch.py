"""Scale many subjects: what ``batch`` does on the command line."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable
from contextlib import chdir
from pathlib import Path
from typing import Any

from scaling_service.jobs.batch import DOCUMENT as DOCUMENT_OF_COHORT
from scaling_service.jobs.batch import batch
from scaling_service.jobs.cohort_members import COLUMN
from scaling_service.jobs.cohort_run import Outcome
from scaling_service.jobs.tasks import Progress
from scaling_service.runner.cohort_request import BatchRequest
from scaling_service.runner.names import DOCUMENT

_COHORT = "cohort.csv"


def work(request: BatchRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write a folder for each subject, ``cohort.json`` and its tables; the document is the result.

    Subjects are done one after another: several jobs run at the same time already, and the bounds of a job
    are those of its processes.

    Raises
    ------
    InputError
        Nobody can be done by any of the methods.
    """
    members = write_members(request, inputs)
    with chdir(inputs):  # the document names the table as it is named here, not where this machine has it
        done = batch(
            members.name,
            outputs.absolute(),
            request.methods,
            request.settings,
            worker_count=1,
            watcher=_Watcher(len(request.subjects), progress),
        )
    for name in done.files:
        _forget_place(outputs / name, inputs)
    return json.loads((outputs / DOCUMENT_OF_COHORT).read_text(encoding="utf-8"))


def _forget_place(file: Path, folder: Path) -> None:
    """Name what lies in a folder without it: where this machine has it means nothing to a client."""
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace(f"{folder.absolute()}/", ""), encoding="utf-8")


def write_members(request: BatchRequest, folder: Path) -> Path:
    """The cohort's table as the command line reads it, beside the subjects' folders."""
    columns = sorted({label for labels in request.groups.values() for label in labels})
    rows: Iterable[list[str]] = (
        [f"{name}/{DOCUMENT}", *(request.groups.get(name, {}).get(column, "") for column in columns)]
        for name in request.subjects
    )
    file = folder / _COHORT
    with file.open("w", encoding="utf-8", newline="") as stream:
        csv.writer(stream).writerows([[COLUMN, *columns], *rows])
    return file


class _Watcher:
    """Passes on how far the whole is."""

    def __init__(self, count: int, progress: Progress) -> None:
        self._count, self._progress, self._ended = count, progress, 0

    def started(self, count: int, _workers: int) -> None:
        self._progress(f"{count} subjects", 0.0)

    def stage(self, _name: str, what: str, share: float) -> None:
        self._progress(f"{self._ended + 1} of {self._count}: {what}", (self._ended + share) / self._count)

    def finished(self, _outcome: Outcome) -> None:
        self._ended += 1
        self._progress(f"{self._ended} of {self._count} ended", self._ended / self._count)
