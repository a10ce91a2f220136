"""Many subjects, each on its own, then their statistics: with files or without, on any executor."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal, Protocol

from scaling_service.capabilities.cohort.custom_legs import Generic, custom_legs
from scaling_service.capabilities.cohort.executors import tell
from scaling_service.capabilities.cohort.statistics import CohortSettings, CohortStatistics, cohort_statistics
from scaling_service.capabilities.cohort.subject_summary import SubjectSummary
from scaling_service.capabilities.cohort.summaries import Truth, summarise
from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.capabilities.scaling.run import check_methods, run
from scaling_service.capabilities.subject.loading import Loaded
from scaling_service.capabilities.subject.settings import Settings
from scaling_service.core.errors import InputError
from scaling_service.core.progress import Progress
from scaling_service.model.builtin import BUILTIN_NAMES
from scaling_service.model.subject import Subject
from scaling_service.virtual.subject import VirtualSettings, demo_session

Status = Literal["done", "skipped", "failed"]


class NothingPossible(InputError):
    """None of the methods that were asked for can be done with what a subject has."""


@dataclass(frozen=True, slots=True)
class Done:
    """What an item gives: its summary, and whether it was kept from an earlier run."""

    summary: SubjectSummary
    kept: bool = False


class Item(Protocol):
    """How to get one subject: small, and able to travel to a worker process.

    An item that reads files does so in :meth:`work`, never before.
    """

    @property
    def name(self) -> str:
        """Names the subject within the cohort, until its summary does."""

    @property
    def groups(self) -> Mapping[str, str]:
        """Labels kept in the results."""

    def work(self, methods: Sequence[str] | None, settings: Settings, progress: Progress) -> Done:
        """Scale the subject.

        Raises
        ------
        NothingPossible
            The subject is skipped.
        InputError
            The subject failed.
        """


@dataclass(frozen=True, slots=True)
class VirtualPerson:
    """A person drawn from the literature's spread, truth known; with or without images.

    ``generic`` says what scaling starts from.
    """

    seed: int
    settings: VirtualSettings = field(default_factory=VirtualSettings)
    groups: Mapping[str, str] = field(default_factory=dict)
    images: bool = False
    generic: Generic = "mean"

    @property
    def name(self) -> str:
        """``virtual_<seed>``."""
        return f"virtual_{self.seed}"

    def work(self, methods: Sequence[str] | None, settings: Settings, progress: Progress) -> Done:
        """Record the person, and scale."""
        session, person = demo_session(self.seed, self.settings, images=self.images)
        if self.generic == "custom":
            session = replace(session, model=custom_legs(session.model))
        results = run(Loaded(session), methods, settings, progress=progress)
        return Done(summarise(results, Truth(person.model, person.motions)))


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a subject ended.

    Parameters
    ----------
    name : str
    groups : mapping
    status : 'done', 'skipped' or 'failed'
    reason : str
        Why it was skipped or failed, or that it was kept from an earlier run.
    summary : SubjectSummary, optional
        Of a subject that is done.
    kept : bool
        Whether it was done in an earlier run.
    wall_s : float
    """

    name: str
    groups: Mapping[str, str]
    status: Status
    reason: str = ""
    summary: SubjectSummary | None = None
    kept: bool = False
    wall_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class CohortRun:
    """All subjects of a cohort and their statistics.

    Parameters
    ----------
    outcomes : tuple of Outcome
        In the order of the items.
    statistics : CohortStatistics
        Over the subjects that are done.
    """

    outcomes: tuple[Outcome, ...]
    statistics: CohortStatistics

    @property
    def summaries(self) -> tuple[SubjectSummary, ...]:
        """Of the subjects that are done."""
        return tuple(o.summary for o in self.outcomes if o.summary is not None)


