"""What is said of a search, once for the terminal, the report and the page: sentences, numbers, tables."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Literal

from scaling_service.capabilities.discovery import result as documents
from scaling_service.capabilities.discovery.effects.catalogue import find_effects
from scaling_service.capabilities.discovery.laws.candidates import Candidate
from scaling_service.core.names import say_name, say_names, say_place
from scaling_service.core.text import format_p, list_few
from scaling_service.documents.base import Tone
from scaling_service.report.summary import Summary
from scaling_service.report.tables import Cell, Row, Table

LEVELS = (
    ("whitened", "all together", "times what is ordinary"),
    ("markers_mm", "markers", "mm"),
    ("force_N", "ground force", "N"),
    ("moment_Nm", "ground moment", "N m"),
)
"""Fields of a gap, what each is of, and its unit."""

MOST_LINES = 3  # effects that are told in a line each (chosen: as many as are read in a minute)
Course = Literal["falls", "rises", "stays", "unclear"]
"""What a gap does, on what was held out if anything was."""

NOTHING = 0.005  # of the squared gap: less is written as 0 %, and stands in no headline
_LITTLE = 0.5  # chosen: share of the gap above the noise that effects must explain to be the whole headline
_MOST_NUMBERS, _MOST_ALIKE, _MOST_LEFT = 4, 3, 12  # chosen: as many as fit a screen; discovery.json has all
TOLD_ALONE = 0.3
"""Probability within its class from which an effect stands by itself (chosen: below it there are more than
three as good, for no other member is likelier)."""

_WHOLE = ("world", "markers", "forces")  # places of what concerns a recording as a whole
_SUFFIXES = {
    "_mm_per_deg": " mm/deg",
    "_deg_per_deg": " deg/deg",
    "_kgmm": " kg mm",
    "_mm": " mm",
    "_deg": " deg",
    "_Nm": " N m",
    "_N": " N",
    "_hz": " Hz",
    "_s": " s",
}


# Numbers


def format_figures(value: float | None, count: int = 3) -> str:
    """A number to some figures, a dash where there is none.

    Examples
    --------
    >>> format_figures(0.020134), format_figures(None), format_figures(1234.5)
    ('0.0201', '–', '1.23e+03')
    """
    return "–" if value is None else f"{value:.{count}g}"


def format_percent(probability: float) -> str:
    """A probability as shown.

    Examples
    --------
    >>> format_percent(0.4), format_percent(0.9999), format_percent(1e-9)
    ('40 %', '> 99 %', '< 1 %')
    """
    return "> 99 %" if probability > 0.99 else "< 1 %" if probability < 0.01 else f"{100 * probability:.0f} %"


def format_quantity(name: str, quantity: documents.QuantityDocument, *, spread: bool = False) -> str:
    """A number of an effect with its unit, and its standard deviation where asked for.

    Examples
    --------
    >>> format_quantity("x_mm_per_deg", documents.QuantityDocument(value=0.2013, sd=0.011), spread=True)
    'x 0.201 ± 0.011 mm/deg'
    >>> format_quantity("delay_s", documents.QuantityDocument(value=0.02, sd=None))
    'delay 0.02 s'
    """
    suffix = next((s for s in _SUFFIXES if name.endswith(s)), "")
    stem, unit = name.removesuffix(suffix).replace("_", " "), _SUFFIXES.get(suffix, "")
    if name == "kg":
        stem, unit = "", " kg"
    if isinstance(quantity.value, tuple):
        return f"{stem} ({', '.join(f'{v:.2f}' for v in quantity.value)}){unit}"
    if not quantity.determined:
        return f"{stem} not determined".strip()
    sd = quantity.sd if spread else None
    if sd is None or sd <= 0.0:
        return f"{stem} {quantity.value:.3g}{unit}".strip()
    digits = max(0, 1 - math.floor(math.log10(sd)))
    return f"{stem} {quantity.value:.{digits}f} ± {sd:.{digits}f}{unit}".strip()


# An effect


def describe_effect(
    kind: str,
    where: Sequence[str],
    driver: Sequence[str],
    trials: Sequence[str],
    parameters: Mapping[str, documents.QuantityDocument],
    *,
    spread: bool = False,
) -> str:
    """An effect for people: place, meaning, size (with its deviation where asked for).

    Examples
    --------
    >>> gain = {"factor": documents.QuantityDocument(value=1.02, sd=0.001)}
    >>> describe_effect("plate_gain", ("plate_1",), (), (), gain)
    'plate 1: the plate measures a multiple of the true force: factor 1.02'
    >>> describe_effect("body_mass", ("world",), (), (), {})
    'the person is heavier or lighter than declared'
    """
    place = f"{places}: " if (places := list_places(where)) else ""
    following = f", here {say_names(driver)}" if driver else ""
    only = f", in {list_few(trials)} only" if trials else ""
    sizes = ", ".join(format_quantity(name, q, spread=spread) for name, q in parameters.items())
    meaning = find_effects()[kind].meaning
    return f"{place}{meaning}{following}{only}" + (f": {sizes}" if sizes else "")


def list_places(where: Sequence[str]) -> str:
    """Where something is, for people; empty of what concerns the whole recording."""
    return list_few([say_place(name) for name in where if name not in _WHOLE])


def describe_place(effect: documents.PlacedEffect | Candidate) -> str:
    """An effect in a line: what, where, along with what, in which recording.

    Examples
    --------
    >>> describe_place(documents.PlacedEffect(kind="plate_gain", where=["plate_1"]))
    'plate gain at plate 1'
    """
    at = f" at {places}" if (places := list_places(effect.where)) else ""
    following = f" with {', '.join(map(say_name, effect.driver))}" if effect.driver else ""
    only = f" in {', '.join(effect.trials)}" if effect.trials else ""
    said = f" ({effect.note})" if effect.note else ""
    return f"{effect.kind.replace('_', ' ')}{at}{following}{only}{said}"


def describe_class(every: Sequence[documents.PlacedEffect]) -> str:
    """Effects of which one is there, and these recordings do not tell which.

    Examples
    --------
    >>> describe_class([documents.PlacedEffect(kind="plate_gain", where=[f"plate_{k}"]) for k in (1, 2)])
    'one of 2 not told apart here: plate gain at plate 1; plate gain at plate 2'
    """
    return f"one of {len(every)} not told apart here: {_list_alike(every)}"


def _list_alike(every: Sequence[documents.PlacedEffect]) -> str:
    more = f" and {len(every) - _MOST_ALIKE} more" if len(every) > _MOST_ALIKE else ""
    return "; ".join(map(describe_place, every[:_MOST_ALIKE])) + more


def is_class(effect: documents.EffectDocument) -> bool:
    """Whether an effect stands for its class, and not for itself."""
    return effect.belief is not None and effect.belief.member < TOLD_ALONE


def describe_share(effect: documents.EffectDocument) -> str:
    """How much of what did not fit it an effect takes off; empty where it takes nothing."""
    gain = effect.evidence.gain_held_out
    if gain is None or gain <= 0.0:
        return ""
    return f"takes {format_percent(gain)} off the squared gap of what did not fit it"


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


def describe_evidence(gain: float, chance: float, *, by_blocks: bool, by_weight: bool) -> str:
    """What speaks for an effect; ``by_weight``: of the whole body's mass, which the plates bear."""
    unseen = "the recordings (none was held out)" if by_blocks else "recordings that did not fit it"
    said = f"It takes {gain:.0%} off the squared disagreement of {unseen}."
    if by_weight:
        said = "The momentum balance of all recordings with forces says so; none was held out from it."
    return f"{said} The chance that it is what is ordinary for people: {format_p(chance)}."


