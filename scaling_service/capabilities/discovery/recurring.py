"""What recurs over persons: effects of the model that they share, and the generic model without them.

Every person's recordings say something of every effect, the person's own part of it integrated out: score x
and information X. What all share has the sums of both, so that a tendency that nobody shows beyond what is
ordinary is told where many show it.
"""

from __future__ import annotations

import json
import math
import time
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from scaling_service.capabilities.cohort.members import read_members
from scaling_service.capabilities.discovery.evidence.fit import Fit, fit_recordings, fit_wrenches
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate
from scaling_service.capabilities.discovery.laws.loads import Inertial, differentiate_centre, scale_segment
from scaling_service.capabilities.discovery.models import apply_everywhere
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS
from scaling_service.capabilities.discovery.options import AS_MEASURED, PLAIN, DiscoverSettings
from scaling_service.capabilities.discovery.ordinary.odds import Scored
from scaling_service.capabilities.discovery.result import DiscoverResults
from scaling_service.capabilities.discovery.run import USUAL, discover
from scaling_service.capabilities.discovery.saving import save_discovery
from scaling_service.capabilities.discovery.search.gaps import rms_by_place
from scaling_service.capabilities.discovery.search.leanings import Leaning
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError
from scaling_service.core.progress import Progress, report_part, show_nothing
from scaling_service.core.tables import ResultTable
from scaling_service.documents.base import Part, Rounded
from scaling_service.documents.writing import code_version, write_json
from scaling_service.model.body import BodyModel
from scaling_service.model.document import to_document
from scaling_service.model.inertia import sum_mass

FILE_NAME = "recurring.json"
SCHEMA_VERSION = 1
"""Raised when a reader of an older document would misread a newer one; new keys do not raise it."""

_FEWEST = 2  # persons
_MOST = 5  # effects that are listed (chosen)


class PersonEntry(Part):
    """What one person says of an effect that recurs."""

    log_odds: Rounded = Field(description="Of the shared size against nothing, by this person alone.")
    force_N: tuple[Rounded, Rounded] | None = Field(
        description="RMS of what is left of the ground force, without and with it, on what did not fit."
    )
    moment_Nm: tuple[Rounded, Rounded] | None
    markers_mm: tuple[Rounded, Rounded]


