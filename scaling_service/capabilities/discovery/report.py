"""The report of a search as a story: where, what, after, on unseen data."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from scaling_service.capabilities.discovery import text
from scaling_service.capabilities.discovery.document import (
    DisagreementDocument,
    DiscoveryDocument,
    EffectDocument,
    GapDocument,
    LevelDocument,
    PlacedEffect,
)
from scaling_service.capabilities.discovery.figures import (
    HeatMap,
    draw_candidates,
    draw_gap,
    draw_heat_maps,
    draw_largest_change,
    draw_ranking,
    make_heat_maps,
)
from scaling_service.capabilities.discovery.numbers import format_chance, format_figures, format_interval
from scaling_service.capabilities.discovery.result import DiscoverResults
from scaling_service.capabilities.discovery.text import describe_place
from scaling_service.core.text import list_few
from scaling_service.report.blocks import (
    Block,
    Bullets,
    Callout,
    Cell,
    Grid,
    Heading,
    Page,
    Row,
    Section,
    Table,
    Text,
    Tone,
)
from scaling_service.report.provenance import build_input_blocks, repair_blocks
from scaling_service.report.scene import Scene

_TONES: dict[str, Tone] = {"found": "good", "nothing": "plain", "unexplained": "fair"}
_OBSERVABLES = (("marker", "Markers", "mm"), ("force", "Ground force", "N"), ("moment", "Moment", "N m"))
_MOST_PLACES, _MOST_ALIKE = 12, 6
"""Places in a table, effects that cannot be told apart (chosen); discovery.json has all."""


def build_discovery_page(results: DiscoverResults, document: DiscoveryDocument) -> Page:
    """The page of one search; ``document`` is what is written as ``discovery.json``."""
    maps = list(make_heat_maps(results))
    scene = draw_largest_change(results) if document.effects else None
    held = f"; held out: {', '.join(document.held_out_trials)}" if document.held_out_trials else ""
    hidden, bones = text.describe_hidden(document), list(text.describe_bones(document))
    return Page(
        f"What is missing in the model of {document.subject}",
        [
            Section("Verdict", list(_build_verdict(document))),
            Section("1. Where: model and recordings before", list(_build_where(document, maps))),
            Section("2. What: the effects that explain it", list(_build_what(document)), new_page=True),
            Section(
                "3. After: with what was named", list(_build_after(document, maps, scene)), new_page=True
            ),
            *([Section("Bones under the skin", [Bullets(bones)])] if bones else []),
            Section("4. On unseen data", list(_build_unseen(document)), new_page=True),
            *([Section("What had been hidden in this virtual person", [Bullets(hidden)])] if hidden else []),
            Section("Where it comes from", list(_build_provenance(document))),
        ],
        subtitle=f"Search from the {text.describe_model(document)}. "
        f"Fitted: {', '.join(document.fitted_trials)}{held}",
        footer=f"scaling-service {document.code_version}. The numbers are in discovery.json, too.",
    )


def _build_verdict(document: DiscoveryDocument) -> Iterator[Block]:
    main = document.effects
    single = [effect for effect in main if not text.is_class_named(effect)]
    blocks: list[Block] = [Bullets([_write_sentence(effect) for effect in main], numbered=True)]
    cautions, classes = text.list_cautions(main), list(text.describe_classes(single))
    if cautions:
        blocks.append(Callout("Sizes to doubt", [Bullets(cautions)], "fair"))
    if classes:
        blocks.append(Bullets(classes))
    if document.unexplained:
        left = list_few([place for u in document.unexplained for place in u.where])
        blocks.append(Text(f"Still beyond what is ordinary, and like no effect that is known: {left}."))
        if document.verdict == "unexplained":
            blocks.append(Text(f"Described best: {document.unexplained[0].law}."))
    yield Callout(document.headline, blocks, _TONES[document.verdict])
    if document.effects:
        yield text.tabulate_effects(document)
    if document.notes:
        yield Heading("What was not tried, or cannot be decided")
        yield Bullets(document.notes)


def _write_sentence(effect: EffectDocument) -> str:
    return f"{effect.name} ({effect.belief.summary})" if effect.belief else effect.name


def _build_provenance(document: DiscoveryDocument) -> Iterator[Block]:
    yield Text(f"The search took {document.wall_s:.1f} s and stopped: {document.reason}.")
    yield from repair_blocks(document)
    yield from build_input_blocks(document)


# 1. Where


def _build_where(document: DiscoveryDocument, maps: Sequence[HeatMap]) -> Iterator[Block]:
    places = document.disagreements
    yield Text(
        "The model follows every recording as closely as it can. What is left over is compared with the "
        "ordinary: what the noise of the recording itself would leave. Places whose bar ends at the mark "
        "are explained."
    )
    for observable, title, unit in _OBSERVABLES:
        chosen = [p for p in places if p.observable == observable]
        if chosen:
            yield draw_ranking(chosen, title, unit)
    if places:
        yield _tabulate_places(places)
    yield from draw_heat_maps(maps, "before")


def _tabulate_places(places: Sequence[DisagreementDocument]) -> Table:
    rows = [
        Row(
            p.where,
            [
                f"{format_figures(p.rms)} {p.unit}",
                f"{format_figures(p.floor)} {p.unit}",
                _share(p.share),
                format_chance(p.p),
                p.when or "–",
                p.along or "–",
            ],
        )
        for p in places[:_MOST_PLACES]
    ]
    left_out = len(places) > _MOST_PLACES
    more = f" The first {len(rows)} of {len(places)}; the others are in discovery.json." if left_out else ""
    return Table(
        caption="Where, when, and along with what",
        columns=["place", "left over", "ordinary", "share", "by chance", "most", "follows"],
        rows=rows,
        note=f"Share: of all that stands above the ordinarys. By chance: p over all places looked at.{more}",
    )


def _share(value: float | None) -> Cell:
    return Cell("–" if value is None else f"{value:.0%}", shade=None if value is None else max(value, 0.0))


# 2. What


def _build_what(document: DiscoveryDocument) -> Iterator[Block]:
    if not document.effects:
        yield Text(f"No effect was named: {document.reason}.")
    for number, effect in enumerate(document.effects, start=1):
        yield Heading(f"{number}. {describe_place(effect)}")
        yield from _build_chapter(effect)
    if document.effects or document.tried:
        yield draw_candidates(document)
    if document.effects:
        yield Text(f"The search then stopped: {document.reason}.", quiet=True)


def _build_chapter(effect: EffectDocument) -> Iterator[Block]:
    yield Text(f"{text.describe_meaning(effect.kind).capitalize()}. {effect.evidence.summary}")
    if effect.belief is not None:
        yield Text(f"How sure: {effect.belief.summary}.")
    yield _tabulate_numbers(effect)
    yield from _build_alike(effect)


def _tabulate_numbers(effect: EffectDocument) -> Table:
    rows = []
    for name, quantity in effect.parameters.items():
        value = quantity.value
        said = ", ".join(f"{v:.2f}" for v in value) if isinstance(value, tuple) else format_figures(value)
        smallest = format_figures(effect.smallest_nameable.get(name))
        usual = "–" if quantity.usual is None else " to ".join(map(format_figures, quantity.usual))
        shown = Cell(said, tone="fair" if quantity.implausible or quantity.at_bound else "plain")
        rows.append(Row(name, [shown, format_interval(quantity), usual, smallest]))
    return Table(
        caption="Its numbers",
        columns=["", "value", "95 % interval", "met", "named from"],
        rows=rows,
        note="The unit is in the name. True minus modelled, or measured over true for a factor. Met: in "
        "laboratories. Named from: the size, in the same proportions, that is named nine times in ten.",
    )


def _build_alike(effect: EffectDocument) -> Iterator[Block]:
    """Its equivalence class, and what would separate it."""
    if not effect.confusable_with:
        return

    def describe(other: PlacedEffect) -> str:
        return (
            describe_place(other)
            if other.kind == effect.kind
            else f"{describe_place(other)}: {text.describe_meaning(other.kind)}"
        )

    yield Text("These recordings do not tell it from:")
    yield Bullets([describe(other) for other in effect.confusable_with[:_MOST_ALIKE]])
    more = len(effect.confusable_with) - _MOST_ALIKE
    if more > 0:
        yield Text(f"and from {more} more, which are in discovery.json.", quiet=True)
    if effect.would_separate:
        yield Text(f"This would tell them apart: {effect.would_separate}.")


# 3. After


def _build_after(
    document: DiscoveryDocument, maps: Sequence[HeatMap], scene: Scene | None
) -> Iterator[Block]:
    if not document.effects:
        yield Text("Nothing was named, so nothing changed: the picture is the one before.")
    else:
        yield Text("The same places and times in the same colours as before.")
        yield from draw_heat_maps(maps, "after")
    if scene is not None:
        yield Heading("Without and with it, in space")
        yield Text(
            "Black dots are the measured markers, labels back in place where they were exchanged. Rings are "
            "the model's markers, dots its joint centres, dashed lines its knee axes. Drag to turn."
        )
        yield scene
    yield Heading("What is left")
    if document.unexplained:
        yield text.tabulate_unexplained(document, len(document.unexplained))
    else:
        yield Text("Nothing that is left stands clearly above the ordinary.")


# 4. On unseen data


def _build_unseen(document: DiscoveryDocument) -> Iterator[Block]:
    unseen = (
        f"The right half of each picture shows recordings that fitted nothing: "
        f"{', '.join(document.held_out_trials)}."
        if document.held_out_trials
        else "No recording was held out: effects had to prove themselves on blocks of time that did not fit "
        "them, and the picture shows the recordings that were fitted."
    )
    yield Text(
        f"What fits the recordings that it was fitted to is no proof. {unseen} Black-box bound: what a "
        "correction with as many numbers reaches, which knows nothing of bodies."
    )
    gaps = text.list_gaps(document)
    held_out = document.gap.held_out
    yield Grid([draw_gap(gaps, *of) for of in text.LEVELS if getattr(held_out, of[0]) is not None])
    yield text.tabulate_gaps(document)
    yield _tabulate_levels(gaps)


def _tabulate_levels(gaps: Mapping[str, GapDocument]) -> Table:
    """Place by place; the gap closed is what of before minus floor is gone."""
    last = list(gaps.values())[-1].places
    order = sorted(last, key=lambda name: -(last[name].before or 0.0) / (last[name].floor or 1.0))
    rows = [
        Row(
            f"{name}, {last[name].unit}",
            [c for g in gaps.values() for c in _format_cells(g.places.get(name))],
        )
        for name in order
    ]
    names = ("before", "after", "ordinary", "closed")
    return Table(
        caption=f"Place by place: {', then '.join(gaps)}",
        columns=[
            "place",
            *(f"{role}: {name}" if name == "before" else name for role in gaps for name in names),
        ],
        rows=rows,
        note="Closed: the share of what stood above the ordinary that is gone; none where "
        "hardly anything did.",
    )


def _format_cells(level: LevelDocument | None) -> list[str | Cell]:
    if level is None:
        return ["–"] * 4
    return [
        format_figures(level.before),
        format_figures(level.after),
        format_figures(level.floor),
        _share(_compute_closed_share(level)),
    ]


def _compute_closed_share(level: LevelDocument) -> float | None:
    if level.before is None or level.after is None or level.floor is None:
        return None
    room = level.before - level.floor
    return (level.before - level.after) / room if room > 0.2 * level.floor else None
