"""What every study done again has: claims that are asked, ``study.json``, and the page's first section."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

from pydantic import Field

from scaling_service.capabilities.cohort.document import Part
from scaling_service.documents.writing import REPORT, all_or_nothing, write_json
from scaling_service.report.blocks import Block, Bullets, Callout, Cell, Row, Table, Text, Tone
from scaling_service.report.page import Page, Section

STUDY_SCHEMA_VERSION = 1
"""Raised when a reader of an older document would misread a newer one; new keys do not raise it."""

DOCUMENT = "study.json"

_PERSONS = 1000  # chosen: cohorts of different seeds share nobody

_HOLDS: dict[bool | None, tuple[str, Tone]] = {
    True: ("holds", "good"),
    False: ("does not hold", "poor"),
    None: ("undecided", "unknown"),
}

Study = TypeVar("Study")


@dataclass(frozen=True, slots=True)
class Answer:
    """Whether a claim holds (None where the data cannot decide) and the figures that this rests on."""

    holds: bool | None
    figures: str


@dataclass(frozen=True, slots=True)
class Claim(Generic[Study]):
    """One claim of a paper: the paper's own figures for it, and the question that decides it here."""

    where: str  # section, table or figure; "truth" or "beyond" where the paper could not tell
    text: str
    paper: str
    ask: Callable[[Study], Answer]


class ClaimEntry(Part):
    """One claim of the paper, and whether it holds here."""

    where: str
    claim: str
    paper: str = Field(description="The paper's figures.")
    holds: bool | None = Field(description="Null where this cohort cannot decide.")
    ours: str = Field(description="The figures that the answer rests on.")


class StudyDocument(Part):
    """What ``study.json`` says of every study."""

    schema_version: int = STUDY_SCHEMA_VERSION
    kind: Literal["study"] = "study"
    study: str
    source: str
    code_version: str
    settings: dict[str, Any]
    seed: int
    claims: list[ClaimEntry]
    notes: list[str] = Field(description="How this study is not the paper's.")
    wall_s: float

    @property
    def size(self) -> int:
        """How many persons there are."""
        raise NotImplementedError


def person_seeds(seed: int, count: int) -> tuple[int, ...]:
    """The seeds of a cohort's persons.

    Examples
    --------
    >>> person_seeds(0, 3)
    (1, 2, 3)
    """
    return tuple(_PERSONS * seed + k for k in range(1, count + 1))


def answer_claims(claims: Sequence[Claim[Study]], study: Study) -> list[ClaimEntry]:
    """Every claim with its answer."""
    answered = [(claim, claim.ask(study)) for claim in claims]
    return [
        ClaimEntry(where=c.where, claim=c.text, paper=c.paper, holds=a.holds, ours=a.figures)
        for c, a in answered
    ]


def save_study(document: StudyDocument, page: Page, folder: str | Path) -> tuple[str, ...]:
    """Write a study into a folder, all or nothing, and name the files."""
    with all_or_nothing(Path(folder)) as scratch:
        write_json(scratch / DOCUMENT, document)
        (scratch / REPORT).write_text(page.html(), encoding="utf-8")
        return tuple(sorted(path.name for path in scratch.iterdir()))


def study_page(title: str, document: StudyDocument, sections: Sequence[Section]) -> Page:
    """The page of a study: first how many claims hold, what differs from the paper, and every claim."""
    return Page(
        f"{title}, done again on virtual persons",
        [Section("Do the paper's claims hold here?", list(_claims(document))), *sections],
        subtitle=document.source,
        footer=f"scaling-service {document.code_version}, seed {document.seed}. Numbers: {DOCUMENT}.",
    )


def _claims(document: StudyDocument) -> Iterator[Block]:
    held = sum(claim.holds is True for claim in document.claims)
    yield Callout(
        f"{held} of {len(document.claims)} claims hold on these {document.size} persons",
        [Text("What differs, and why:"), Bullets(document.notes)],
    )
    rows = []
    for claim in document.claims:
        word, tone = _HOLDS[claim.holds]
        rows.append(Row(claim.where, [claim.claim, Cell(word, tone=tone), claim.paper, claim.ours]))
    yield Table(
        "Claim by claim", ["where", "claim", "here", "in the paper", "here, in figures"], rows, words=True
    )
