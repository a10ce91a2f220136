"""What is told of an input: a value with a code, by which programs find it, and never by its wording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

LOOK = "Look whether it matters to you; scaling takes it as described here"

Severity = Literal["refusal", "warning", "note"]
"""Nothing is computed; somebody should look; nothing is to be done."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Note:
    """One thing to tell of an input.

    Examples
    --------
    >>> str(Note(code="unseen", place="walk", problem="RFH labelled, but never seen"))
    'walk: RFH labelled, but never seen'
    """

    code: str
    problem: str
    place: str = ""  # the recording or bone that it is about; everything where empty
    severity: Severity = "warning"
    remedy: str = LOOK
    called: str = ""  # the place in a sentence, where that is another name
    hint: str = ""  # the remedy in few words, where the sentence gives it

    def __str__(self) -> str:
        return f"{self.statement}; {self.hint}" if self.hint else self.statement

    @property
    def statement(self) -> str:
        """Place and problem; the remedy stands beside it."""
        place = self.called or self.place
        return f"{place}: {self.problem}" if place else self.problem
