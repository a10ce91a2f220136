"""What recurs over persons: effects of the model that they share, and the generic model without them.

What persons say is pooled (:mod:`~scaling_service.capabilities.discovery.pooling`), the likeliest is named,
then the likeliest beside it, and so on; nothing that one person alone shows, or that makes what did not fit
worse over all persons.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import Field

from scaling_service.capabilities.cohort.members import read_members
from scaling_service.capabilities.discovery import options, pooling, words
from scaling_service.capabilities.discovery.effects.catalogue import propose_candidates
from scaling_service.capabilities.discovery.evidence.fit import Fit, SearchContext
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.models import correct_model, write_corrected_osim
from scaling_service.capabilities.discovery.result import DiscoverResults, QuantityDocument
from scaling_service.capabilities.discovery.run import USUAL, discover
from scaling_service.capabilities.discovery.saving import save_discovery
from scaling_service.capabilities.discovery.search.leanings import OF_MODELS
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError
from scaling_service.core.progress import Progress, report_part, show_nothing
from scaling_service.core.tables import ResultTable
from scaling_service.documents.base import Part, Rounded
from scaling_service.documents.writing import REPORT, code_version, write_json
from scaling_service.files.model_json import write_model_json
from scaling_service.model.body import BodyModel
from scaling_service.report.onefile import Report
from scaling_service.report.summary import Summary
from scaling_service.report.tables import Row, Table

FILE_NAME = "recurring.json"
MODEL = "generic_model"
SCHEMA_VERSION = 1
"""Raised when a reader of an older document would misread a newer one; new keys do not raise it."""

_MOST = 5  # effects that are listed (chosen)
_UNLIKELY = f"log odds below {USUAL.odds:g}"
_ALONE = "one person alone shows it"
_WORSE = "what did not fit is worse with it"
_GAPS = words.LEVELS[1:]
Pair = tuple[Rounded, Rounded]


class PersonEntry(Part):
    """What one person says of an effect that recurs, and what it does to the person's recordings."""

    log_odds: Rounded = Field(description="Of the shared size against nothing, by this person alone.")
    markers_mm: Pair | None = Field(
        default=None, description="RMS of what is left of what did not fit, without and with it; if named."
    )
    force_N: Pair | None = None
    moment_Nm: Pair | None = None


class RecurringEntry(Part):
    """An effect of the model that persons share."""

    kind: str
    where: list[str] = Field(description="Both where it is the same on both sides, the right first.")
    driver: list[str]
    name: str = Field(description="What it is, in plain English.")
    log_odds: Rounded = Field(description="By all persons together, the number of its places counted.")
    named: bool = Field(
        description="Whether that is enough, by more persons than one, and nothing that did not fit is worse."
    )
    why_not: str = Field(default="", description="Why it is not named.")
    parameters: dict[str, Pair] = Field(
        description="Size and standard deviation, of both sides that of the right, which the left mirrors; "
        "of a segment's mass in shares of it (`share`)."
    )
    persons: dict[str, PersonEntry]

    @property
    def shown_by(self) -> int:
        """How many persons speak for it."""
        return sum(entry.log_odds > 0.0 for entry in self.persons.values())


class RecurringDocument(Part):
    """``recurring.json``."""

    schema_version: int = SCHEMA_VERSION
    code_version: str = ""
    cohort: str = Field(default="", description="The file or folder that names the persons, as given.")
    settings: dict[str, Any] = Field(default={}, description="As resolved.")
    seed: int | None = None
    wall_s: float = 0.0
    notes: list[str] = Field(default=[], description="What was passed over.")
    headline: str
    model: str = Field(description="The generic model that is corrected: the first person's.")
    subjects: list[str]
    failed: dict[str, str] = Field(description="Subject to why it could not be searched.")
    effects: list[RecurringEntry] = Field(description="Those named as they were named, then the likeliest.")
    persons: dict[str, PersonEntry] = Field(default={}, description="The same of all that is named together.")
    corrected: list[str] = Field(default=[], description="Files of the generic model without what was named.")


