"""From what a search found to ``discovery.json``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from scaling_service.capabilities.discovery.document import (
    BothGaps,
    DisagreementDocument,
    DiscoveryDocument,
    EffectDocument,
    EvidenceDocument,
    GapDocument,
    LevelDocument,
    PlacedEffect,
    PlaceLevelDocument,
    TriedDocument,
    UnexplainedDocument,
    Unit,
)
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate
from scaling_service.capabilities.discovery.laws.candidates import Candidate
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS
from scaling_service.capabilities.discovery.run import DiscoverResults
from scaling_service.capabilities.discovery.search.findings import (
    Disagreement,
    Gap,
    Level,
    NamedEffect,
    Unexplained,
)
from scaling_service.capabilities.discovery.sizes import finite, quantities, rounded
from scaling_service.capabilities.discovery.words import sentence
from scaling_service.capabilities.subject.provenance import repair_notes
from scaling_service.capabilities.subject.reading import input_hashes
from scaling_service.documents.results import RepairNote
from scaling_service.documents.writing import code_version

_MM = 1e3
_UNITS: dict[str, tuple[Unit, float]] = {"marker": ("mm", _MM), "force": ("N", 1.0), "moment": ("N m", 1.0)}
"""Observable to the unit in the results and its factor."""


def discovery_document(
    results: DiscoverResults, files: Sequence[str] = (), notes: Sequence[str] = ()
) -> DiscoveryDocument:
    """``discovery.json``.

    Parameters
    ----------
    results : DiscoverResults
    files : sequence of str
        What was written beside it.
    notes : sequence of str
        What writing had to leave out.
    """
    prepared, found = results.prepared, results.findings
    fitted = [name for name, role in prepared.roles.items() if role == "fit"]
    return DiscoveryDocument(
        code_version=code_version(),
        subject=prepared.subject.id,
        settings=results.settings.resolved()
        | {"discover": results.chosen.resolved(), "search": asdict(results.search)},
        input_hashes=input_hashes(prepared.subject, results.subject_file),
        seed=results.settings.seed,
        markers_used={name: list(labels) for name, labels in prepared.loaded.markers_used.items()},
        repairs=_repairs(results),
        verdict=found.verdict,
        reason=found.reason,
        disagreements=[_disagreement(d) for d in found.disagreements],
        effects=[_effect(n) for n in found.named],
        gap=BothGaps(fit=_gap(found.fit), held_out=_gap(found.held_out)),
        tried=[_tried(o) for o in found.tried],
        unexplained=[_unexplained(u) for u in found.unexplained],
        start=prepared.start,
        fitted_trials=fitted,
        held_out_trials=[name for name in prepared.roles if name not in fitted],
        trials_with_forces=list(prepared.forces.by_trial),
        notes=list(dict.fromkeys((*found.notes, *notes))),
        files=list(files),
        wall_s=round(results.wall_s, 3),
        hidden=None if results.hidden is None else list(results.hidden),
    )


def _repairs(results: DiscoverResults) -> dict[str, list[RepairNote]]:
    sources, session = results.prepared.forces.sources, results.prepared.loaded.session
    found: dict[str, list[RepairNote]] = {}
    for trial in session.dynamic:
        of_forces = sources[trial.name].repairs if trial.name in sources else ()
        found[trial.name] = repair_notes((*trial.repairs, *of_forces))
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
        name=sentence(candidate.kind, candidate.where, candidate.driver, candidate.trials, numbers),
        parameters=numbers,
        smallest_nameable={name: rounded(v) for name, v in named.smallest.items() if finite(v) is not None},
        confusable_with=[placed(other) for other in named.equivalents],
        would_separate=named.would_separate or None,
        evidence=EvidenceDocument(
            gain_held_out=finite(named.held_out.gain),
            p_held_out=finite(named.held_out.p),
            p_family_wise=finite(named.p_family),
            by_blocks=named.held_out.folds,
        ),
    )


def _tried(option: ScoredCandidate) -> TriedDocument:
    return TriedDocument(**placed(option.candidate).model_dump(), gain=finite(option.held_out.gain))


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


def _gap(gap: Gap) -> GapDocument:
    levels = gap.levels
    return GapDocument(
        whitened=_level(levels.get("whitened"), 1.0),
        markers_mm=_level(levels.get("markers"), _MM),
        force_N=_level(levels.get("force"), 1.0),
        moment_Nm=_level(levels.get("moment"), 1.0),
        absorbed=finite(gap.absorbed),
        places={name: _place(name, level) for name, level in gap.places.items()},
    )


def _place(name: str, level: Level) -> PlaceLevelDocument:
    """A component of the wrench has a name of its own; anything else is a marker."""
    observable = {"f": "force", "m": "moment"}[name[0]] if name in COMPONENTS else "marker"
    unit, factor = _UNITS[observable]
    return PlaceLevelDocument(**_numbers(level, factor), unit=unit)


def _level(level: Level | None, factor: float) -> LevelDocument | None:
    return None if level is None else LevelDocument(**_numbers(level, factor))


def _numbers(level: Level, factor: float) -> dict[str, float | None]:
    return {name: finite(factor * value) for name, value in asdict(level).items()}
