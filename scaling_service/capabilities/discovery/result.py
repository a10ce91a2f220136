"""What a search made of a subject's recordings, and ``discovery.json`` of it: mm, degrees, factors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from scaling_service.capabilities.discovery import text
from scaling_service.capabilities.discovery.document import (
    BothGaps,
    DisagreementDocument,
    DiscoveryDocument,
    EffectDocument,
    EvidenceDocument,
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
    observable_of,
)
from scaling_service.capabilities.discovery.start import Prepared
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.loading import provenance, repair_notes
from scaling_service.numerics.multibody.laws import Array

_FIGURES = 6  # far beyond what any of these is known to
_MM = 1e3
_UNITS: dict[str, tuple[Unit, float]] = {"marker": ("mm", _MM), "force": ("N", 1.0), "moment": ("N m", 1.0)}
"""Observable to the unit in the results and its factor."""

_MOMENTS = ("x_kgmm", "y_kgmm", "z_kgmm")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DiscoverResults:
    """What a search made of a subject's recordings."""

    prepared: Prepared
    chosen: DiscoverSettings
    settings: Settings
    search: DiscoverySettings
    findings: Findings
    before: Fit  # before, after: without and with what was named
    after: Fit
    wall_s: float = 0.0
    hidden: Sequence[HiddenDocument] | None = None  # of a virtual person: what should have been found


def discovery_document(
    results: DiscoverResults, files: Sequence[str] = (), notes: Sequence[str] = ()
) -> DiscoveryDocument:
    """``discovery.json``; ``files``: what was written beside it, ``notes``: what writing had to leave out."""
    prepared, found = results.prepared, results.findings
    fitted, held_out = (
        [name for name, role in prepared.roles.items() if role == of] for of in ("fit", "held_out")
    )
    gap = BothGaps(fit=_gap(found.fit), held_out=_gap(found.held_out))
    return DiscoveryDocument(
        **_provenance(results),
        verdict=found.verdict,
        headline=text.headline(
            found.verdict, len(found.named), gap.held_out.whitened, held_out=bool(held_out)
        ),
        reason=found.reason,
        disagreements=[_disagreement(item) for item in found.disagreements],
        effects=[_effect(named) for named in found.named],
        gap=gap,
        tried=[
            TriedDocument(**placed(o.candidate).model_dump(), gain=finite(o.held_out.gain))
            for o in found.tried
        ],
        unexplained=[_unexplained(item) for item in found.unexplained],
        start=prepared.start,
        fitted_trials=fitted,
        held_out_trials=held_out,
        trials_with_forces=list(prepared.forces),
        notes=list(dict.fromkeys((*found.notes, *notes))),
        files=list(files),
        wall_s=round(results.wall_s, 3),
        hidden=None if results.hidden is None else list(results.hidden),
    )


def _provenance(results: DiscoverResults) -> dict[str, Any]:
    loaded, settings = results.prepared.loaded, results.settings
    chosen = {"discover": results.chosen.resolved(), "search": asdict(results.search)}
    found = provenance(loaded, loaded.session.dynamic, settings.resolved() | chosen, settings.seed)
    for name, forces in results.prepared.forces.items():
        found["repairs"][name] += repair_notes(forces.repairs)
    return found


def placed(candidate: Candidate) -> PlacedEffect:
    """A candidate as a kind at a place."""
    return PlacedEffect(
        kind=candidate.kind,
        where=list(candidate.where),
        driver=list(candidate.driver),
        trials=list(candidate.trials) or None,
        note=candidate.note,
    )


def _effect(named: NamedEffect) -> EffectDocument:
    candidate, numbers = named.effect.candidate, quantities(named)
    return EffectDocument(
        **placed(candidate).model_dump(),
        name=text.describe_effect(
            candidate.kind, candidate.where, candidate.driver, candidate.trials, numbers
        ),
        parameters=numbers,
        smallest_nameable={name: rounded(v) for name, v in named.smallest.items() if finite(v) is not None},
        confusable_with=[placed(other) for other in named.equivalents],
        would_separate=named.would_separate or None,
        evidence=EvidenceDocument(
            gain_held_out=finite(named.held_out.gain),
            p_held_out=finite(named.held_out.p),
            p_family_wise=finite(named.p_family),
            by_blocks=named.held_out.folds,
            summary=text.describe_evidence(named),
        ),
    )


def _disagreement(item: Disagreement) -> DisagreementDocument:
    unit, factor = _UNITS[item.observable]
    return DisagreementDocument(
        where=item.where,
        observable=item.observable,
        unit=unit,
        rms=rounded(factor * item.rms),
        floor=finite(factor * item.floor),
        share=finite(item.share),
        p=finite(item.p),
        trials={name: rounded(factor * rms) for name, rms in item.trials.items()},
        when=item.when,
        along=item.along,
    )


def _unexplained(item: Unexplained) -> UnexplainedDocument:
    unit, factor = _UNITS[item.observable]
    return UnexplainedDocument(
        where=list(item.where),
        observable=item.observable,
        unit=unit,
        law=item.law,
        rms=rounded(factor * item.rms),
        floor=finite(factor * item.floor),
    )


def quantities(named: NamedEffect) -> dict[str, QuantityDocument]:
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
    found = {n: _quantity(v, sd) for n, v, sd in zip(names, values.tolist(), sds.tolist(), strict=True)}
    change = named.effect.candidate.change
    if isinstance(change, FreeMotion):
        x, y, z = (rounded(value) for value in change.axis)
        found["axis"] = QuantityDocument(value=(x, y, z), sd=None)
    for name, value in named.details.items():
        if math.isfinite(value) and name not in found and not name.startswith("axis_"):
            spread = named.spreads.get(name)
            found[name] = QuantityDocument(value=rounded(value), sd=spread and rounded(spread))
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


def _quantity(value: float, sd: float) -> QuantityDocument:
    return QuantityDocument(value=rounded(value), sd=rounded(sd) if math.isfinite(sd) and sd > 0.0 else None)


def _gap(gap: Gap) -> GapDocument:
    return GapDocument(
        whitened=_level(gap.levels.get("whitened"), 1.0),
        markers_mm=_level(gap.levels.get("markers"), _MM),
        force_N=_level(gap.levels.get("force"), 1.0),
        moment_Nm=_level(gap.levels.get("moment"), 1.0),
        absorbed=finite(gap.absorbed),
        places={name: _place(name, level) for name, level in gap.places.items()},
    )


def _place(name: str, level: Level) -> PlaceLevelDocument:
    unit, factor = _UNITS[observable_of(name)]
    return PlaceLevelDocument(**_in_unit(level, factor), unit=unit)


def _level(level: Level | None, factor: float) -> LevelDocument | None:
    return None if level is None else LevelDocument(**_in_unit(level, factor))


def _in_unit(level: Level, factor: float) -> dict[str, float | None]:
    return {name: finite(factor * value) for name, value in asdict(level).items()}


def rounded(value: float) -> float:
    """A number to the figures that results have."""
    return float(f"{value:.{_FIGURES}g}")


def finite(value: float) -> float | None:
    """A number as JSON has it: null where there is none."""
    return rounded(value) if math.isfinite(value) else None
