"""What a paper claims, and whether it holds on our persons."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from scaling_service.report.blocks import Block, Bullets, Callout, Cell, Row, Table, Text, Tone
from scaling_service.report.page import Section
from scaling_service.studies.document import ClaimEntry

_HOLDS: dict[bool | None, tuple[str, Tone]] = {
    True: ("holds", "good"),
    False: ("does not hold", "poor"),
    None: ("undecided", "unknown"),
}


def claims_section(claims: Sequence[ClaimEntry], notes: Sequence[str], persons: int) -> Section:
    """How many hold, what differs from the paper's study, and a row for each claim."""
    return Section("Do the paper's claims hold here?", list(_blocks(claims, notes, persons)))


def _blocks(claims: Sequence[ClaimEntry], notes: Sequence[str], persons: int) -> Iterator[Block]:
    held = sum(claim.holds is True for claim in claims)
    yield Callout(
        f"{held} of {len(claims)} claims hold on these {persons} persons",
        [Text("What differs, and why:"), Bullets(list(notes))],
    )
    rows = []
    for claim in claims:
        word, tone = _HOLDS[claim.holds]
        rows.append(Row(claim.where, [claim.claim, Cell(word, tone=tone), claim.paper, claim.ours]))
    yield Table(
        "Claim by claim", ["where", "claim", "here", "in the paper", "here, in figures"], rows, words=True
    )
