"""What every study done again has: claims that are asked, ``study.json``, and the page's first section."""

from __future__ import annotations

import typing
from collections import abc
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

from pydantic import Field

from scaling_service.capabilities.cohort.executors import run_in_processes
from scaling_service.core.errors import InputError
from scaling_service.core.threads import count_cores
from scaling_service.documents import base, writing
from scaling_service.model.reference import read_reference
from scaling_service.report import tables as report_tables
from scaling_service.report.onefile import Report
from scaling_service.report.summary import Summary

STUDY_SCHEMA_VERSION = 1
"""Raised when a reader of an older document would misread a newer one; new keys do not raise it."""

DOCUMENT = "study.json"

_PERSONS = 1000  # chosen: cohorts of different seeds share nobody

PersonDone = abc.Callable[[str, int, int], None]
"""Called with a person's name, how many are done, and of how many."""

Study = typing.TypeVar("Study", bound="StudyDocument")
Person = typing.TypeVar("Person", bound="PersonPart")

HOLDS: dict[bool | None, tuple[str, base.Tone]] = {
    True: ("holds", "good"),
    False: ("does not hold", "poor"),
    None: ("undecided", "unknown"),
}
"""Whether a claim holds, in words, and the tone of that."""


@dataclass(frozen=True, slots=True)
class Answer:
    """Whether a claim holds (None where the data cannot decide) and the figures that this rests on."""

    holds: bool | None
    figures: str


@dataclass(frozen=True, slots=True)
class Claims(typing.Generic[Study]):
    """The claims of a paper, and the question to our study, one for each by its name, that decides it.

    ``said``: of ``study.yaml``: ``notes`` (how the study is not the paper's) and ``claims`` (``where`` they
    stand, "truth" or "beyond" where the paper could not tell; ``claim``; the ``paper``'s figures).
    """

    said: abc.Mapping[str, typing.Any]
    questions: dict[str, abc.Callable[[Study], Answer]] = field(default_factory=dict)

    @classmethod
    def read(cls, package: str) -> Claims[Study]:
        """Those in a study's package, with no question yet."""
        return cls(read_reference(resources.files(package) / "study.yaml"))

    def decide(self, ask: abc.Callable[[Study], Answer]) -> abc.Callable[[Study], Answer]:
        """A decorator of the question that decides the claim of its name."""
        self.questions[ask.__name__] = ask
        return ask

    def answer(self, study: Study) -> Study:
        """The document with every claim's answer in it."""
        answers = ((said, self.questions[name](study)) for name, said in self.said["claims"].items())
        entries = [ClaimEntry(**said, holds=found.holds, ours=found.figures) for said, found in answers]
        return study.model_copy(update={"claims": entries})


class ClaimEntry(base.Part):
    """One claim of the paper, and whether it holds here."""

    where: str
    claim: str
    paper: str = Field(description="The paper's figures.")
    holds: bool | None = Field(description="Null where this cohort cannot decide.")
    ours: str = Field(description="The figures that the answer rests on.")


class PersonPart(base.Part):
    """What is found of one virtual person."""

    name: str


class StudyDocument(base.Part):
    """What ``study.json`` says of every study."""

    schema_version: int = STUDY_SCHEMA_VERSION
    kind: typing.Literal["study"] = "study"
    study: str
    source: str
    code_version: str
    settings: dict[str, typing.Any]
    seed: int
    claims: list[ClaimEntry] = Field(default=[])
    notes: list[str] = Field(description="How this study is not the paper's.")
    wall_s: float

    @property
    def size(self) -> int:
        """How many persons there are."""
        raise NotImplementedError


def draw_person_seeds(seed: int, count: int) -> tuple[int, ...]:
    """The seeds of a cohort's persons.

    Examples
    --------
    >>> draw_person_seeds(0, 3)
    (1, 2, 3)
    """
    return tuple(_PERSONS * seed + k for k in range(1, count + 1))


def study_persons(
    study: abc.Callable[..., Person],
    seed: int,
    subjects: int,
    *settings: object,
    worker_count: int | None = None,
    finished: PersonDone | None = None,
) -> list[Person]:
    """Every person of a cohort, each by one call of a module's function with the person's seed and settings.

    ``worker_count``: processes; as many as there are cores unless given. InputError: no subject is asked for.
    """
    if subjects < 1:
        raise InputError("no subject is asked for", field="--subjects", remedy="Take at least one")
    return run_in_processes(
        study,
        [(one, *settings) for one in draw_person_seeds(seed, subjects)],
        min(worker_count or count_cores(), subjects),
        lambda person, done: None if finished is None else finished(person.name, done, subjects),
    )


def save_study(document: StudyDocument, summary: Summary, folder: str | Path) -> tuple[str, ...]:
    """Write a study into a folder, all or nothing, and name the files."""
    with writing.all_or_nothing(Path(folder)) as scratch:
        writing.write_json(scratch / DOCUMENT, document)
        Report(kind="study", name=DOCUMENT, summary=summary, document=document).write(scratch)
        return tuple(sorted(path.name for path in scratch.iterdir()))


def summarise_study(
    title: str, document: StudyDocument, tables: abc.Iterable[report_tables.Table]
) -> Summary:
    """A study in short: how many claims hold, what differs from the paper, every claim, and the tables."""
    every = all(claim.holds for claim in document.claims)
    # Every claim, and whether it holds here
    rows = []
    for claim in document.claims:
        word, tone = HOLDS[claim.holds]
        rows.append(
            report_tables.Row(
                claim.where, [claim.claim, report_tables.Cell(word, tone=tone), claim.paper, claim.ours]
            )
        )
    return Summary(
        title=f"{title}, done again on virtual persons",
        subtitle=document.source,
        headline=f"{count_held(document)} claims hold on these {document.size} persons; what differs:",
        tone="good" if every else "fair",
        why=document.notes,
        tables=[
            report_tables.Table(
                caption="Claim by claim",
                columns=["where", "claim", "here", "in the paper", "here, in figures"],
                rows=rows,
                words=True,
            ),
            *tables,
        ],
    )


def count_held(document: StudyDocument) -> str:
    """How many claims hold, of how many."""
    return f"{sum(claim.holds is True for claim in document.claims)} of {len(document.claims)}"