def list_told(effects: Sequence[documents.EffectDocument]) -> list[documents.EffectDocument]:
    """Those that are told in a line each: the first few of the headline's."""
    return [e for e in effects if e.carries][:MOST_LINES]


def list_cautions(effects: Sequence[documents.EffectDocument]) -> list[str]:
    """All cautions about the sizes of effects."""
    return [said for e in effects if e.belief is not None for said in e.belief.cautions]


def describe_alike(effects: Sequence[documents.EffectDocument]) -> Iterator[str]:
    """Which effects these recordings do not tell from others, and what would."""
    for effect in effects:
        if effect.confusable_with or is_class(effect):
            apart = f". To separate: {effect.would_separate}" if effect.would_separate else ""
            told = f"{describe_place(effect)} cannot be told here from {_list_alike(effect.confusable_with)}"
            yield f"{effect.name if is_class(effect) else told}{apart}"


# The whole search


def describe_model(document: documents.DiscoveryDocument) -> str:
    """Which model the search started from."""
    return "model as given" if document.start == "none" else f"model scaled by {document.start}"


def judge_gap(level: documents.LevelDocument) -> Course:
    """What a gap does with the named effects, as far as its own interval allows to say so.

    Examples
    --------
    >>> judge_gap(documents.LevelDocument(before=2.5, after=1.1, floor=1, ceiling=1, low=0.9, high=1.4))
    'falls'
    >>> judge_gap(documents.LevelDocument(before=2.5, after=2.2, floor=1, ceiling=1, low=1.8, high=2.7))
    'unclear'
    """
    before, after = level.before or 0.0, level.after or 0.0
    if after < before and (level.high or 0.0) < before:
        return "falls"
    if (level.low or 0.0) > before:
        return "rises"
    return "stays" if format_figures(after) == format_figures(before) else "unclear"


