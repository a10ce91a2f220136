"""What is said of a search, once for the terminal, the report and the page: sentences, numbers, tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from scaling_service.capabilities.discovery.document import (
    DiscoveryDocument,
    EffectDocument,
    GapDocument,
    LevelDocument,
    PlacedEffect,
    QuantityDocument,
    UnexplainedDocument,
)
from scaling_service.capabilities.discovery.effects.catalogue import find_effects
from scaling_service.capabilities.discovery.effects.sizes import cite_source_of_sizes
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Reweighed
from scaling_service.capabilities.discovery.numbers import (
    format_chance,
    format_figures,
    format_percent,
    format_quantity,
)
from scaling_service.capabilities.discovery.search.findings import NamedEffect, turn_into_probability
from scaling_service.core.text import list_few
from scaling_service.documents.base import Tone
from scaling_service.report.tables import Cell, Row, Table
from scaling_service.report.words import spell_name

LEVELS = (
    ("whitened", "all together", "times what is ordinary"),
    ("markers_mm", "markers", "mm"),
    ("force_N", "ground force", "N"),
    ("moment_Nm", "ground moment", "N m"),
)
"""Fields of a gap, what each is of, and its unit."""

_LITTLE = 0.5  # chosen: share of the gap above the noise that effects must explain to be the whole headline
_MOST_NUMBERS, _MOST_ALIKE = 4, 3  # chosen: as many as fit a screen; discovery.json has all
_TOLD_ALONE = 0.3
"""Probability within its class from which an effect stands by itself (chosen: below it there are more than
three as good, for no other member is likelier)."""


def describe_meaning(kind: str) -> str:
    """What an effect is, in a sentence without its place."""
    return find_effects()[kind].meaning


# Sentences


def describe_effect(
    kind: str,
    where: tuple[str, ...],
    driver: tuple[str, ...],
    trials: tuple[str, ...],
    parameters: Mapping[str, QuantityDocument],
) -> str:
    """An effect for people: place, meaning, size.

    Examples
    --------
    >>> gain = {"factor": QuantityDocument(value=1.02, sd=0.001)}
    >>> describe_effect("plate_gain", ("plate_1",), (), (), gain)
    'plate_1: the plate measures a multiple of the true force: factor 1.02'
    """
    following = f", here {list_few([spell_name(d) for d in driver])}" if driver else ""
    only = f", in {list_few(trials)} only" if trials else ""
    sizes = ", ".join(format_quantity(name, quantity) for name, quantity in parameters.items())
    return f"{list_few(where)}: {describe_meaning(kind)}{following}{only}" + (f": {sizes}" if sizes else "")


def describe_class(first: PlacedEffect, others: Sequence[PlacedEffect], would_separate: str) -> str:
    """Effects of which one is there, and these recordings do not tell which.

    Examples
    --------
    >>> skin, hip = (PlacedEffect(kind="plate_gain", where=[where]) for where in ("plate_1", "plate_2"))
    >>> describe_class(skin, [hip], "quiet standing")
    'one of 2 not told apart here: plate gain at plate_1; plate gain at plate_2. To separate: quiet standing'
    """
    shown = [describe_place(each) for each in (first, *others)][:_MOST_ALIKE]
    left = 1 + len(others) - len(shown)
    more = f" and {left} more" if left else ""
    apart = f". To separate: {would_separate}" if would_separate else ""
    return f"one of {1 + len(others)} not told apart here: {'; '.join(shown)}{more}{apart}"


def is_class(member: float) -> bool:
    """Whether an effect of this probability within its class stands for all of it."""
    return member < _TOLD_ALONE


def is_class_named(effect: EffectDocument) -> bool:
    """Whether an effect stands for its class, and not for itself."""
    return effect.belief is not None and is_class(effect.belief.member)


def describe_place(effect: PlacedEffect) -> str:
    """An effect in a line: what, where, along with what, in which recording.

    Examples
    --------
    >>> describe_place(PlacedEffect(kind="plate_gain", where=["plate_1"]))
    'plate gain at plate_1'
    """
    following = f" with {', '.join(effect.driver)}" if effect.driver else ""
    only = f" in {', '.join(effect.trials)}" if effect.trials else ""
    said = f" ({effect.note})" if effect.note else ""
    return f"{effect.kind.replace('_', ' ')} at {', '.join(effect.where)}{following}{only}{said}"


def describe_model(document: DiscoveryDocument) -> str:
    """Which model the search started from."""
    return "model as given" if document.start == "none" else f"model scaled by {document.start}"


def write_headline(
    verdict: str,
    effects: Sequence[EffectDocument],
    level: LevelDocument | None,
    left: Sequence[UnexplainedDocument],
    *,
    held_out: bool,
) -> str:
    """The verdict in one sentence.

    ``level``: of all together, on what was held out if anything was. ``left``: what no effect explains, the
    largest first.
    """
    unseen = "held-out recordings" if held_out else "the recordings (none was held out)"
    if verdict == "nothing":
        tracked = (
            f": {unseen} are tracked to {format_figures(level.after)} times what is ordinary" if level else ""
        )
        return f"Ordinary for people; nothing stands out{tracked}"
    if verdict == "unexplained":
        return "Something stands out of what is ordinary for people, and nothing in the catalogue explains it"
    count = _count_places(effects)
    things = "One missing effect was" if count == 1 else f"{count} missing effects were"
    doubtful = _count_places(e for e in effects if has_doubtful_size(e))
    classes = _count_places(e for e in effects if is_class_named(e))
    whose = ("", "") if count == 1 else (f"{classes} of them ", f"{doubtful} of them ")
    doubt = f", {whose[0]}named only as a class of effects" if classes else ""
    doubt += f", {whose[1]}of a size to doubt" if doubtful else ""
    if level is None:
        return f"{things} found{doubt}"
    told = f"{_describe_fall(level)}{_describe_most_left(level, left)}"
    return f"{things} found{doubt}; the gap on {unseen} {told}"


def describe_worse(gap: GapDocument) -> str:
    """What the named effects made worse on what was held out, by an interval that lies above what was before.

    Empty where nothing was.
    """
    worse = [
        f"the {name} from {format_figures(level.before)} to {format_figures(level.after)} {unit}"
        for field, name, unit in LEVELS[1:]
        if (level := getattr(gap, field)) is not None and _is_worse(level)
    ]
    return f". Worse than before: {', '.join(worse)}" if worse else ""


def _is_worse(level: LevelDocument) -> bool:
    before, after, low = level.before or 0.0, level.after or 0.0, level.low
    return after > before and low is not None and low > before


def choose_tone(verdict: str, effects: Sequence[EffectDocument], worse: str) -> Tone:
    """Whether a headline is good news, as nothing is: not where a size is to doubt or something got worse."""
    if verdict == "nothing":
        return "good"
    doubtful = worse or any(has_doubtful_size(effect) for effect in effects)
    return "good" if verdict == "found" and not doubtful else "fair"


def _count_places(effects: Iterable[EffectDocument]) -> int:
    """How many there are; the same in several recordings is one."""
    return len({(e.kind, *e.where) for e in effects})


def _describe_fall(level: LevelDocument) -> str:
    """How far the gap falls, where its interval says that it does."""
    before, after = level.before or 0.0, level.after or 0.0
    if after < before and (level.high or 0.0) < before:
        return f"falls from {format_figures(before)} to {format_figures(after)} times what is ordinary"
    return f"is {format_figures(after)} times what is ordinary, as without, {format_figures(before)}"


def _describe_most_left(level: LevelDocument, left: Sequence[UnexplainedDocument]) -> str:
    """Where effects explain little of what stands above the noise: that, and where most of it is left."""
    if level.before is None or level.after is None or not left:
        return ""
    above, taken = level.before**2 - 1.0, level.before**2 - level.after**2
    if taken >= _LITTLE * above:
        return ""
    most = left[0]
    size = f"{format_figures(most.rms)} {most.unit}"
    return f". Most of it is left unexplained, above all at {list_few(most.where)} ({size})"


def describe_belief(effect: float, member: float, sign: float | None, size: float | None) -> str:
    """How far an effect may be believed: that it is there, of its class this one, its sign and size.

    Examples
    --------
    >>> describe_belief(0.9999, 0.5, 0.98, 0.01)
    'not ordinary: > 99 %; this one of its class: 50 %; its sign: 98 %; a size that laboratories meet: 1 %'
    """
    beliefs = (
        ("not ordinary", effect),
        ("this one of its class", member if member < 1.0 else None),
        ("its sign", sign),
        ("a size that laboratories meet", size),
    )
    return "; ".join(f"{what}: {format_percent(value)}" for what, value in beliefs if value is not None)


def describe_cautions(candidate: Candidate, parameters: Mapping[str, QuantityDocument]) -> Iterator[str]:
    """Numbers of an effect that are implausible."""
    for name, quantity in parameters.items():
        if quantity.usual is not None and quantity.implausible:
            said = f"{list_few(candidate.where)}: {format_quantity(name, quantity)}"
            met = " to ".join(map(format_figures, quantity.usual))
            yield f"{said} is implausible: {met} is met ({cite_source_of_sizes(candidate.kind)})"


def list_beliefs(effects: Sequence[EffectDocument]) -> list[str]:
    """How far each effect may be believed."""
    return [f"{describe_place(e)}: {e.belief.summary}" for e in effects if e.belief is not None]


def list_cautions(effects: Sequence[EffectDocument]) -> list[str]:
    """All cautions about the sizes of effects."""
    return [said for e in effects if e.belief is not None for said in e.belief.cautions]


def has_doubtful_size(effect: EffectDocument) -> bool:
    """Whether a number of an effect is implausible."""
    return effect.belief is not None and bool(effect.belief.cautions)


def describe_evidence(named: NamedEffect) -> str:
    """What speaks for an effect."""
    chance = format_chance(1.0 - turn_into_probability(named.odds))
    ordinary = f"The chance that it is what is ordinary for people: {chance}."
    if isinstance(named.candidate.change, Reweighed):
        said = "The momentum balance of all recordings with forces says so; none was held out from it."
        return f"{said} {ordinary}"
    unseen = "the recordings (none was held out)" if named.by_blocks else "recordings that did not fit it"
    return f"It takes {named.gain:.0%} off the squared disagreement of {unseen}. {ordinary}"


def describe_classes(effects: Sequence[EffectDocument]) -> Iterator[str]:
    """Which effects these recordings do not tell from others, and what would."""
    for effect in effects:
        if is_class_named(effect):
            yield effect.name
        elif effect.confusable_with:
            others = [describe_place(other) for other in effect.confusable_with]
            more = f" and {len(others) - _MOST_ALIKE} more" if len(others) > _MOST_ALIKE else ""
            apart = f". To separate: {effect.would_separate}" if effect.would_separate else ""
            alike = "; ".join(others[:_MOST_ALIKE])
            yield f"{describe_place(effect)} cannot be told here from {alike}{more}{apart}"


def describe_bones(document: DiscoveryDocument) -> Iterator[str]:
    """What the model has of bones beside the effects, and what these recordings do not show of them."""
    known = document.bones
    if known is None:
        return
    for expected in known.expectations:
        follows = (
            f", following {list_few([spell_name(f) for f in expected.follows])}" if expected.follows else ""
        )
        yield (
            f"{spell_name(expected.coordinate)} is expected about the posture in which the "
            f"markers were placed{follows}, ± {format_figures(expected.sd_deg, 2)} deg ({expected.source})"
        )
    if known.skin_mm:
        least, most = min(known.skin_mm.values()), max(known.skin_mm.values())
        yield (
            f"Skin slides over the knee's bones as other people's does: {list_few(list(known.skin_mm))} by "
            f"{format_figures(least, 2)} to {format_figures(most, 2)} mm where the knee flexes by 60 deg"
        )
    if known.left_out:
        yield (
            f"Named but left out of model.json: {list_few(known.left_out)}. More moves the same markers, "
            f"so these recordings do not show where it takes the bones"
        )


def describe_hidden(document: DiscoveryDocument) -> list[str]:
    """What a search of a virtual person should have found."""
    return [
        f"{describe_place(h)}: {', '.join(f'{name} {value:.3g}' for name, value in h.parameters.items())}"
        for h in document.hidden or ()
    ]


# Tables


def tabulate_effects(document: DiscoveryDocument) -> Table:
    """Effect, where, size, and the gap of its places on what was not fitted."""
    unseen = "held-out gap" if document.held_out_trials else "gap"
    rows: list[Row] = []
    for effect in document.effects:
        following = f"\nwith {', '.join(effect.driver)}" if effect.driver else ""
        only = f"\nin {', '.join(effect.trials)} only" if effect.trials else ""
        sizes = [format_quantity(name, quantity, spread=True) for name, quantity in effect.parameters.items()]
        more = [f"and {len(sizes) - _MOST_NUMBERS} more"] if len(sizes) > _MOST_NUMBERS else []
        levels = document.gap.held_out.places
        gaps = [
            f"{name} {format_figures(level.before)} → {format_figures(level.after)} "
            f"({format_figures(level.floor)}) {level.unit}"
            for name, level in ((name, levels[name]) for name in effect.where if name in levels)
        ]
        size = "\n".join([*sizes[:_MOST_NUMBERS], *more])
        shown = Cell(size, tone="fair" if has_doubtful_size(effect) else "plain")
        cells: list[str | Cell] = [", ".join(effect.where) + following + only, shown, "\n".join(gaps)]
        others = "\nor another of its class" if is_class_named(effect) else ""
        rows.append(Row(effect.kind.replace("_", " ") + others, cells))
    columns = ["effect", "where", "size ± sd", f"{unseen}: before → after (ordinary)"]
    return Table(caption="The missing effects", columns=columns, rows=rows, words=True)


def list_gaps(document: DiscoveryDocument) -> dict[str, GapDocument]:
    """Role of recordings to their gap; one only where none was held out."""
    found = {"used to fit": document.gap.fit}
    return found | ({"held out": document.gap.held_out} if document.held_out_trials else {})


def tabulate_gaps(document: DiscoveryDocument) -> Table:
    """All of one kind together, before and after, beside what is ordinary."""
    rows = [
        Row(
            f"{role}: {name}, {unit}",
            [format_figures(v) for v in (level.before, level.after, level.floor, level.ceiling)],
        )
        for role, gap in list_gaps(document).items()
        for field, name, unit in LEVELS
        if (level := getattr(gap, field)) is not None
    ]
    return Table(
        caption="The gap, RMS",
        columns=["", "before", "after", "ordinary", "left by all that is ordinary"],
        rows=rows,
    )


def tabulate_unexplained(document: DiscoveryDocument, most: int) -> Table:
    """What is left beyond what is ordinary, the first places with the law that describes each."""
    rows = [
        Row(
            ", ".join(u.where),
            [f"{format_figures(u.rms)} {u.unit}", f"{format_figures(u.floor)} {u.unit}", u.law],
        )
        for u in document.unexplained[:most]
    ]
    more = len(document.unexplained) - most
    return Table(
        caption="Beyond what is ordinary, and like no effect of the catalogue",
        columns=["place", "left over", "ordinary", "the simplest law that describes it"],
        rows=rows,
        note=f"And {more} more places, which are in discovery.json." if more > 0 else "",
        words=True,
    )
