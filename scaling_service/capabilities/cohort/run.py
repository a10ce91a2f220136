"""Many subjects: each scaled on its own, then the methods compared over all of them."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from scaling_service.capabilities.cohort.document import CohortDocument, SubjectEntry
from scaling_service.capabilities.cohort.executors import workers
from scaling_service.capabilities.cohort.members import Listed, read_members
from scaling_service.capabilities.cohort.outcomes import Outcome, run_members, select_possible_methods
from scaling_service.capabilities.cohort.saving import check_names, refuse_foreign, save_cohort
from scaling_service.capabilities.cohort.statistics import compute_cohort_statistics
from scaling_service.capabilities.cohort.subject import SubjectMember
from scaling_service.capabilities.cohort.verdict import write_headline, write_reasons
from scaling_service.capabilities.scaling.methods.table import METHODS, check_methods
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.reading import load_subject
from scaling_service.core.errors import InputError
from scaling_service.core.tables import ResultTable
from scaling_service.core.threads import count_cores
from scaling_service.documents.writing import check_folder, code_version
from scaling_service.model.subject import Subject
from scaling_service.recording.orientation import check_axes


class Watcher(Protocol):
    """Whoever wants to see a batch go on. Calls may come from several threads."""

    def start(self, count: int, workers: int) -> None:
        """So many subjects are about to be done by so many workers."""

    def stage(self, name: str, what: str, share: float) -> None:
        """A subject is at some stage, this share of it done."""

    def finish(self, outcome: Outcome) -> None:
        """A subject ended."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BatchResult:
    """All that a report of a cohort needs."""

    document: CohortDocument  # cohort.json: mm and degrees
    outcomes: tuple[Outcome, ...]  # how every member ended, with its own curves and figures in SI
    files: tuple[str, ...] = ()  # what was written beside the subjects' folders

    @property
    def subjects(self) -> ResultTable:
        """How every subject ended, and why where it was not done."""
        columns = ("subject", "status", "methods", "reason")
        rows = tuple((s.id, s.status, ", ".join(s.methods), s.reason) for s in self.document.subjects)
        return ResultTable("The cohort", columns, rows)

    def __repr__(self) -> str:
        return repr(self.subjects)

    def _repr_html_(self) -> str:
        return self.subjects._repr_html_()


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
        How recordings are processed and models fitted; its seed is that of the statistics, too.
    worker_count : int, optional
        Processes; as many as there are processor cores (no more than subjects) unless given. Results do not
        depend on it.
    executor : Executor, optional
        Where subjects are scaled, in place of these processes.
    force : bool
        Do again what is done and unchanged.
    watcher : Watcher, optional
        Told how the batch goes on.

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

    Examples
    --------
    >>> import scaling_service as ss
    >>> result = ss.batch("lab", "cohort", ["MB"], worker_count=1)
    >>> [(entry.id, entry.status) for entry in result.document.subjects]
    [('example', 'done')]
    >>> result
    The cohort
    subject status methods reason
    example   done      MB
    """
    clock = time.perf_counter()
    check_methods(methods or ())
    check_axes(settings.up, settings.forward)
    source, folder = Path(cohort), Path(out)
    check_folder(folder)
    listed, notes = read_members(source)
    read = [_load(row) for row in listed]
    members = [_make_member(row, found, folder, force) for row, found in zip(listed, read, strict=True)]
    readable = [member for member in members if member.error is None]
    check_names(((m.name, m.shown, m.file) for m in readable), source)
    _refuse_impossible([found for found in read if isinstance(found, Subject)], methods, source)
    refuse_foreign(folder, [member.name for member in readable])
    count = min(worker_count or count_cores(), len(members))
    if watcher is not None:
        watcher.start(len(members), count)
    listener, finished = (None, None) if watcher is None else (watcher.stage, watcher.finish)
    with _make_folder(folder), nullcontext(executor) if executor else workers(count, listener) as chosen:
        outcomes = run_members(members, chosen, methods, settings, finished=finished)
    result = summarise_cohort(outcomes, methods, settings, cohort=str(source), notes=notes, started=clock)
    return replace(result, files=save_cohort(result.document, outcomes, folder))


def summarise_cohort(
    outcomes: Sequence[Outcome],
    methods: Sequence[str] | None = None,
    settings: Settings = Settings(),
    *,
    cohort: str,
    notes: Sequence[str] = (),
    started: float,
) -> BatchResult:
    """Compare the methods over the members that are done; whoever computed them, nothing is read or written.

    ``methods``: those that were asked for; all that each subject allows if None. ``settings``: its seed is
    that of the statistics, too. ``cohort``: what names the members, as given. ``started``: when the work
    began, by ``time.perf_counter``.
    """
    summaries = [o.summary for o in outcomes if o.summary is not None]
    statistics = compute_cohort_statistics(summaries, methods or tuple(METHODS), seed=settings.seed)
    document = CohortDocument(
        code_version=code_version(),
        cohort=cohort,
        methods_asked=None if methods is None else list(methods),
        settings=settings.resolved(),
        seed=settings.seed,
        headline=write_headline(statistics),
        why=write_reasons(statistics, {outcome.name: outcome.groups for outcome in outcomes}),
        subjects=[_make_entry(outcome) for outcome in outcomes],
        statistics=statistics,
        notes=list(notes),
        wall_s=round(time.perf_counter() - started, 3),
    )
    return BatchResult(document, tuple(outcomes))


def explain_none_possible(
    reasons: Iterable[str], methods: Sequence[str] | None, source: str | Path
) -> InputError:
    """The error that nobody can be done by any of the methods, for these reasons."""
    return InputError(
        f"no subject can be done by {', '.join(methods or ())} ({'; '.join(dict.fromkeys(reasons))})",
        file=source,
        field="--methods",
        remedy="Choose other methods, or add what is missing to the subject files",
    )


def _refuse_impossible(subjects: Sequence[Subject], methods: Sequence[str] | None, source: Path) -> None:
    answers = [select_possible_methods(subject, methods) for subject in subjects]
    if answers and not any(possible for possible, _ in answers):
        reasons = (f"{m}: {why}" for _, left_out in answers for m, why in left_out.items())
        raise explain_none_possible(reasons, methods, source)


def _load(row: Listed) -> Subject | InputError:
    try:
        return load_subject(row.file)
    except InputError as error:
        return error


def _make_member(row: Listed, found: Subject | InputError, folder: Path, force: bool) -> SubjectMember:
    if isinstance(found, InputError):
        return SubjectMember(
            name=row.shown, file=row.file, folder=folder, shown=row.shown, groups=row.groups, error=found
        )
    place = (folder / found.id).absolute()
    return SubjectMember(
        name=found.id, file=row.file, folder=place, shown=row.shown, groups=row.groups, force=force
    )


@contextmanager
def _make_folder(folder: Path) -> Iterator[None]:
    """The folder made before workers want to make it at the same time, and gone if nothing came into it."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        with suppress(OSError):  # something is in it: it stays
            folder.rmdir()
        raise


def _make_entry(outcome: Outcome) -> SubjectEntry:
    summary = outcome.summary
    return SubjectEntry(
        id=outcome.name,
        file=outcome.shown,
        groups=dict(outcome.groups),
        status=outcome.status,
        reason="" if outcome.kept else outcome.reason,
        kept=outcome.kept,
        folder=None if summary is None else outcome.name,
        methods=[] if summary is None else list(summary.methods),
        left_out={} if summary is None else dict(summary.left_out),
        strides={} if summary is None else dict(summary.strides),
        no_strides={} if summary is None else dict(summary.no_strides),
        wall_s=round(outcome.wall_s, 3),
    )
