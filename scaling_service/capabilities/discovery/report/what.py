"""The second picture: which effects explain it, how large they are, and what cannot be told from them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import plotly.graph_objects as go

from scaling_service.capabilities.discovery.document import DiscoveryDocument, EffectDocument, PlacedEffect
from scaling_service.capabilities.discovery.report.data import DiscoveryData
from scaling_service.capabilities.discovery.report.style import (
    AFTER,
    OTHER,
    chance,
    digits,
    interval,
    placed,
    value,
)
from scaling_service.report.blocks import Block, Bullets, Heading, Row, Table, Text
from scaling_service.report.figures import Figure, chart, plain
from scaling_service.report.methods import INK
from scaling_service.report.page import Section

_TRIED = 10
"""Chosen: of what was not named, as many as stay readable."""

_TWINS = 6
"""Chosen likewise, of those that are not told apart."""

_HAIR = 0.01
"""Per cent: so short is the bar of what takes nothing off; without any length it has no name beside it."""


def what_section(data: DiscoveryData) -> Section:
    """Named effects one by one, then the candidates side by side."""
    return Section("2. What: the effects that explain it", list(_blocks(data)), new_page=True)


def _blocks(data: DiscoveryData) -> Iterator[Block]:
    document = data.document
    if not document.effects:
        yield Text(f"No effect was named: {document.reason}.")
    for number, effect in enumerate(document.effects, start=1):
        yield Heading(f"{number}. {placed(effect)}")
        yield Text(f"{data.meanings[effect.kind].capitalize()}. {_evidence(effect)}")
        yield _numbers(effect)
        yield from _twins(data, effect)
    if document.effects or document.tried:
        yield _candidates(document)
    if document.effects:
        yield Text(f"The search then stopped: {document.reason}.", quiet=True)


def _evidence(effect: EffectDocument) -> str:
    evidence = effect.evidence
    unseen = "blocks of time that did not fit it" if evidence.by_blocks else "recordings that did not fit it"
    gain = "an unknown share" if evidence.gain_held_out is None else f"{evidence.gain_held_out:.0%}"
    return (
        f"It takes {gain} off the squared disagreement of {unseen} (by chance: "
        f"{chance(evidence.p_held_out)}). The chance of naming anything in the whole catalogue where nothing "
        f"is: {chance(evidence.p_family_wise)}."
    )


def _numbers(effect: EffectDocument) -> Table:
    rows = [
        Row(name, [value(quantity), interval(quantity), digits(effect.smallest_nameable.get(name))])
        for name, quantity in effect.parameters.items()
    ]
    return Table(
        "Its numbers",
        ["", "value", "95 % interval", "named from"],
        rows,
        "The unit is in the name. True minus modelled, or measured over true for a factor. Named from: the "
        "size, in the same proportions, that is named nine times in ten.",
    )


def _twins(data: DiscoveryData, effect: EffectDocument) -> Iterator[Block]:
    if not effect.confusable_with:
        return
    yield Text("These recordings do not tell it from:")
    yield Bullets([_twin(data, effect, twin) for twin in effect.confusable_with[:_TWINS]])
    more = len(effect.confusable_with) - _TWINS
    if more > 0:
        yield Text(f"and from {more} more, which are in discovery.json.", quiet=True)
    if effect.would_separate:
        yield Text(f"This would tell them apart: {effect.would_separate}.")


def _twin(data: DiscoveryData, effect: EffectDocument, twin: PlacedEffect) -> str:
    """A twin, with what it is where that is something else."""
    return placed(twin) if twin.kind == effect.kind else f"{placed(twin)}: {data.meanings[twin.kind]}"


def _candidates(document: DiscoveryDocument) -> Figure:
    named = [(placed(e), e.evidence.gain_held_out or 0.0, True) for e in document.effects]
    tried = sorted(((placed(t), t.gain or 0.0, False) for t in document.tried), key=lambda c: -c[1])[:_TRIED]
    bars = [*sorted(named, key=lambda c: -c[1]), *tried][::-1]
    trace = go.Bar(
        x=[max(_HAIR, round(100 * gain, 2)) for _, gain, _ in bars],
        y=[f"{len(bars) - k}." for k in range(len(bars))],
        text=[plain(_short(name)) for name, _, _ in bars], textposition="auto", insidetextanchor="start",
        insidetextfont={"color": ["#ffffff" if found else INK for _, _, found in bars]},
        textangle=0, constraintext="none", cliponaxis=False, orientation="h",
        marker={"color": [AFTER if found else OTHER for _, _, found in bars]},
        customdata=[f"{plain(name)}: {digits(100 * gain)} %" for name, gain, _ in bars],
        hovertemplate="%{customdata}<extra></extra>",
    )  # fmt: skip
    figure = chart(
        [trace], x_title="share of the squared disagreement taken off what did not fit it, %",
        hovermode="closest", bargap=0.25, margin={"l": 34, "r": 12, "t": 6, "b": 40},
        yaxis_type="category",
    )  # fmt: skip
    return Figure(
        figure,
        "Candidates: named (blue), each when it was named; and the best of what was not (pink), at the end",
        f"Bars of {len(bars)} candidates: {_listed(named)}.",
        max(150, 70 + 22 * len(bars)),
    )


def _listed(named: Sequence[tuple[str, float, bool]]) -> str:
    return ", ".join(f"{name} {gain:.0%}" for name, gain, _ in named) or "none was named"


def _short(text: str, most: int = 60) -> str:
    return text if len(text) <= most else f"{text[: most - 1]}…"
