"""Put the members of a batch together: what ``batch`` does on the command line when all subjects ended."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Executor, Future
from contextlib import chdir
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter

from scaling_service.capabilities.cohort.members import COLUMN
from scaling_service.capabilities.cohort.request import BatchRequest, MemberResult
from scaling_service.capabilities.cohort.run import DOCUMENT as DOCUMENT_OF_COHORT
from scaling_service.capabilities.cohort.run import batch
from scaling_service.capabilities.cohort.scaling_items import Item, Outcome
from scaling_service.capabilities.cohort.subject_item import RECORD, Record
from scaling_service.capabilities.scaling.request import named_files
from scaling_service.core.progress import Progress
from scaling_service.core.serial import Serial
from scaling_service.documents.jobs import Failure, State
from scaling_service.documents.names import DOCUMENT, PARTS
from scaling_service.documents.reading import read_document

T = TypeVar("T")

_COHORT = "cohort.csv"
_RECORDS = TypeAdapter(Record)


def work(request: BatchRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write ``cohort.json``, its tables and the report; the document is the result.

    Every subject was scaled by a job of its own, which wrote the subject's folder.

    Raises
    ------
    InputError
        Nobody can be done by any of the methods.
    """
    progress("comparing the methods over all subjects", 0.0)
    outcomes = ended(inputs)
    members = write_members(request, inputs)
    with chdir(inputs):  # the document names the table as it is named here, not where this machine has it
        done = batch(
            members.name, outputs.absolute(), request.methods, request.settings, executor=Known(outcomes)
        )
    for name in done.files:
        _forget_place(outputs / name, inputs)
    return json.loads((outputs / DOCUMENT_OF_COHORT).read_text(encoding="utf-8"))


def ended(inputs: Path) -> dict[str, Outcome]:
    """Subject to how it ended."""
    told = json.loads((inputs / PARTS).read_text(encoding="utf-8"))
    return {end["request"]["subject"]: _outcome(end, inputs) for end in told}


def _outcome(end: Mapping[str, Any], inputs: Path) -> Outcome:
    name = end["request"]["subject"]
    if end["state"] != State.DONE:
        return Outcome(name, {}, "failed", str(Failure.model_validate(end["failure"])))
    result = MemberResult.model_validate(end["result"])
    summary = None
    if result.status == "done":
        content = json.loads((inputs / name / RECORD).read_text(encoding="utf-8"))
        summary = _RECORDS.validate_python(content).summary
    return Outcome(name, {}, result.status, result.reason, summary, wall_s=result.wall_s)


class Known(Executor):
    """Gives what became of each subject, in place of scaling it.

    Parameters
    ----------
    outcomes : mapping
        Subject to how it ended. What concerns others is done here.
    """

    def __init__(self, outcomes: Mapping[str, Outcome]) -> None:
        self._outcomes = outcomes

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Look it up."""
        item: Item = args[0]
        known = self._outcomes.get(item.name)
        if known is None:
            return Serial().submit(fn, *args, **kwargs)
        future: Future[Any] = Future()
        future.set_result(replace(known, groups=item.groups))
        return future


def _forget_place(file: Path, folder: Path) -> None:
    """Name what lies in a folder without it: where this machine has it means nothing to a client."""
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace(f"{folder.absolute()}/", ""), encoding="utf-8")


def write_members(request: BatchRequest, folder: Path) -> Path:
    """The cohort's table as the command line reads it, beside the subjects' folders.

    The files that their documents name are there by name only: whoever scaled the subjects read them.
    """
    columns = sorted({label for labels in request.groups.values() for label in labels})
    rows: Iterable[list[str]] = (
        [f"{name}/{DOCUMENT}", *(request.groups.get(name, {}).get(column, "") for column in columns)]
        for name in request.subjects
    )
    for name in request.subjects:
        for named in named_files(read_document(folder / name / DOCUMENT)).values():
            (folder / name / named).touch()
    file = folder / _COHORT
    with file.open("w", encoding="utf-8", newline="") as stream:
        csv.writer(stream).writerows([[COLUMN, *columns], *rows])
    return file