def possible_methods(
    subject: Subject, methods: Sequence[str] | None = None
) -> tuple[tuple[str, ...], dict[str, str]]:
    """The methods, of those asked for (else of all), that a subject's files allow.

    Returns
    -------
    possible : tuple of str
    left_out : dict
        Every other method to the reason.
    """
    imaged = bool(subject.bones) and subject.model in BUILTIN_NAMES
    left_out = {}
    for name in methods or METHODS:
        if METHODS[name].needs_images and not imaged:
            left_out[name] = "no bones" if not subject.bones else "bones are used with built-in models only"
        elif METHODS[name].needs_movements and not subject.calibration:
            left_out[name] = "no calibration trial"
    return tuple(name for name in methods or METHODS if name not in left_out), left_out


def run_cohort(
    items: Sequence[Item],
    executor: Executor,
    methods: Sequence[str] | None = None,
    settings: Settings = Settings(),
    *,
    cohort: CohortSettings | None = None,
    finished: Callable[[Outcome], None] | None = None,
) -> CohortRun:
    """Scale every subject, and compare the methods over those that are done.

    Parameters
    ----------
    items : sequence of Item
        One subject each, under names of their own.
    executor : Executor
        See ``workers``. Results do not depend on it.
    methods : sequence of str, optional
        All that each subject allows unless given.
    settings : Settings
        Its seed is that of the statistics, too.
    cohort : CohortSettings, optional
    finished : callable, optional
        Called with each outcome as it ends, in any order.

    Returns
    -------
    CohortRun
        One subject's failure stops no other.

    Raises
    ------
    SubjectInvalid
        A method that there is not.

    Examples
    --------
    >>> from scaling_service.capabilities.cohort.executors import workers
    >>> with workers(1) as executor:
    ...     found = run_cohort([VirtualPerson(1), VirtualPerson(2)], executor, ["MB", "MB_am"])
    >>> [o.status for o in found.outcomes], sorted(found.statistics.scalar("segment_length", "femur_r").mean)
    (['done', 'done'], ['MB', 'MB_am'])
    """
    check_methods(methods or ())
    futures: list[Future[Outcome]] = []
    try:
        for item in items:
            future = executor.submit(_ended, item, methods, settings)
            futures.append(future)
            if finished is not None:
                future.add_done_callback(partial(_announce, finished, item))
        outcomes = tuple(_outcome(item, future) for item, future in zip(items, futures, strict=True))
    except BaseException:
        for future in futures:
            future.cancel()
        raise
    summaries = [o.summary for o in outcomes if o.summary is not None]
    statistics = cohort_statistics(summaries, methods or tuple(METHODS), seed=settings.seed, settings=cohort)
    return CohortRun(outcomes, statistics)


def _announce(finished: Callable[[Outcome], None], item: Item, future: Future[Outcome]) -> None:
    if not future.cancelled() and not isinstance(future.exception(), KeyboardInterrupt):
        finished(_outcome(item, future))


def _outcome(item: Item, future: Future[Outcome]) -> Outcome:
    try:
        return future.result()
    except BrokenProcessPool:
        return Outcome(
            item.name,
            item.groups,
            "failed",
            "a worker process ended abruptly (out of memory?). Run again, with fewer workers",
        )


def _ended(item: Item, methods: Sequence[str] | None, settings: Settings) -> Outcome:
    """How one subject ends, whatever happens to it; runs in a worker."""
    clock = time.perf_counter()

    def outcome(status: Status, reason: str = "", done: Done | None = None) -> Outcome:
        summary, kept = (None, False) if done is None else (done.summary, done.kept)
        name = item.name if summary is None else summary.subject
        return Outcome(name, item.groups, status, reason, summary, kept, time.perf_counter() - clock)

    try:
        done = item.work(methods, settings, partial(tell, item.name))
    except NothingPossible as error:
        return outcome("skipped", error.problem)
    except InputError as error:
        return outcome("failed", str(error))
    except Exception as error:  # noqa: BLE001 (a defect met by one subject must not cost the others)
        return outcome("failed", f"a defect of the program: {type(error).__name__}: {error}")
    return outcome("done", "unchanged since an earlier run" if done.kept else "", done)