@dataclass(frozen=True, slots=True, eq=False)
class Recurring:
    """What recurs, and the generic model without it."""

    document: RecurringDocument
    corrected: Fit | None  # the generic model with what was named, and no recordings

    @property
    def model(self) -> BodyModel | None:
        """The generic model corrected; None where nothing was named."""
        return None if self.corrected is None else correct_model(self.corrected)

    @property
    def effects(self) -> ResultTable:
        """A row for each effect."""
        rows = tuple(
            (e.kind, ", ".join(e.where), name, value, sd, e.log_odds, e.named, e.shown_by)
            for e in self.document.effects
            for name, (value, sd) in e.parameters.items()
        )
        columns = ("kind", "where", "parameter", "value", "sd", "log_odds", "named", "shown_by")
        return ResultTable("What recurs", columns, rows)


Left = Mapping[str, Mapping[str, float]]
"""Person to what is left of which kind."""


def find_recurring(
    found: Mapping[str, DiscoverResults], failed: Mapping[str, str] | None = None
) -> Recurring:
    """What persons share; InputError: they are fewer than two, or their models have nothing in common."""
    if len(found) < pooling.FEWEST:
        lacking = "".join(f"; {who}: {why}" for who, why in (failed or {}).items())
        raise InputError(
            f"what recurs needs {pooling.FEWEST} persons that can be searched, and there are {len(found)}"
            f"{lacking}",
            remedy="Give more subject files",
        )
    shared = pooling.list_shared(list(found.values()))
    if not shared:
        raise InputError(
            "the models of these persons have no joint or segment in common that recordings show",
            field="model",
            remedy="Search persons with models of one family together",
        )
    pooled = pooling.Pooled(shared, {name: pooling.pool(results, shared) for name, results in found.items()})
    named, refused, entries = list[int](), dict[int, tuple[Left, Left]](), list[RecurringEntry]()
    left: list[Left] = [{name: pooled.refit(results, []) for name, results in found.items()}]
    vouching = [who for who, results in found.items() if "held_out" in results.prepared.roles.values()]
    while True:
        odds = pooled.list_odds(named)
        likely = [
            k for k in odds if odds[k] >= USUAL.odds and k not in refused and pooled.is_of_many(k, named)
        ]
        if not likely:
            break
        best = max(likely, key=lambda k: odds[k])
        after = {name: pooled.refit(results, [*named, best]) for name, results in found.items()}
        # Whether markers, forces or moments are worse over those persons
        squares = [
            [sum(some[who].get(name, 0.0) ** 2 for who in vouching or found) for some in (left[-1], after)]
            for name, *_ in _GAPS
        ]
        if any(with_it > (1.0 + USUAL.worse) ** 2 * without for without, with_it in squares):
            refused[best] = left[-1], after
            continue
        entries.append(_describe(pooled, named, best, odds[best], left=(left[-1], after)))
        named.append(best)
        left.append(after)
    together = pooled.split(named)
    entries = [
        e.model_copy(update=_say_numbers(*numbers)) for e, numbers in zip(entries, together, strict=True)
    ]
    for k in sorted(odds, key=lambda k: -odds[k])[: max(_MOST - len(named), 0)]:
        alone = _ALONE if odds[k] >= USUAL.odds else _UNLIKELY
        why, seen = (_WORSE, refused[k]) if k in refused else (alone, ({}, {}))
        entries.append(_describe(pooled, named, k, odds[k], why, left=seen))
    first = next(iter(found.values()))
    generic = first.prepared.loaded.session.model
    scenes = [results.before.scene for results in found.values()]
    scene = Scene(
        model=generic,
        markers=tuple(m for m in scenes[0].markers if m in generic.marker_names),
        moving=tuple(c for c in generic.coordinate_names if any(c in each.moving for each in scenes)),
        trials=scenes[0].trials,
        plates=tuple(plate for each in scenes for plate in each.plates),
    )
    every = list(propose_candidates(scene, OF_MODELS))
    effects = [effect for one, size, _ in together for effect in one.place(every, generic, size)]
    document = RecurringDocument(
        headline=_write_headline(entries, len(found)),
        model=generic.name,
        subjects=list(found),
        failed=dict(failed or {}),
        effects=entries,
        persons=_compare(pooled, named, [], left[0], left[-1]) if named else {},
    )
    context = SearchContext(model=generic, recordings=(), settings=first.after.settings)
    return Recurring(document, Fit(context=context, effects=tuple(effects)) if effects else None)


