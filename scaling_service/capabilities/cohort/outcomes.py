"""The members of a cohort, each scaled on its own, on any executor; done once, unless something changed."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import time
from collections import abc
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path
from typing import Literal, Protocol

from pydantic import TypeAdapter

from scaling_service.capabilities.cohort import summary as summaries
from scaling_service.capabilities.cohort.executors import report_stage
from scaling_service.capabilities.cohort.result import RECORD
from scaling_service.capabilities.scaling.methods import table
from scaling_service.capabilities.scaling.methods.optimised import Optimised
from scaling_service.capabilities.scaling.run import compare
from scaling_service.capabilities.scaling.saving import save
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject import reading
from scaling_service.capabilities.subject.images import takes_bones
from scaling_service.core.errors import InputError
from scaling_service.core.progress import Progress
from scaling_service.documents.reading import read_document
from scaling_service.documents.writing import code_version
from scaling_service.model.subject import Subject

Status = Literal["done", "skipped", "failed"]

RECORD_VERSION = 1
"""Part of every specification: raised when a summary holds other things than before."""

_COMPUTING = 0.85  # chosen: about computing's share of a subject's time, before its files are written


class NothingPossible(InputError):
    """None of the methods that were asked for can be done with what a subject has."""


@dataclasses.dataclass(frozen=True, slots=True)
class Done:
    """What a member gives: its summary, and whether it was kept from an earlier run."""

    summary: summaries.SubjectSummary
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
    def groups(self) -> abc.Mapping[str, str]:
        """Labels kept in the results."""

    def work(self, methods: abc.Sequence[str] | None, settings: Settings, progress: Progress) -> Done:
        """Scale the subject; raises NothingPossible to be skipped, any other InputError to fail."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """How a member ended.

    ``reason`` says why it was skipped or failed, or that it was kept from an earlier run; ``summary`` is that
    of a member that is done; ``shown`` stands for it in the list of members.
    """

    name: str
    groups: abc.Mapping[str, str]
    status: Status
    reason: str = ""
    summary: summaries.SubjectSummary | None = None
    kept: bool = False
    wall_s: float = 0.0
    shown: str = ""


def select_possible_methods(
    subject: Subject, methods: abc.Sequence[str] | None = None
) -> tuple[tuple[str, ...], dict[str, str]]:
    """The methods, of those asked for or all, that a subject's files allow; the others with the reason."""
    imaged = bool(subject.bones) and takes_bones(subject)
    left_out = {}
    wanted = methods or tuple(table.METHODS)
    for name in wanted:
        if table.METHODS[name].needs_images and not imaged:
            left_out[name] = (
                "no bones" if not subject.bones else "bones are used with built-in and .osim models only"
            )
        elif isinstance(table.METHODS[name], Optimised) and not subject.calibration:
            left_out[name] = "no calibration trial"
    return tuple(name for name in wanted if name not in left_out), left_out


def run_members(
    members: abc.Sequence[Member],
    executor: Executor,
    methods: abc.Sequence[str] | None = None,
    settings: Settings = Settings(),
    *,
    finished: abc.Callable[[Outcome], None] | None = None,
) -> tuple[Outcome, ...]:
    """Scale every member of a cohort, in the members' order; one subject's failure stops no other.

    ``members``: one subject each, under names of their own. ``executor``: see ``workers``; results do not
    depend on it. ``methods``: all that each subject allows unless given. ``finished``: called with each
    outcome as it ends, in any order. SubjectInvalid: a method that there is not.
    """
    table.check_methods(methods or ())
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


def _announce(finished: abc.Callable[[Outcome], None], member: Member, future: Future[Outcome]) -> None:
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


def _run_member(member: Member, methods: abc.Sequence[str] | None, settings: Settings) -> Outcome:
    """How one member ends, whatever happens to it; runs in a worker."""
    clock = time.perf_counter()
    ended = Outcome(name=member.name, groups=member.groups, status="failed", shown=member.shown)
    try:
        done = member.work(methods, settings, partial(report_stage, member.name))
    except NothingPossible as error:
        ended = dataclasses.replace(ended, status="skipped", reason=error.problem)
    except InputError as error:
        ended = dataclasses.replace(ended, reason=str(error))
    except Exception as error:  # noqa: BLE001 (a defect met by one subject must not cost the others)
        reason = f"a defect of the program: {type(error).__name__}: {error}"
        ended = dataclasses.replace(ended, reason=reason)
    else:
        reason = "unchanged since an earlier run" if done.kept else ""
        ended = dataclasses.replace(
            ended,
            name=done.summary.subject,
            status="done",
            reason=reason,
            summary=done.summary,
            kept=done.kept,
        )
    return dataclasses.replace(ended, wall_s=time.perf_counter() - clock)


