"""Many subjects: each scaled on its own, then the methods compared over all of them."""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections import abc
from concurrent.futures import Executor
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Protocol

from scaling_service.capabilities.cohort import outcomes as cohort_outcomes
from scaling_service.capabilities.cohort import result as documents
from scaling_service.capabilities.cohort import saving
from scaling_service.capabilities.cohort.executors import workers
from scaling_service.capabilities.cohort.members import read_members
from scaling_service.capabilities.cohort.statistics import compute_cohort_statistics
from scaling_service.capabilities.cohort.summary import IMAGED, TRUTH
from scaling_service.capabilities.scaling.methods import table
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.reading import load_subject
from scaling_service.core.errors import InputError
from scaling_service.core.names import spell_name
from scaling_service.core.tables import ResultTable
from scaling_service.core.text import format_p
from scaling_service.core.threads import count_cores
from scaling_service.documents import writing
from scaling_service.recording.orientation import check_axes


def write_headline(found: documents.StatisticsDocument) -> str:
    """Which method follows the markers most closely, and whether that is more than chance."""
    role, entry = next(_list_compared_errors(found), (None, None))
    if role is None or entry is None:
        return "The methods cannot be compared: no two of them were done on the same persons"
    best = min(entry.mean, key=entry.mean.__getitem__)
    count = len(entry.compared.subjects)
    people = "1 person" if count == 1 else f"{count} persons"
    said = f"{best} follows the markers of {people} most closely, to {entry.mean[best]:.1f} mm {role}"
    if entry.friedman is None:
        return f"{said}; too few persons to tell that from chance"
    return said if entry.friedman.significant else f"{said}, but the methods may differ by chance"


def write_reasons(
    found: documents.StatisticsDocument, groups: abc.Mapping[str, abc.Mapping[str, str]]
) -> list[str]:
    """What the headline rests on, and what it does not say; ``groups``: the labels of each subject."""
    told: list[str] = []
    for said, entry in _list_compared_errors(found):
        ranked = f"Kinematic error {said}, mm, smallest first: {_rank(entry.mean)}."
        told.append(f"{ranked} {_describe_test(entry)}")
    # The errors of the first role in each group of each label
    for said, entry in islice(_list_compared_errors(found), 1):
        for label in sorted({label for given in groups.values() for label in given}):
            members: dict[str, list[abc.Mapping[str, float]]] = {}
            for subject in entry.compared.subjects:
                group = groups[subject].get(label) or "not given"
                members.setdefault(group, []).append(entry.values[subject])
            if len(members) > 1:
                means = {
                    group: {method: sum(one[method] for one in of) / len(of) for method in of[0]}
                    for group, of in members.items()
                }
                ranks = "; ".join(
                    f"{group} ({len(of)}): {_rank(means[group])}" for group, of in members.items()
                )
                how = "Groups are described, not tested"
                told.append(f"By {label}, kinematic error {said}, mm: {ranks}. {how}.")
    lengths = [
        (spell_name(e.quantity), e.friedman) for e in found.segment_lengths_mm if e.friedman is not None
    ]
    differ = dict.fromkeys(name for name, test in lengths if test.significant)
    told.extend(_tell_differences(len(lengths), ", ".join(differ), "segment length", ""))
    # Which method's lengths lie nearest to each reference, by the RMS over lengths and subjects
    for reference, whose in ((IMAGED, "the image"), (TRUTH, "the truth")):
        squares: dict[str, list[float]] = {}
        for item in found.agreement:
            if item.reference == reference and "." not in item.quantity:
                squares.setdefault(item.method, []).append(item.rmse_mm**2)
        if squares:
            rms = {m: (sum(v) / len(v)) ** 0.5 for m, v in squares.items()}
            told.append(f"Lengths against {whose}, RMS in mm, nearest first: {_rank(rms)}.")
    angles = [(spell_name(c.coordinate), c.anova) for c in found.joint_angles if c.anova is not None]
    moving = dict.fromkeys(name for name, test in angles if test.significant)
    told.extend(_tell_differences(len(angles), "; ".join(moving), "joint angle", " in the gait cycle"))
    return [
        *told,
        "A small error alone is no proof of a right model: look at the agreement with images, too.",
    ]


def _list_compared_errors(
    found: documents.StatisticsDocument,
) -> abc.Iterator[tuple[str, documents.QuantityEntry]]:
    """Errors of two methods or more, in words where: held out first."""
    entries = {entry.quantity: entry for entry in found.kinematic_error_mm if len(entry.mean) > 1}
    for role, said in (("evaluation", "on held-out trials"), ("calibration", "on trials used to fit")):
        if role in entries:
            yield said, entries[role]


def _rank(values: abc.Mapping[str, float]) -> str:
    return ", ".join(f"{name} {values[name]:.1f}" for name in sorted(values, key=values.__getitem__))


def _describe_test(entry: documents.QuantityEntry) -> str:
    if entry.friedman is None:
        return f"Not tested: {entry.note}."
    said = "The methods differ" if entry.friedman.significant else "No difference between methods is found"
    return f"{said} (Friedman p {format_p(entry.friedman.p)})."


