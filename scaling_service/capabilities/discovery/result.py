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

_MM = 1e3
_UNITS: dict[str, tuple[Unit, float]] = {"marker": ("mm", _MM), "force": ("N", 1.0), "moment": ("N m", 1.0)}
"""Observable to the unit in the results and its factor."""

_FACTORS = {"whitened": 1.0, "markers": _MM, "force": 1.0, "moment": 1.0}
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
        disagreements=[DisagreementDocument.model_validate(_in_unit(d)) for d in found.disagreements],
        effects=[_effect(named) for named in found.named],
        gap=gap,
        tried=[TriedDocument(**_place(o.candidate), gain=o.held_out.gain) for o in found.tried],
        unexplained=[UnexplainedDocument.model_validate(_in_unit(u)) for u in found.unexplained],
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


def _effect(named: NamedEffect) -> EffectDocument:
    candidate, numbers = named.effect.candidate, quantities(named)
    return EffectDocument(
        **_place(candidate),
        name=text.describe_effect(
            candidate.kind, candidate.where, candidate.driver, candidate.trials, numbers
        ),
        parameters=numbers,
        smallest_nameable={name: size for name, size in named.smallest.items() if math.isfinite(size)},
        confusable_with=[PlacedEffect(**_place(other)) for other in named.equivalents],
        would_separate=named.would_separate or None,
        evidence=EvidenceDocument(
            gain_held_out=named.held_out.gain,
            p_held_out=named.held_out.p,
            p_family_wise=named.p_family,
            by_blocks=named.held_out.folds,
            summary=text.describe_evidence(named),
        ),
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
    found = {
        name: QuantityDocument(value=value, sd=sd if sd > 0.0 else None)
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


def _gap(gap: Gap) -> GapDocument:
    levels = {name: LevelDocument(**_scaled(level, _FACTORS[name])) for name, level in gap.levels.items()}
    places = {}
    for name, level in gap.places.items():
        unit, factor = _UNITS[observable_of(name)]
        places[name] = PlaceLevelDocument(**_scaled(level, factor), unit=unit)
    return GapDocument(
        whitened=levels.get("whitened"),
        markers_mm=levels.get("markers"),
        force_N=levels.get("force"),
        moment_Nm=levels.get("moment"),
        absorbed=gap.absorbed,
        places=places,
    )


def _scaled(level: Level, factor: float) -> dict[str, float]:
    return {name: factor * value for name, value in asdict(level).items()}
