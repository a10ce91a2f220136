"""What a search made of a subject's recordings, and ``discovery.json`` of it: mm, degrees, factors."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from html import escape
from typing import Any

import numpy as np
import scipy

from scaling_service.capabilities.discovery import text
from scaling_service.capabilities.discovery.bones import BoneKnowledge, measure_slide
from scaling_service.capabilities.discovery.document import (
    BeliefDocument,
    BonesDocument,
    BothGaps,
    DisagreementDocument,
    DiscoveryDocument,
    EffectDocument,
    EstimateDocument,
    EvidenceDocument,
    ExpectationDocument,
    GapDocument,
    HiddenDocument,
    LevelDocument,
    PlacedEffect,
    PlaceLevelDocument,
    QuantityDocument,
    TriedDocument,
    UnexplainedDocument,
    Unit,
)
from scaling_service.capabilities.discovery.effects.sizes import Range, look_up_usual_sizes
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.laws.candidates import Candidate, FreeMotion
from scaling_service.capabilities.discovery.options import DiscoverSettings
from scaling_service.capabilities.discovery.search.findings import (
    Disagreement,
    Findings,
    Gap,
    Level,
    NamedEffect,
    Unexplained,
    classify_place,
    turn_into_probability,
)
from scaling_service.capabilities.discovery.search.leanings import Leaning
from scaling_service.capabilities.discovery.start import Prepared
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.provenance import record_provenance, repair_notes
from scaling_service.core.arrays import Array
from scaling_service.core.tables import ResultTable
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import evaluate_law

_MM = 1e3
_UNITS: dict[str, tuple[Unit, float]] = {"marker": ("mm", _MM), "force": ("N", 1.0), "moment": ("N m", 1.0)}
"""Observable to the unit in the results and its factor."""

_FACTORS = {"whitened": 1.0, "markers": _MM, "force": 1.0, "moment": 1.0}
_MOMENTS = ("x_kgmm", "y_kgmm", "z_kgmm")
_ESTIMATED = ("segment_mass", "segment_com", "joint_centre_offset", "joint_axis_tilt")
_TOLD = 0.5  # share of what is not known beforehand that recordings must tell of a number (chosen)


def estimate_sign_probability(values: Array, covariance: Array) -> float | None:
    """How probable it is that all of it, in the found proportions, points the way that was found.

    None where no number has a deviation. Numbers (k,) and covariance (k, k) count in deviations.
    """
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = sd > 0.0
    if not known.any():
        return None
    z, spread = values[known] / sd[known], covariance[np.ix_(known, known)] / np.outer(sd[known], sd[known])
    length = float(z @ spread @ z)
    return float(scipy.special.ndtr(z @ z / math.sqrt(length))) if length > 0.0 else 0.5


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class DiscoverResults:
    """What a search made of a subject's recordings."""

    prepared: Prepared
    chosen: DiscoverSettings
    settings: Settings
    search: DiscoverySettings
    findings: Findings
    before: Fit  # before, after: without and with what was named
    after: Fit
    lasting: Fit  # after, without movements that skin as a whole could as well be
    left_out: tuple[str, ...]  # the names of these
    bones: BoneKnowledge
    leanings: Sequence[Leaning] = ()  # what the recordings say of every effect of the model
    wall_s: float = 0.0
    hidden: Sequence[HiddenDocument] | None = None  # of a virtual person: what should have been found

    @property
    def document(self) -> DiscoveryDocument:
        """``discovery.json`` of it."""
        return make_discovery_document(self)

    @property
    def effects(self) -> ResultTable:
        """Every number of every effect that was named; its name holds the unit."""
        rows = tuple(
            (effect.kind, ", ".join(effect.where), name, number.value, number.sd)
            for effect in self.document.effects
            for name, number in effect.parameters.items()
        )
        return ResultTable("The missing effects", ("kind", "where", "parameter", "value", "sd"), rows)

    @property
    def tables(self) -> dict[str, ResultTable]:
        """What was named, number by number."""
        return {"effects": self.effects}

    def __repr__(self) -> str:
        return f"{self.document.headline}\n{self.effects!r}"

    def _repr_html_(self) -> str:
        return f"<p>{escape(self.document.headline)}</p>{self.effects._repr_html_()}"


def _finite(sizes: Mapping[str, float]) -> dict[str, float]:
    return {name: size for name, size in sizes.items() if math.isfinite(size)}