def _compare(
    pooled: pooling.Pooled, chosen: Sequence[int], without: Sequence[int], before: Left, after: Left
) -> dict[str, PersonEntry]:
    """What some effects are to every person, against fewer."""
    return {
        who: PersonEntry(
            log_odds=pooled.ask(who, chosen, without),
            **{name: (value, after[who][name]) for name, value in before.get(who, {}).items()},
        )
        for who in pooled.said
    }


def _describe(
    pooled: pooling.Pooled,
    named: Sequence[int],
    k: int,
    odds: float,
    why: str = "",
    *,
    left: tuple[Left, Left],
) -> RecurringEntry:
    """One effect beside those named; ``why`` it is not named; ``left``: without and with it, if known."""
    one, size, sd = pooled.split([*named, k])[-1]
    return RecurringEntry(
        kind=one.candidate.kind,
        where=one.where,
        driver=list(one.candidate.driver),
        log_odds=odds,
        named=not why,
        why_not=why,
        persons=_compare(pooled, [*named, k], named, *left),
        **_say_numbers(one, size, sd),
    )


def _say_numbers(one: pooling.Shared, size: Array, sd: Array) -> dict[str, Any]:
    """Name and parameters of an effect of some size."""
    candidate, relative = one.candidate, one.candidate.kind == "segment_mass"
    names = ["share"] if relative else [c.name for c in candidate.columns]
    units = [1.0] if relative else [c.unit for c in candidate.columns]
    pairs = zip(names, units, size.tolist(), sd.tolist(), strict=True)
    numbers = {name: (unit * value, unit * spread) for name, unit, value, spread in pairs}
    shown = {name: QuantityDocument(value=value, sd=spread) for name, (value, spread) in numbers.items()}
    said = words.describe_effect(candidate.kind, one.where, candidate.driver, (), shown, spread=True)
    return {"parameters": numbers, "name": f"{said} (right; left mirrored)" if len(one.sides) > 1 else said}


def _write_headline(entries: Sequence[RecurringEntry], count: int) -> str:
    named = [e for e in entries if e.named]
    if not named:
        nearest = f"; nearest to it: {entries[0].name} ({entries[0].why_not})" if entries else ""
        return f"Nothing recurs in {count} persons beyond what is ordinary for models{nearest}"
    recur = "One effect recurs" if len(named) == 1 else f"{len(named)} effects recur"
    return f"{recur} in {count} persons. First: {named[0].name}; {named[0].shown_by} of {count} show it"


def summarise(document: RecurringDocument) -> Summary:
    """What recurs in a line each, what it does to each person's recordings that did not fit, what is near."""
    count = len(document.subjects)
    named = [e for e in document.effects if e.named]
    why = [
        f"{e.name}. {e.shown_by} of {count} persons show it (log odds {e.log_odds:.1f})"
        for e in named[: words.MOST_LINES]
    ]
    if document.corrected:
        why.append(f"The generic model without it: {', '.join(document.corrected)}.")
    rows = [
        Row(who, [*(_show_pair(getattr(entry, field)) for field, *_ in _GAPS), f"{entry.log_odds:+.1f}"])
        for who, entry in document.persons.items()
    ]
    told = [
        Row(
            e.name,
            [
                f"no: {e.why_not}" if e.why_not else "yes",
                f"{e.log_odds:.1f}",
                f"{e.shown_by} of {count}",
                "\n".join(filter(None, (_say_gaps(who, entry) for who, entry in e.persons.items()))),
            ],
        )
        for e in document.effects
    ]
    corrected = Table(
        caption="What the corrected model does to recordings that did not fit: RMS before → after",
        columns=["person", *(f"{name}, {unit}" for _, name, unit in _GAPS), "log likelihood"],
        rows=rows,
    )
    asked = ["named", "log odds", "speak for it", "what did not fit, with it"]
    recurring = Table(
        caption="What may recur", columns=["effect of the generic model", *asked], rows=told, words=True
    )
    return Summary(
        title=f"What recurs over {count} persons with {document.model}",
        headline=document.headline,
        tone="good" if not named else "fair",
        why=why,
        cautions=[
            *document.notes,
            *(f"{who} was not searched: {said}" for who, said in document.failed.items()),
        ],
        tables=[corrected, recurring] if rows else [recurring],
    )