@dataclasses.dataclass(frozen=True, slots=True)
class Record:
    """That a subject is done: in SI with every digit, so that another run gives the same.

    ``specification`` is the SHA-256 of everything that the results depend on; ``files`` are what was written,
    relative to the subject's folder.
    """

    specification: str
    files: tuple[str, ...]
    summary: summaries.SubjectSummary


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class SubjectMember:
    """How to scale the subject of a file, and where to write its results.

    ``force`` does it again even if nothing changed; a subject whose file cannot be used fails by its
    ``error`` without any work.
    """

    name: str
    file: Path
    folder: Path
    shown: str = ""
    groups: abc.Mapping[str, str] = dataclasses.field(default_factory=dict)
    force: bool = False
    error: InputError | None = None

    def work(self, methods: abc.Sequence[str] | None, settings: Settings, progress: Progress) -> Done:
        """Scale by the methods that are possible, and write what ``compare`` writes.

        NothingPossible: none of the methods can be done. InputError: whatever in the subject's files cannot
        be used, or a folder that cannot be written to.
        """
        if self.error is not None:
            raise self.error
        subject = reading.load_subject(self.file)
        possible, left_out = select_possible_methods(subject, methods)
        if not possible:
            raise NothingPossible("; ".join(f"{method}: {why}" for method, why in left_out.items()))
        # SHA-256 of what the results depend on: the document as it is understood, so that comments and order
        # change nothing, and every file that it names, by its content
        inputs = reading.hash_input_files(subject, self.file)
        del inputs[self.file.resolve().name]
        content = {
            "record": RECORD_VERSION,
            "code": code_version(),
            "document": read_document(self.file).model_dump(mode="json"),
            "inputs": inputs,
            "methods": None if methods is None else list(methods),
            "settings": settings.resolved(),
            "seed": settings.seed,
        }
        text = json.dumps(content, sort_keys=True, ensure_ascii=True)
        specified = hashlib.sha256(text.encode("ascii")).hexdigest()
        known = None if self.force else read_record(self.folder)
        if known is not None and known.specification == specified:
            return Done(known.summary, kept=True)
        results = compare(
            self.file, possible, settings, progress=lambda what, share: progress(what, _COMPUTING * share)
        )
        # Gone before the first new file is there: a record never speaks for other files than its own.
        (self.folder / RECORD).unlink(missing_ok=True)
        document = save(
            results,
            self.folder,
            progress=lambda what, share: progress(what, _COMPUTING + (1.0 - _COMPUTING) * share),
        )
        summary = summaries.summarise(results, left_out=left_out)
        # Written beside and moved into place, so that there is never half of one.
        written = [
            f"{m.method}/{name}" for m in document.methods.values() for name in (*m.files, "scaling.json")
        ]
        record = Record(specified, ("comparison.json", *written), summary)
        new = self.folder / f".{RECORD}.{os.getpid()}"
        new.write_text(json.dumps(TypeAdapter(Record).dump_python(record)) + "\n", encoding="utf-8")
        new.replace(self.folder / RECORD)
        return Done(summary)


def read_record(folder: Path) -> Record | None:
    """What an earlier batch kept of a subject; None where it is absent, not whole, or its files are gone."""
    try:
        record = TypeAdapter(Record).validate_json((folder / RECORD).read_bytes())
    except (OSError, ValueError):  # absent, no JSON, or not this record: a ValidationError is a ValueError
        return None
    return record if all((folder / name).is_file() for name in record.files) else None


def read_summary(folder: Path) -> summaries.SubjectSummary:
    """What the statistics take of a subject that is done, whose other files need not be there."""
    return TypeAdapter(Record).validate_json((folder / RECORD).read_bytes()).summary