def write_headline(
    verdict: str,
    effects: Sequence[documents.EffectDocument],
    level: documents.LevelDocument | None,
    left: Sequence[documents.UnexplainedDocument],
    *,
    held_out: bool,
) -> str:
    """The verdict in one sentence.

    ``level``: of all together, on what was held out if anything was. ``left``: what no effect explains, the
    largest first.
    """
    unseen = "held-out recordings" if held_out else "the recordings (none was held out)"
    if verdict == "nothing":
        said = (
            f": {unseen} are tracked to {format_figures(level.after)} times what is ordinary" if level else ""
        )
        least = f" that takes {100.0 * NOTHING:g} % or more off the squared gap" if effects else ""
        return f"Ordinary for people; nothing{least} stands out{said}"
    if verdict == "unexplained":
        return "Something stands out of what is ordinary for people, and nothing in the catalogue explains it"
    carrying = [e for e in effects if e.carries]
    # The same in several recordings is one.
    count, classes, doubtful = (
        len({(e.kind, *e.where) for e in some})
        for some in (carrying, filter(is_class, carrying), [e for e in carrying if list_cautions([e])])
    )
    said = "One missing effect was found" if count == 1 else f"{count} missing effects were found"
    for some, doubt in ((classes, "named only as a class of effects"), (doubtful, "of a size to doubt")):
        said += f", {f'{some} of them ' if count > 1 else ''}{doubt}" if some else ""
    if level is None:
        return said
    before, after = level.before or 0.0, level.after or 0.0
    now, without = format_figures(after), format_figures(before)
    ordinary = "times what is ordinary"
    told = {
        "falls": f"falls from {without} to {now} {ordinary}",
        "rises": f"rises from {without} to {now} {ordinary}",
        "stays": f"stays at {now} {ordinary}",
        "unclear": f"is {now} {ordinary}, {without} without, which is no clear change",
    }[judge_gap(level)]
    if left and before**2 - after**2 < _LITTLE * (before**2 - 1.0):
        most = (
            f"{list_places(left[0].where) or 'no one place'} ({format_figures(left[0].rms)} {left[0].unit})"
        )
        told += f". Most of it is left unexplained, above all at {most}"
    return f"{said}; the gap on {unseen} {told}"


def describe_worse(gap: documents.GapDocument) -> str:
    """What the named effects made worse on what was held out, by an interval that lies above what was before.

    Empty where nothing was.
    """
    worse = [
        f"the {name} from {format_figures(level.before)} to {format_figures(level.after)} {unit}"
        for field, name, unit in LEVELS[1:]
        if (level := getattr(gap, field)) is not None
        and (level.after or 0.0) > (level.before or 0.0)
        and level.low is not None
        and level.low > (level.before or 0.0)
    ]
    return f". Worse than before: {', '.join(worse)}" if worse else ""


def choose_tone(
    verdict: str,
    effects: Sequence[documents.EffectDocument],
    level: documents.LevelDocument | None,
    worse: str,
) -> Tone:
    """Whether a headline is good news, as nothing is.

    Not where the gap's own interval denies that it falls (``level``: the one that the headline tells of),
    a size is to doubt or something got worse.
    """
    if verdict == "nothing":
        return "good"
    falls = level is None or judge_gap(level) == "falls"
    return "good" if verdict == "found" and falls and not worse and not list_cautions(effects) else "fair"


def describe_left(document: documents.DiscoveryDocument) -> Iterator[str]:
    """What stands out and is no effect that is known."""
    for u in document.unexplained[:MOST_LINES]:
        at = f", at {places}" if (places := list_places(u.where)) else ""
        yield f"Beyond what is ordinary, and no effect that is known{at}: {u.law}."
    if more := document.unexplained[MOST_LINES:]:
        yield f"And at {list_places([place for u in more for place in u.where])}."


def describe_bones(known: documents.BonesDocument) -> Iterator[str]:
    """What the model has of bones beside the effects, and what these recordings do not show of them."""
    for expected in known.expectations:
        names = say_names(expected.follows)
        yield (
            f"{say_name(expected.coordinate)} is expected about the posture in which the markers were "
            f"placed{f', following {names}' if names else ''}, ± {format_figures(expected.sd_deg, 2)} deg "
            f"({expected.source})"
        )
    if known.skin_mm:
        ends = dict.fromkeys(format_figures(f(known.skin_mm.values()), 2) for f in (min, max))
        yield (
            f"Skin slides over the knee's bones as other people's does: {list_few(list(known.skin_mm))} by "
            f"{' to '.join(ends)} mm where the knee flexes by 60 deg"
        )
    if known.left_out:
        yield (
            f"Named but left out of model.json: {list_few(known.left_out)}. More moves the same markers, "
            f"so these recordings do not show where it takes the bones"
        )