def _say_gaps(person: str, entry: PersonEntry) -> str:
    """What an effect does to one person's recordings; empty where that was not tried."""
    said = [
        f"{name} {_show_pair(pair)} {unit}"
        for field, name, unit in _GAPS
        if (pair := getattr(entry, field)) is not None
    ]
    return f"{person}: {', '.join(said)}" if said else ""


def _show_pair(pair: tuple[float, float] | None) -> str:
    return "–" if pair is None else f"{words.format_figures(pair[0])} → {words.format_figures(pair[1])}"


def discover_recurring(
    cohort: str | Path,
    out: str | Path,
    chosen: options.DiscoverSettings = options.PLAIN,
    settings: Settings = options.AS_MEASURED,
    *,
    report: bool = True,
    progress: Progress | None = None,
) -> Recurring:
    """Search every person of a cohort, and what they share; errors as :func:`find_recurring`.

    ``cohort``: CSV file with a column ``subject``, or a folder of subject files. ``out``: a folder for each
    person is made in it, beside ``recurring.json`` and ``generic_model.*``. ``chosen``, ``settings``: as for
    :func:`scaling_service.discover`.
    """
    clock, report_to, folder = time.perf_counter(), progress or show_nothing, Path(out)
    members, passed = read_members(Path(cohort))
    if len(members) < pooling.FEWEST:
        raise InputError(
            f"what recurs needs {pooling.FEWEST} persons, and there is {len(members)}",
            file=Path(cohort),
            remedy="Give more subject files, or search one person by naming its subject file",
        )
    found: dict[str, DiscoverResults] = {}
    failed: dict[str, str] = {}
    for k, member in enumerate(members):
        part = report_part(report_to, k / len(members), 1.0 / len(members))
        try:
            results = discover(member.file, chosen, settings, progress=part)
        except InputError as error:
            failed[member.shown] = str(error)
            continue
        name = results.prepared.subject.id
        if name in found:
            name = f"{name}_{k + 1}"
        save_discovery(results, folder / name, report=report)
        found[name] = results
    recurring = find_recurring(found, failed)
    files, notes = [], list(passed)
    for stale in (f"{MODEL}.json", f"{MODEL}.osim", REPORT):
        (folder / stale).unlink(missing_ok=True)
    if recurring.corrected is not None and recurring.model is not None:
        files.append(f"{MODEL}.json")
        write_model_json(folder / files[0], recurring.model)
        first = next(iter(found.values())).prepared
        notes += write_corrected_osim(
            folder / f"{MODEL}.osim", recurring.corrected, replace(first, calibration=None)
        )
        files += [f"{MODEL}.osim"] if (folder / f"{MODEL}.osim").is_file() else []
    document = recurring.document.model_copy(
        update={
            "code_version": code_version(),
            "cohort": str(cohort),
            "settings": {**chosen.model_dump(mode="json"), **settings.model_dump(mode="json")},
            "seed": settings.seed,
            "wall_s": round(time.perf_counter() - clock, 3),
            "notes": notes,
            "corrected": files,
        }
    )
    write_json(folder / FILE_NAME, document)
    if report:
        Report(
            kind="recurring", name=FILE_NAME, summary=summarise(document), document=document, beside=files
        ).write(folder)
    return replace(recurring, document=document)
