"""The report of a search as a story: where, what, after, on unseen data."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.document import DiscoveryDocument
from scaling_service.capabilities.discovery.report.after import after_section
from scaling_service.capabilities.discovery.report.data import DiscoveryData
from scaling_service.capabilities.discovery.report.style import digits, placed
from scaling_service.capabilities.discovery.report.unseen import unseen_section
from scaling_service.capabilities.discovery.report.what import what_section
from scaling_service.capabilities.discovery.report.where import where_section
from scaling_service.core.text import few
from scaling_service.report.blocks import Block, Bullets, Callout, Heading, Text, Tone
from scaling_service.report.page import Page, Section
from scaling_service.report.provenance import input_blocks, repair_blocks

_TONES: dict[str, Tone] = {"found": "good", "nothing": "plain", "unexplained": "fair"}


def discovery_page(data: DiscoveryData) -> Page:
    """The page of one search.

    Parameters
    ----------
    data : DiscoveryData
    """
    document = data.document
    return Page(
        f"What is missing in the model of {document.subject}",
        [
            Section("Verdict", list(_verdict(document))),
            where_section(data),
            what_section(data),
            after_section(data),
            unseen_section(data),
            *_hidden(document),
            Section("Where it comes from", list(_provenance(document))),
        ],
        subtitle=_subtitle(document),
        footer=f"scaling-service {document.code_version}. The numbers are in discovery.json, too.",
    )


def headline(document: DiscoveryDocument) -> str:
    """The verdict in one sentence."""
    level, unseen = document.gap.held_out.whitened, _unseen(document)
    if document.verdict == "nothing":
        left = f": {unseen} are followed to {digits(level.after)} times the floor" if level else ""
        return f"Nothing stands above the noise{left}"
    if document.verdict == "unexplained":
        return "Something stands above the noise, and nothing in the catalogue explains it"
    count = len(document.effects)
    things = "One missing effect was" if count == 1 else f"{count} missing effects were"
    if level is None:
        return f"{things} found"
    fall = f"falls from {digits(level.before)} to {digits(level.after)} times the floor"
    return f"{things} found; the gap on {unseen} {fall}"


def _unseen(document: DiscoveryDocument) -> str:
    return "held-out recordings" if document.held_out_trials else "the recordings (none was held out)"


def _subtitle(document: DiscoveryDocument) -> str:
    how = "as given" if document.start == "none" else f"scaled by {document.start}"
    held = f"; held out: {', '.join(document.held_out_trials)}" if document.held_out_trials else ""
    return f"Model {how}. Fitted: {', '.join(document.fitted_trials)}{held}"


def _verdict(document: DiscoveryDocument) -> Iterator[Block]:
    blocks: list[Block] = [Bullets([effect.name for effect in document.effects], numbered=True)]
    classes = [e for e in document.effects if e.confusable_with]
    if classes:
        blocks.append(Text("Not told from other effects by these recordings (see chapter 2):"))
        blocks.append(Bullets([placed(e) for e in classes]))
    if document.unexplained:
        left = few([place for u in document.unexplained for place in u.where])
        blocks.append(Text(f"Still above the floor, and like no effect that is known: {left}."))
        if document.verdict == "unexplained":
            blocks.append(Text(f"Described best: {document.unexplained[0].law}."))
    yield Callout(headline(document), blocks, _TONES[document.verdict])
    if document.notes:
        yield Heading("What was not tried, or cannot be decided")
        yield Bullets(document.notes)


def _hidden(document: DiscoveryDocument) -> Iterator[Section]:
    """What a search of a virtual person should have found."""
    if document.hidden is not None:
        told = [f"{placed(h)}: {_listed(h.parameters)}" for h in document.hidden]
        yield Section("What had been hidden in this virtual person", [Bullets(told)])


def _listed(parameters: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.3g}" for name, value in parameters.items())


def _provenance(document: DiscoveryDocument) -> Iterator[Block]:
    yield Text(f"The search took {document.wall_s:.1f} s and stopped: {document.reason}.")
    yield from repair_blocks(document)
    yield from input_blocks(document)