def describe_hidden(document: documents.DiscoveryDocument) -> list[str]:
    """What a search of a virtual person should have found."""
    told = []
    for hidden in document.hidden or ():
        numbers = {
            name: documents.QuantityDocument(value=v, sd=None) for name, v in hidden.parameters.items()
        }
        sizes = ", ".join(format_quantity(name, number) for name, number in numbers.items())
        told.append(f"{describe_place(hidden)}: {sizes}")
    return told


# Tables and the report


def tabulate_effects(document: documents.DiscoveryDocument) -> Table:
    """Effect, where, size, and the gap of its places on what was not fitted."""
    unseen = "held-out gap" if document.held_out_trials else "gap"
    rows: list[Row] = []
    for effect in document.effects:
        following = f"\nwith {', '.join(map(say_name, effect.driver))}" if effect.driver else ""
        only = f"\nin {', '.join(effect.trials)} only" if effect.trials else ""
        sizes = [format_quantity(name, quantity, spread=True) for name, quantity in effect.parameters.items()]
        more = [f"and {len(sizes) - _MOST_NUMBERS} more"] if len(sizes) > _MOST_NUMBERS else []
        levels = document.gap.held_out.places
        gaps = [
            f"{name} {format_figures(level.before)} → {format_figures(level.after)} "
            f"({format_figures(level.floor)}) {level.unit}"
            for name, level in ((name, levels[name]) for name in effect.where if name in levels)
        ]
        size = Cell(
            "\n".join([*sizes[:_MOST_NUMBERS], *more]), tone="fair" if list_cautions([effect]) else "plain"
        )
        others = "\nor another of its class" if is_class(effect) else ""
        where = list_places(effect.where) + following + only
        belief = effect.belief.summary.replace("; ", "\n") if effect.belief else ""
        rows.append(Row(effect.kind.replace("_", " ") + others, [where, size, "\n".join(gaps), belief]))
    columns = ["effect", "where", "size ± sd", f"{unseen}: before → after (ordinary)", "how sure"]
    return Table(caption="The missing effects", columns=columns, rows=rows, words=True)


def tabulate_gaps(document: documents.DiscoveryDocument) -> Table:
    """All of one kind together, before and after, beside what is ordinary."""
    roles = {"used to fit": document.gap.fit}
    if document.held_out_trials:
        roles["held out"] = document.gap.held_out
    rows = [
        Row(
            f"{role}: {name}, {unit}",
            [format_figures(v) for v in (level.before, level.after, level.floor, level.ceiling)],
        )
        for role, gap in roles.items()
        for field, name, unit in LEVELS
        if (level := getattr(gap, field)) is not None
    ]
    columns = ["", "before", "after", "ordinary", "left by all that is ordinary"]
    return Table(caption="The gap, RMS", columns=columns, rows=rows)


def _tabulate_unexplained(document: documents.DiscoveryDocument) -> Table:
    """What is left beyond what is ordinary, the first places with the law that describes each."""
    rows = [
        Row(
            list_places(u.where) or "the whole recording",
            [f"{format_figures(u.rms)} {u.unit}", f"{format_figures(u.floor)} {u.unit}", u.law],
        )
        for u in document.unexplained[:_MOST_LEFT]
    ]
    more = len(document.unexplained) - _MOST_LEFT
    return Table(
        caption="Beyond what is ordinary, and like no effect of the catalogue",
        columns=["place", "left over", "ordinary", "the simplest law that describes it"],
        rows=rows,
        note=f"And {more} more places, which are in discovery.json." if more > 0 else "",
        words=True,
    )


def summarise(document: documents.DiscoveryDocument) -> Summary:
    """The verdict, a line for each of the first effects, what to doubt, and the tables."""
    held = f"; held out: {', '.join(document.held_out_trials)}" if document.held_out_trials else ""
    told = list_told(document.effects)
    why = [
        f"{'; '.join(filter(None, (effect.name, describe_share(effect))))}. {effect.advice}"
        for effect in told
    ]
    if (more := len(document.effects) - len(told)) > 0:
        why.append(f"And {more} more, in the table.")
    tables = [tabulate_effects(document)] if document.effects else []
    tables.append(tabulate_gaps(document))
    if document.unexplained:
        tables.append(_tabulate_unexplained(document))
    if document.hidden:
        rows = [Row(said) for said in describe_hidden(document)]
        tables.append(
            Table(caption="What had been hidden in this virtual person", columns=["effect"], rows=rows)
        )
    return Summary(
        title=f"What is missing in the model of {document.subject}",
        subtitle=f"Search from the {describe_model(document)}. "
        f"Fitted: {', '.join(document.fitted_trials)}{held}",
        headline=document.headline,
        tone=document.tone,
        why=[*why, *describe_left(document)],
        cautions=[*list_cautions(document.effects), *document.notes],
        tables=tables,
    )