def _tell_differences(tested: int, differ: str, quantity: str, where: str) -> abc.Iterator[str]:
    if differ:
        yield f"{quantity.capitalize()}s differ between methods{where} for {differ}."
    elif tested:
        yield f"No {quantity} is found to differ between methods{where}."


class Watcher(Protocol):
    """Whoever wants to see a batch go on. Calls may come from several threads."""

    def start(self, count: int, workers: int) -> None:
        """So many subjects are about to be done by so many workers."""

    def stage(self, name: str, what: str, share: float) -> None:
        """A subject is at some stage, this share of it done."""

    def finish(self, outcome: cohort_outcomes.Outcome) -> None:
        """A subject ended."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, repr=False)
class BatchResult:
    """All that a report of a cohort needs."""

    document: documents.CohortDocument  # cohort.json: mm and degrees
    outcomes: tuple[
        cohort_outcomes.Outcome, ...
    ]  # how every member ended, with its own curves and figures in SI
    files: tuple[str, ...] = ()  # what was written beside the subjects' folders

    @property
    def subjects(self) -> ResultTable:
        """How every subject ended, and why where it was not done."""
        columns = ("subject", "status", "methods", "reason")
        rows = tuple((s.id, s.status, ", ".join(s.methods), s.reason) for s in self.document.subjects)
        return ResultTable("The cohort", columns, rows)

    @property
    def tables(self) -> dict[str, ResultTable]:
        """How every subject ended, and lengths, errors and mean curves of all."""
        every = {
            name.removesuffix(".csv"): saving.tabulate_outcomes(name, self.outcomes)
            for name in saving.list_tables()
        }
        return {"subjects": self.subjects, **every}

    def __repr__(self) -> str:
        return repr(self.subjects)

    def _repr_html_(self) -> str:
        return self.subjects._repr_html_()


def batch(
    cohort: str | Path,
    out: str | Path,
    methods: abc.Sequence[str] | None = None,
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
    table.check_methods(methods or ())
    check_axes(settings.up, settings.forward)
    source, folder = Path(cohort), Path(out)
    writing.check_folder(folder)
    listed, notes = read_members(source)
    members, subjects = [], []
    for row in listed:
        member = partial(cohort_outcomes.SubjectMember, file=row.file, shown=row.shown, groups=row.groups)
        try:
            found = load_subject(row.file)
        except InputError as error:
            members.append(member(name=row.shown, folder=folder, error=error))
        else:
            subjects.append(found)
            members.append(member(name=found.id, folder=(folder / found.id).absolute(), force=force))
    readable = [member for member in members if member.error is None]
    saving.check_names(((m.name, m.shown, m.file) for m in readable), source)
    answers = [cohort_outcomes.select_possible_methods(subject, methods) for subject in subjects]
    if answers and not any(possible for possible, _ in answers):
        reasons = (f"{m}: {why}" for _, left_out in answers for m, why in left_out.items())
        raise explain_none_possible(reasons, methods, source)
    saving.refuse_foreign(folder, [member.name for member in readable])
    count = min(worker_count or count_cores(), len(members))
    if watcher is not None:
        watcher.start(len(members), count)
    listener, finished = (None, None) if watcher is None else (watcher.stage, watcher.finish)
    with (
        _make_folder(folder),
        contextlib.nullcontext(executor) if executor else workers(count, listener) as chosen,
    ):
        outcomes = cohort_outcomes.run_members(members, chosen, methods, settings, finished=finished)
    result = summarise_cohort(outcomes, methods, settings, cohort=str(source), notes=notes, started=clock)
    return dataclasses.replace(result, files=saving.save_cohort(result.document, outcomes, folder))


def summarise_cohort(
    outcomes: abc.Sequence[cohort_outcomes.Outcome],
    methods: abc.Sequence[str] | None = None,
    settings: Settings = Settings(),
    *,
    cohort: str,
    notes: abc.Sequence[str] = (),
    started: float,
) -> BatchResult:
    """Compare the methods over the members that are done; whoever computed them, nothing is read or written.

    ``methods``: those that were asked for; all that each subject allows if None. ``settings``: its seed is
    that of the statistics, too. ``cohort``: what names the members, as given. ``started``: when the work
    began, by ``time.perf_counter``.
    """
    summaries = [o.summary for o in outcomes if o.summary is not None]
    statistics = compute_cohort_statistics(summaries, methods or tuple(table.METHODS), seed=settings.seed)
    document = documents.CohortDocument(
        code_version=writing.code_version(),
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
    reasons: abc.Iterable[str], methods: abc.Sequence[str] | None, source: str | Path
) -> InputError:
    """The error that nobody can be done by any of the methods, for these reasons."""
    return InputError(
        f"no subject can be done by {', '.join(methods or ())} ({'; '.join(dict.fromkeys(reasons))})",
        file=source,
        field="--methods",
        remedy="Choose other methods, or add what is missing to the subject files",
    )


@contextlib.contextmanager
def _make_folder(folder: Path) -> abc.Iterator[None]:
    """The folder made before workers want to make it at the same time, and gone if nothing came into it."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        with contextlib.suppress(OSError):  # something is in it: it stays
            folder.rmdir()
        raise


def _make_entry(outcome: cohort_outcomes.Outcome) -> documents.SubjectEntry:
    summary = outcome.summary
    return documents.SubjectEntry(
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
