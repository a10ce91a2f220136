"""Many subject files: each into a folder of its own, then the cohort's statistics beside them."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from scaling_service.capabilities.cohort.document import CohortDocument, SubjectEntry
from scaling_service.capabilities.cohort.documents import statistics_document
from scaling_service.capabilities.cohort.executors import workers
from scaling_service.capabilities.cohort.members import Member, read_members
from scaling_service.capabilities.cohort.refused_item import RefusedItem
from scaling_service.capabilities.cohort.report.page import cohort_page
from scaling_service.capabilities.cohort.scaling_items import (
    CohortRun,
    Item,
    Outcome,
    possible_methods,
    run_cohort,
)
from scaling_service.capabilities.cohort.subject_item import RECORD, SubjectItem
from scaling_service.capabilities.cohort.tables import TABLES, table
from scaling_service.capabilities.scaling.run import check_methods
from scaling_service.capabilities.subject.reading import load_subject
from scaling_service.capabilities.subject.settings import Settings
from scaling_service.core.errors import InputError, SubjectInvalid
from scaling_service.core.threads import cores
from scaling_service.documents.writing import REPORT, all_or_nothing, check_folder, code_version, write_json
from scaling_service.model.subject import Subject
from scaling_service.recording.orientation import check_axes

DOCUMENT = "cohort.json"


class Watcher(Protocol):
    """Whoever wants to see a batch go on. Calls may come from several threads."""

    def started(self, count: int, workers: int) -> None:
        """So many subjects are about to be done by so many workers."""

    def stage(self, name: str, what: str, share: float) -> None:
        """A subject is at some stage, this share of it done."""

    def finished(self, outcome: Outcome) -> None:
        """A subject ended."""


@dataclass(frozen=True, slots=True, eq=False)
class BatchResult:
    """All that a report of a cohort needs.

    Parameters
    ----------
    document : CohortDocument
        ``cohort.json``: mm and degrees.
    run : CohortRun
        The same in SI, with every subject's own curves and figures.
    files : tuple of str
        What was written beside the subjects' folders.
    """

    document: CohortDocument
    run: CohortRun
    files: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Planned:
    member: Member
    subject: Subject | None
    error: InputError | None = None

    @property
    def id(self) -> str:
        return self.member.shown if self.subject is None else self.subject.id


def batch(
    cohort: str | Path,
    out: str | Path,
    methods: Sequence[str] | None = None,
    settings: Settings = Settings(),
    *,
    worker_count: int | None = None,
    executor: Executor | None = None,
    force: bool = False,
    watcher: Watcher | None = None,
) -> BatchResult:
    """Scale every subject of a cohort, and compare the methods over all of them.

    Parameters
    ----------
    cohort : path
        A CSV file with the column ``subject``, further columns being group labels; or a folder of subject
        files, or of folders with a ``subject.yaml`` each.
    out : path
        Each subject gets a folder of its id there, with what ``compare`` writes; ``cohort.json`` and the
        tables ``lengths.csv``, ``errors.csv`` and ``angles.csv`` stand beside, and ``report.html``.
    methods : sequence of str, optional
        All that each subject allows unless given; a subject is done by those of them that it allows.
    settings : Settings
    worker_count : int, optional
        Processes; as many as there are processor cores (no more than subjects) unless given. Results do not
        depend on it.
    executor : Executor, optional
        Where subjects are scaled, in place of these processes.
    force : bool
        Do again what is done and unchanged.
    watcher : Watcher, optional

    Returns
    -------
    BatchResult
        Subjects that failed or were skipped are in it with the reason.

    Raises
    ------
    InputError
        The cohort cannot be read, two subjects have one id, nobody can be done by any of the methods, or
        the folder belongs to something else. A single subject's fault is an outcome instead.

    Notes
    -----
    A subject whose document, files, settings, methods and program version are those of an earlier run into
    the same folder is kept. After an interruption the subjects that were done are there.
    """
    clock = time.perf_counter()
    check_methods(methods or ())
    check_axes(settings.up, settings.forward)
    source, folder = Path(cohort), Path(out)
    check_folder(folder)
    members, notes = read_members(source)
    plan = [_planned(member) for member in members]
    _refuse_ids(plan, source)
    _refuse_impossible(plan, methods, source)
    _refuse_foreign(folder, plan)
    items = [_item(planned, folder, force) for planned in plan]
    count = min(worker_count or cores(), len(items))
    if watcher is not None:
        watcher.started(len(items), count)
    listener, finished = (None, None) if watcher is None else (watcher.stage, watcher.finished)
    with _made(folder), nullcontext(executor) if executor else workers(count, listener) as chosen:
        run = run_cohort(items, chosen, methods, settings, finished=finished)
    document = _document(source, plan, run, methods, settings, notes, clock)
    return BatchResult(document, run, _write(folder, document, run))


@contextmanager
def _made(folder: Path) -> Iterator[None]:
    """The folder made before workers want to make it at the same time, and gone if nothing came into it."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        with suppress(OSError):  # something is in it: it stays
            folder.rmdir()
        raise