def make_discovery_document(
    results: DiscoverResults, files: Sequence[str] = (), notes: Sequence[str] = ()
) -> DiscoveryDocument:
    """``discovery.json``; ``files``: what was written beside it, ``notes``: what writing had to leave out."""
    prepared, found = results.prepared, results.findings
    fitted, held_out = (
        [name for name, role in prepared.roles.items() if role == of] for of in ("fit", "held_out")
    )
    effects = [_make_effect(n, prepared.model) for n in found.named]
    gap = BothGaps(fit=_make_gap(found.fit), held_out=_make_gap(found.held_out))
    left = [UnexplainedDocument.model_validate(_in_unit(u)) for u in found.unexplained]
    headline = text.write_headline(
        found.verdict, effects, gap.held_out.whitened, left, held_out=bool(held_out)
    )
    worse = text.describe_worse(gap.held_out)
    return DiscoveryDocument(
        **_make_provenance(results),
        verdict=found.verdict,
        headline=headline + worse,
        tone=text.choose_tone(found.verdict, effects, worse),
        reason=found.reason,
        disagreements=[DisagreementDocument.model_validate(_in_unit(d)) for d in found.disagreements],
        effects=effects,
        gap=gap,
        tried=[
            TriedDocument(
                **_place(o.candidate), gain=o.gain, log_odds=o.odds, smallest_nameable=_finite(o.smallest)
            )
            for o in found.tried
        ],
        estimates=list(_list_estimates(results.leanings)),
        unexplained=left,
        bones=_make_bones(results),
        start=prepared.start,
        fitted_trials=fitted,
        held_out_trials=held_out,
        trials_with_forces=list(prepared.forces),
        notes=list(dict.fromkeys((*found.notes, *notes))),
        files=list(files),
        wall_s=round(results.wall_s, 3),
        hidden=None if results.hidden is None else list(results.hidden),
    )


def _list_estimates(leanings: Sequence[Leaning]) -> Iterator[EstimateDocument]:
    """What is told of single things of the model, the one that is most unlike it first."""
    posteriors = [(one, *one.solve()) for one in leanings if one.candidate.kind in _ESTIMATED]
    posteriors.sort(key=lambda each: -float(each[1] @ np.linalg.solve(each[2], each[1])))
    for one, size, covariance in posteriors:
        sds = np.sqrt(np.diag(covariance))
        told = 1.0 - np.square(sds / one.sd) > _TOLD
        if told.any():
            yield EstimateDocument(
                **_place(one.candidate),
                parameters={
                    c.name: QuantityDocument(
                        value=c.neutral + c.unit * value, sd=abs(c.unit) * sd, determined=known
                    )
                    for c, value, sd, known in zip(
                        one.candidate.columns, size.tolist(), sds.tolist(), told.tolist(), strict=True
                    )
                },
            )


def _make_bones(results: DiscoverResults) -> BonesDocument:
    known = results.bones
    return BonesDocument(
        skin_mm={name: _MM * measure_slide(laws) for name, laws in known.skin.items()},
        expectations=[
            ExpectationDocument(
                coordinate=e.coordinate,
                at_rest_deg=math.degrees(evaluate_law(e.law, defaultdict(float))),
                follows=[t.coordinate for t in e.law.terms if t.coordinate is not None],
                sd_deg=math.degrees(e.sd),
                source=e.source,
            )
            for e in known.expectations
        ],
        left_out=list(results.left_out),
    )


def _make_provenance(results: DiscoverResults) -> dict[str, Any]:
    loaded, settings = results.prepared.loaded, results.settings
    chosen = {"discover": results.chosen.resolved(), "search": asdict(results.search)}
    found = record_provenance(loaded, loaded.session.dynamic, settings.resolved() | chosen, settings.seed)
    for name, forces in results.prepared.forces.items():
        found["repairs"][name] += repair_notes(forces.repairs)
    return found


def _in_unit(item: Disagreement | Unexplained) -> dict[str, Any]:
    unit, factor = _UNITS[item.observable]
    found = asdict(item) | {"unit": unit, "rms": factor * item.rms, "floor": factor * item.floor}
    if isinstance(item, Disagreement):
        found["trials"] = {name: factor * rms for name, rms in item.trials.items()}
    return found


def _place(candidate: Candidate) -> dict[str, Any]:
    """A candidate as a kind at a place."""
    return {
        "kind": candidate.kind,
        "where": list(candidate.where),
        "driver": list(candidate.driver),
        "trials": list(candidate.trials) or None,
        "note": candidate.note,
    }