class RecurringEntry(Part):
    """An effect of the model that persons share."""

    kind: str
    where: list[str]
    driver: list[str]
    log_odds: Rounded = Field(description="By all persons together, the number of its places counted.")
    named: bool = Field(description="Whether that is enough to be named.")
    parameters: dict[str, tuple[Rounded, Rounded]] = Field(
        description="Size and standard deviation; of a segment's mass in shares of it (`share`)."
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
    model: str = Field(description="The generic model that all persons have.")
    subjects: list[str]
    failed: dict[str, str] = Field(description="Subject to why it could not be searched.")
    effects: list[RecurringEntry]
    corrected: str | None = Field(description="The generic model without what was named.")


@dataclass(frozen=True, slots=True, eq=False)
class Recurring:
    """What recurs, and the generic model without it."""

    document: RecurringDocument
    model: BodyModel | None

    @property
    def effects(self) -> ResultTable:
        """A row for each effect."""
        count = len(self.document.subjects)
        rows = tuple(
            (
                e.kind,
                ", ".join(e.where),
                round(e.log_odds, 1),
                "yes" if e.named else f"no, below {USUAL.odds:g}",
                f"{e.shown_by} of {count}",
                _say_sizes(e),
            )
            for e in self.document.effects
        )
        return ResultTable("What recurs", ("kind", "where", "log_odds", "named", "shown_by", "size"), rows)


def _say_sizes(entry: RecurringEntry) -> str:
    return ", ".join(f"{name} {value:.3g} ± {sd:.2g}" for name, (value, sd) in entry.parameters.items())


def discover_recurring(
    cohort: str | Path,
    out: str | Path,
    chosen: DiscoverSettings = PLAIN,
    settings: Settings = AS_MEASURED,
    *,
    report: bool = True,
    progress: Progress | None = None,
) -> Recurring:
    """Search every person of a cohort, and what they share.

    Parameters
    ----------
    cohort : path
        CSV file with a column ``subject``, or a folder of subject files.
    out : path
        A folder for each person is made in it, beside ``recurring.json`` and ``generic_model.json``.
    chosen, settings
        As for :func:`scaling_service.discover`.

    Raises
    ------
    InputError
        There are fewer than two persons whose recordings can be searched with the same generic model.
    """
    clock = time.perf_counter()
    report_to, folder = progress or show_nothing, Path(out)
    members, passed = read_members(Path(cohort))
    if len(members) < _FEWEST:
        raise InputError(
            f"what recurs needs {_FEWEST} persons, and there is {len(members)}",
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
    document = recurring.document.model_copy(
        update={
            "code_version": code_version(),
            "cohort": str(cohort),
            "settings": {**chosen.model_dump(mode="json"), **settings.model_dump(mode="json")},
            "seed": settings.seed,
            "wall_s": round(time.perf_counter() - clock, 3),
            "notes": list(passed),
        }
    )
    recurring = replace(recurring, document=document)
    if recurring.model is not None:
        (folder / "generic_model.json").write_text(
            json.dumps(to_document(recurring.model), allow_nan=False), encoding="utf-8"
        )
    write_json(folder / FILE_NAME, recurring.document)
    return recurring


def find_recurring(
    found: Mapping[str, DiscoverResults], failed: Mapping[str, str] | None = None
) -> Recurring:
    """What persons share that were searched with the same generic model.

    Raises
    ------
    InputError
        Fewer than two persons, or different generic models.
    """
    failed = failed or {}
    models = {name: results.prepared.loaded.session.model for name, results in found.items()}
    if len(found) < _FEWEST:
        lacking = "".join(f"; {who}: {why}" for who, why in failed.items())
        raise InputError(
            f"what recurs needs {_FEWEST} persons that can be searched, and there are {len(found)}{lacking}",
            remedy="Give more subject files",
        )
    if len({tuple(s.joint_name for s in m.segments) for m in models.values()}) > 1:
        raise InputError(
            "these persons do not share a generic model",
            field="model",
            remedy="Search persons with the same model together",
        )
    by_effect: dict[tuple[object, ...], dict[str, Leaning]] = defaultdict(dict)
    for name, results in found.items():
        for leaning in results.leanings:
            c = leaning.candidate
            by_effect[(c.kind, c.where, c.driver, tuple(x.name for x in c.columns))][name] = _share(
                leaning, results
            )
    shared = {key: each for key, each in by_effect.items() if len(each) == len(found)}
    places = Counter(key[0] for key in shared)
    ranked = sorted(
        ((pool_leanings(list(each.values())), each) for each in shared.values()),
        key=lambda one: math.log(places[_kind(one[1])]) - one[0].bayes,
    )
    entries, named = [], []
    generic = next(iter(models.values()))
    for scored, each in ranked[:_MOST]:
        odds = scored.bayes - math.log(places[_kind(each)])
        entries.append(_describe(odds, scored, each, found))
        if odds >= USUAL.odds:
            first = next(iter(each.values())).candidate
            named.append(Estimate(_place_in(generic, first), _own_size(first, scored.size, generic)))
    heavy = [e for e in named if all(c.load is None for c in e.candidate.columns) or sum_mass(generic) > 0.0]
    corrected = apply_everywhere(generic, heavy) if heavy else None
    document = RecurringDocument(
        headline=_write_headline(entries, len(found)),
        model=generic.name,
        subjects=list(found),
        failed=dict(failed),
        effects=entries,
        corrected="generic_model.json" if corrected is not None else None,
    )
    return Recurring(document, corrected)


def _kind(each: Mapping[str, Leaning]) -> str:
    return next(iter(each.values())).candidate.kind


def _share(leaning: Leaning, results: DiscoverResults) -> Leaning:
    """A segment's mass in shares of it, for persons differ."""
    if leaning.candidate.kind != "segment_mass":
        return leaning
    return leaning.rescale(results.before.model.segment(leaning.candidate.where[0]).mass)


def _place_in(model: BodyModel, candidate: Candidate) -> Candidate:
    """An effect of a person's masses as one of another model's."""
    if candidate.kind not in ("segment_mass", "segment_com"):
        return candidate
    segment = model.segment(candidate.where[0])
    if candidate.kind == "segment_mass":
        loads = [scale_segment(segment)]
    else:
        loads = [Inertial(segment.name, differentiate_centre(segment, k)) for k in range(3)]
    pairs = zip(candidate.columns, loads, strict=True)
    return replace(candidate, columns=tuple(replace(column, load=load) for column, load in pairs))


def _own_size(candidate: Candidate, size: Array, model: BodyModel) -> Array:
    """A shared size as a person's, SI."""
    return size * model.segment(candidate.where[0]).mass if candidate.kind == "segment_mass" else size


def pool_leanings(leanings: Sequence[Leaning]) -> Scored:
    """What persons say together of numbers that all share."""
    x, X = (np.sum([getattr(one, what) for one in leanings], axis=0) for what in ("score", "information"))
    return Scored.of(x, X, leanings[0].sd)


def _describe(
    odds: float, scored: Scored, each: Mapping[str, Leaning], found: Mapping[str, DiscoverResults]
) -> RecurringEntry:
    first = next(iter(each.values())).candidate
    sd = np.sqrt(np.diag(scored.covariance))
    persons = {name: _ask_person(leaning, scored.size, found[name]) for name, leaning in each.items()}
    relative = first.kind == "segment_mass"
    names = ["share"] if relative else [c.name for c in first.columns]
    units = [1.0] if relative else [c.unit for c in first.columns]
    return RecurringEntry(
        kind=first.kind,
        where=list(first.where),
        driver=list(first.driver),
        log_odds=odds,
        named=odds >= USUAL.odds,
        parameters={n: (u * b, u * s) for n, u, b, s in zip(names, units, scored.size, sd, strict=True)},
        persons=persons,
    )


def _ask_person(leaning: Leaning, size: Array, results: DiscoverResults) -> PersonEntry:
    """What the shared size does to one person's recordings."""
    fit, candidate = results.after, leaning.candidate
    effect = Estimate(candidate, _own_size(candidate, size, results.before.model))
    kept = [e for e in fit.effects if e.candidate.key != candidate.key]
    without = _refit(fit, kept, candidate)
    with_it = _refit(fit, [*kept, effect], candidate)
    roles = {item.name: item.role for item in fit.tracked}
    unseen = [name for name, role in roles.items() if role == "held_out"] or list(roles)
    rms = [
        {k: v for forces in (False, True) for k, v in rms_by_place(f, unseen, forces=forces).items()}
        for f in (without, with_it)
    ]

    def together(places: Sequence[str], unit: float) -> tuple[float, float] | None:
        shown = [p for p in places if p in rms[0] and p in rms[1]]
        if not shown:
            return None
        a, b = (unit * math.sqrt(np.mean([r[p] ** 2 for p in shown])) for r in rms)
        return a, b

    markers = together([p for p in rms[0] if p not in COMPONENTS], 1e3)
    assert markers is not None
    return PersonEntry(
        log_odds=leaning.weigh(size),
        force_N=together(COMPONENTS[:3], 1.0),
        moment_Nm=together(COMPONENTS[3:], 1.0),
        markers_mm=markers,
    )


def _refit(fit: Fit, effects: Sequence[Estimate], candidate: Candidate) -> Fit:
    if candidate.seen_in == "wrench":
        return fit_wrenches(replace(fit, effects=tuple(effects)))
    return fit_recordings(fit.context, effects, fit)


def _write_headline(entries: Sequence[RecurringEntry], count: int) -> str:
    named = [e for e in entries if e.named]
    if not named:
        return f"Nothing recurs in {count} persons beyond what is ordinary for models"
    first = named[0]
    more = f", and {len(named) - 1} more" if len(named) > 1 else ""
    what = f"{first.kind.replace('_', ' ')} at {', '.join(first.where)}"
    return f"{what} recurs: {first.shown_by} of {count} persons show it ({_say_sizes(first)}){more}"