def _planned(member: Member) -> _Planned:
    try:
        return _Planned(member, load_subject(member.file))
    except InputError as error:
        return _Planned(member, None, error)


def _item(planned: _Planned, folder: Path, force: bool) -> Item:
    member = planned.member
    if planned.error is not None:
        return RefusedItem(planned.id, planned.error, member.groups)
    return SubjectItem(member.file, (folder / planned.id).absolute(), planned.id, member.groups, force)


def _refuse_ids(plan: Sequence[_Planned], source: Path) -> None:
    """Ids name folders, and on some disks capitals do not count."""
    seen: dict[str, _Planned] = {}
    for planned in plan:
        if planned.subject is None:
            continue
        if planned.id.casefold() in (DOCUMENT, REPORT, *TABLES):
            raise SubjectInvalid(
                f"'{planned.id}' is the name of a file of results",
                file=planned.member.file,
                field="subject.id",
                remedy="Give the subject another id",
            )
        before = seen.setdefault(planned.id.casefold(), planned)
        if before is not planned:
            raise SubjectInvalid(
                f"'{before.member.shown}' and '{planned.member.shown}' are both subject '{planned.id}'",
                file=source,
                field="subject.id",
                remedy="Results are named by it: give each subject an id of its own",
            )


def _refuse_impossible(plan: Sequence[_Planned], methods: Sequence[str] | None, source: Path) -> None:
    known = [planned.subject for planned in plan if planned.subject is not None]
    answers = [possible_methods(subject, methods) for subject in known]
    if answers and not any(possible for possible, _ in answers):
        reasons = dict.fromkeys(f"{m}: {why}" for _, left_out in answers for m, why in left_out.items())
        raise InputError(
            f"no subject can be done by {', '.join(methods or ())} ({'; '.join(reasons)})",
            file=source,
            field="--methods",
            remedy="Choose other methods, or add what is missing to the subject files",
        )


def _refuse_foreign(folder: Path, plan: Sequence[_Planned]) -> None:
    """Nothing of anybody else's is written over."""
    if not folder.is_dir():
        return
    ours = _is_ours(folder / DOCUMENT)
    for name in (DOCUMENT, REPORT, *TABLES):
        if (folder / name).exists() and not ours:
            raise _foreign(folder, f"'{name}' there was not written by a batch")
    for planned in plan:
        place = folder / planned.id
        if planned.subject is None or not place.exists():
            continue
        if not place.is_dir() or (any(place.iterdir()) and not _holds_results(place, planned.id)):
            raise _foreign(folder, f"'{planned.id}' there holds something else than that subject's results")


def _foreign(folder: Path, problem: str) -> InputError:
    return InputError(problem, file=folder, field="--out", remedy="Name another folder, or move it away")


def _is_ours(file: Path) -> bool:
    content = _content(file)
    return isinstance(content, dict) and content.get("kind") == "cohort" and "schema_version" in content


def _holds_results(folder: Path, subject: str) -> bool:
    content = _content(folder / "comparison.json")
    return (folder / RECORD).is_file() or (isinstance(content, dict) and content.get("subject") == subject)


def _content(file: Path) -> object:
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _document(
    source: Path,
    plan: Sequence[_Planned],
    run: CohortRun,
    methods: Sequence[str] | None,
    settings: Settings,
    notes: Sequence[str],
    started: float,
) -> CohortDocument:
    return CohortDocument(
        code_version=code_version(),
        cohort=str(source),
        methods_asked=None if methods is None else list(methods),
        settings=settings.resolved(),
        seed=settings.seed,
        subjects=[_entry(p, outcome) for p, outcome in zip(plan, run.outcomes, strict=True)],
        statistics=statistics_document(run.statistics),
        notes=list(notes),
        wall_s=round(time.perf_counter() - started, 3),
    )


def _entry(planned: _Planned, outcome: Outcome) -> SubjectEntry:
    summary = outcome.summary
    return SubjectEntry(
        id=planned.id,
        file=planned.member.shown,
        groups=dict(outcome.groups),
        status=outcome.status,
        reason="" if outcome.kept else outcome.reason,
        kept=outcome.kept,
        folder=None if summary is None else planned.id,
        methods=[] if summary is None else list(summary.methods),
        left_out={} if summary is None else dict(summary.left_out),
        strides={} if summary is None else dict(summary.strides),
        no_strides={} if summary is None else dict(summary.no_strides),
        wall_s=round(outcome.wall_s, 3),
    )


def _write(folder: Path, document: CohortDocument, run: CohortRun) -> tuple[str, ...]:
    """The cohort's own files, all or none; what is written of a cohort is written here."""
    with all_or_nothing(folder) as scratch:
        write_json(scratch / DOCUMENT, document)
        for name in TABLES:
            (scratch / name).write_text(table(name, run.outcomes), encoding="utf-8")
        (scratch / REPORT).write_text(cohort_page(document, run.statistics).html(), encoding="utf-8")
        return tuple(sorted(path.name for path in scratch.iterdir()))
