"""The members of a cohort, each scaled on its own: with files or without, on any executor."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from typing import Literal, Protocol

from scaling_service.capabilities.cohort.executors import report_stage
from scaling_service.capabilities.cohort.summary import SubjectSummary
from scaling_service.capabilities.scaling.methods.optimised import Optimised
from scaling_service.capabilities.scaling.methods.table import METHODS, check_methods
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.core.errors import InputError
from scaling_service.core.progress import Progress
from scaling_service.model.builtin import BUILTIN_NAMES
from scaling_service.model.subject import Subject

Status = Literal["done", "skipped", "failed"]


class NothingPossible(InputError):
    """None of the methods that were asked for can be done with what a subject has."""


@dataclass(frozen=True, slots=True)
class Done:
    """What a member gives: its summary, and whether it was kept from an earlier run."""

    summary: SubjectSummary
    kept: bool = False


class Member(Protocol):
    """How to get one subject: small, able to travel to a worker process; reads files in :meth:`work` only."""

    @property
    def name(self) -> str:
        """Names the subject within the cohort, until its summary does."""

    @property
    def shown(self) -> str:
        """What stands for it in the list of members, such as its file."""

    @property
    def groups(self) -> Mapping[str, str]:
        """Labels kept in the results."""

    def work(self, methods: Sequence[str] | None, settings: Settings, progress: Progress) -> Done:
        """Scale the subject; raises NothingPossible to be skipped, any other InputError to fail."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """How a member ended.

    ``reason`` says why it was skipped or failed, or that it was kept from an earlier run; ``summary`` is that
    of a member that is done; ``shown`` stands for it in the list of members.
    """

    name: str
    groups: Mapping[str, str]
    status: Status
    reason: str = ""
    summary: SubjectSummary | None = None
    kept: bool = False
    wall_s: float = 0.0
    shown: str = ""


def select_possible_methods(
    subject: Subject, methods: Sequence[str] | None = None
) -> tuple[tuple[str, ...], dict[str, str]]:
    """The methods, of those asked for or all, that a subject's files allow; the others with the reason."""
    imaged = bool(subject.bones) and subject.model in BUILTIN_NAMES
    left_out = {}
    for name in methods or METHODS:
        if METHODS[name].needs_images and not imaged:
            left_out[name] = "no bones" if not subject.bones else "bones are used with built-in models only"
        elif isinstance(METHODS[name], Optimised) and not subject.calibration:
            left_out[name] = "no calibration trial"
    return tuple(name for name in methods or METHODS if name not in left_out), left_out


def run_members(
    members: Sequence[Member],
    executor: Executor,
    methods: Sequence[str] | None = None,
    settings: Settings = Settings(),
    *,
    finished: Callable[[Outcome], None] | None = None,
) -> tuple[Outcome, ...]:
    """Scale every member of a cohort, in the members' order; one subject's failure stops no other.

    ``members``: one subject each, under names of their own. ``executor``: see ``workers``; results do not
    depend on it. ``methods``: all that each subject allows unless given. ``finished``: called with each
    outcome as it ends, in any order. SubjectInvalid: a method that there is not.
    """
    check_methods(methods or ())
    futures: list[Future[Outcome]] = []
    try:
        for member in members:
            future = executor.submit(_run_member, member, methods, settings)
            futures.append(future)
            if finished is not None:
                future.add_done_callback(partial(_announce, finished, member))
        return tuple(_make_outcome(member, future) for member, future in zip(members, futures, strict=True))
    except BaseException:
        for future in futures:
            future.cancel()
        raise


def _announce(finished: Callable[[Outcome], None], member: Member, future: Future[Outcome]) -> None:
    if not future.cancelled() and not isinstance(future.exception(), KeyboardInterrupt):
        finished(_make_outcome(member, future))


def _make_outcome(member: Member, future: Future[Outcome]) -> Outcome:
    try:
        return future.result()
    except BrokenProcessPool:
        reason = "a worker process ended abruptly (out of memory?). Run again, with fewer workers"
        return Outcome(
            name=member.name, groups=member.groups, status="failed", reason=reason, shown=member.shown
        )


def _run_member(member: Member, methods: Sequence[str] | None, settings: Settings) -> Outcome:
    """How one member ends, whatever happens to it; runs in a worker."""
    clock = time.perf_counter()

    def make_outcome(status: Status, reason: str = "", done: Done | None = None) -> Outcome:
        summary, kept = (None, False) if done is None else (done.summary, done.kept)
        name = member.name if summary is None else summary.subject
        wall_s = time.perf_counter() - clock
        return Outcome(
            name=name,
            groups=member.groups,
            status=status,
            reason=reason,
            summary=summary,
            kept=kept,
            wall_s=wall_s,
            shown=member.shown,
        )

    try:
        done = member.work(methods, settings, partial(report_stage, member.name))
    except NothingPossible as error:
        return make_outcome("skipped", error.problem)
    except InputError as error:
        return make_outcome("failed", str(error))
    except Exception as error:  # noqa: BLE001 (a defect met by one subject must not cost the others)
        return make_outcome("failed", f"a defect of the program: {type(error).__name__}: {error}")
    return make_outcome("done", "unchanged since an earlier run" if done.kept else "", done)