def _make_effect(named: NamedEffect, model: BodyModel) -> EffectDocument:
    # Every number beside what laboratories meet.
    usual, numbers = look_up_usual_sizes(named.candidate, model), {}
    for name, quantity in list_quantities(named).items():
        known = None if isinstance(quantity.value, tuple) else usual(name)
        ends = None if known is None else (known.low, known.high)
        numbers[name] = QuantityDocument(**dict(quantity) | {"usual": ends})
    candidate = named.effect.candidate
    others = [PlacedEffect(**_place(other)) for other in named.equivalents]
    return EffectDocument(
        **_place(candidate),
        name=_name(named, others, numbers),
        parameters=numbers,
        smallest_nameable=_finite(named.smallest),
        confusable_with=others,
        would_separate=named.would_separate or None,
        evidence=EvidenceDocument(
            gain_held_out=named.gain,
            log_odds=named.odds,
            p_family_wise=1.0 - turn_into_probability(named.odds),
            by_blocks=named.by_blocks,
            summary=text.describe_evidence(named),
        ),
        belief=_make_belief(named, numbers),
    )


def _name(named: NamedEffect, others: Sequence[PlacedEffect], numbers: Mapping[str, QuantityDocument]) -> str:
    """In plain English, or its class where no member of it stands out."""
    one = named.candidate
    if text.is_class(named.member):
        return text.describe_class(PlacedEffect(**_place(one)), others, named.would_separate)
    return text.describe_effect(one.kind, one.where, one.driver, one.trials, numbers)


def _make_belief(named: NamedEffect, numbers: Mapping[str, QuantityDocument]) -> BeliefDocument:
    sizes = [
        Range(*q.usual).chance(q.value, q.sd or 0.0)
        for q in numbers.values()
        if q.usual is not None and not isinstance(q.value, tuple)
    ]
    effect, member = turn_into_probability(named.odds), named.member
    sign, size = estimate_sign_probability(named.effect.size, named.covariance), min(sizes, default=None)
    return BeliefDocument(
        effect=effect,
        member=member,
        sign=sign,
        size=size,
        summary=text.describe_belief(effect, member, sign, size),
        cautions=list(text.describe_cautions(named.candidate, numbers)),
    )


def list_quantities(named: NamedEffect) -> dict[str, QuantityDocument]:
    """Every number of an effect by its name in the results."""
    columns = named.effect.candidate.columns
    names = [column.name for column in columns]
    units = np.array([column.unit for column in columns])
    values = np.array([column.neutral for column in columns]) + units * named.effect.size
    covariance = np.asarray(named.covariance, dtype=float).reshape(len(columns), len(columns))
    covariance = covariance * np.outer(units, units)
    if set(_MOMENTS) < set(names):
        names, values, covariance = _place_load(names, values, covariance)
    sds = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    sds = np.array([named.spreads.get(name, sd) for name, sd in zip(names, sds.tolist(), strict=True)])
    found = {
        name: QuantityDocument(value=value, sd=sd if sd > 0.0 else None, determined=sd > 0.0 or not any(sds))
        for name, value, sd in zip(names, values.tolist(), sds.tolist(), strict=True)
    }
    change = named.effect.candidate.change
    if isinstance(change, FreeMotion):
        found["axis"] = QuantityDocument(value=change.axis, sd=None)
    for name, value in named.details.items():
        if math.isfinite(value) and name not in found and not name.startswith("axis_"):
            found[name] = QuantityDocument(value=value, sd=named.spreads.get(name))
    return found


def _place_load(names: list[str], values: Array, covariance: Array) -> tuple[list[str], Array, Array]:
    """A carried load's first moments as a place: moments over mass, errors to first order."""
    mass = names.index("kg")
    at = [names.index(name) for name in _MOMENTS]
    kg = float(values[mass])
    place = values[at] / kg
    slope = np.zeros((4, len(values)))
    slope[0, mass] = 1.0
    slope[[1, 2, 3], at] = 1.0 / kg
    slope[1:, mass] = -place / kg
    return ["kg", "x_mm", "y_mm", "z_mm"], np.array([kg, *place]), slope @ covariance @ slope.T


def _make_gap(gap: Gap) -> GapDocument:
    levels = {
        name: LevelDocument(**_scale_to_results(level, _FACTORS[name])) for name, level in gap.levels.items()
    }
    places = {}
    for name, level in gap.places.items():
        unit, factor = _UNITS[classify_place(name)]
        places[name] = PlaceLevelDocument(**_scale_to_results(level, factor), unit=unit)
    return GapDocument(
        whitened=levels.get("whitened"),
        markers_mm=levels.get("markers"),
        force_N=levels.get("force"),
        moment_Nm=levels.get("moment"),
        places=places,
    )


def _scale_to_results(level: Level, factor: float) -> dict[str, float]:
    return {name: factor * value for name, value in asdict(level).items()}
