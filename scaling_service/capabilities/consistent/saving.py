"""Dynamically consistent motion onto disk: complete, or nothing at all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from scaling_service.capabilities.consistent.document import (
    ConsistentDocument,
    ConsistentTrial,
    GroundWrench,
    InertialEntry,
    LoopEntry,
    MarkerErrors,
    WrenchErrors,
)
from scaling_service.capabilities.consistent.estimate import TrackedRecording
from scaling_service.capabilities.consistent.recording import ConsistentRecording
from scaling_service.capabilities.consistent.report import consistent_page
from scaling_service.capabilities.consistent.run import ConsistentResults
from scaling_service.capabilities.dynamics.saving import provenance_of, write_massive_model
from scaling_service.capabilities.motion.saving import write_motion
from scaling_service.documents.writing import REPORT, all_or_nothing, write_json
from scaling_service.model.anatomy.lengths import segment_lengths
from scaling_service.model.body import BodyModel
from scaling_service.model.inertia import total_mass
from scaling_service.model.results import Motion
from scaling_service.numerics.multibody.laws import Array

FILE_NAME = "consistent.json"


def save_consistent(
    results: ConsistentResults, folder: str | Path, *, report: bool = True
) -> ConsistentDocument:
    """Write motions, ``model.*``, ``consistent.json`` (returned) and ``report.html`` into a folder."""
    result = results.result
    with all_or_nothing(Path(folder)) as scratch:
        for recording, tracked in zip(results.recordings, result.consistent, strict=True):
            motion = _motion(recording, tracked, result.model)
            write_motion(scratch / f"{recording.name}_ik.mot", motion, result.model)
        notes = write_massive_model(scratch, result.model, results.prepared, _factors(results))
        document = _document(results, sorted(path.name for path in scratch.iterdir()), notes)
        write_json(scratch / FILE_NAME, document)
        if report:
            (scratch / REPORT).write_text(consistent_page(document, results).html(), encoding="utf-8")
    return document


def _factors(results: ConsistentResults) -> dict[str, tuple[float, float, float]]:
    """Each segment's factors against the generic model: of the scaling, times those of the loop."""
    calibration = results.prepared.calibration
    factors = {} if calibration is None else dict(calibration.scale_factors)
    for name, factor in results.result.factors.items():
        x, y, z = factors.get(name, (1.0, 1.0, 1.0))
        factors[name] = (factor * x, factor * y, factor * z)
    return factors


def _motion(recording: ConsistentRecording, tracked: TrackedRecording, model: BodyModel) -> Motion:
    motion = recording.motion
    return Motion(
        recording.name,
        tracked.rated.times,
        model.coordinate_names,
        tracked.rated.q,
        motion.markers,
        tracked.gaps.marker_gaps,
        motion.estimated,
    )


def _document(results: ConsistentResults, files: Sequence[str], notes: Sequence[str]) -> ConsistentDocument:
    """``consistent.json``, with the files and notes that writing them added."""
    prepared, result = results.prepared, results.result
    return ConsistentDocument(
        **provenance_of(prepared, results.settings, consistent=results.chosen),
        mass_kg=round(total_mass(prepared.model), 3),
        trials={
            recording.name: _trial(results, recording, ways, held_out=k >= results.fitted)
            for k, (recording, ways) in enumerate(results.tracked)
        },
        inertial=[InertialEntry.model_validate(p, from_attributes=True) for p in result.inertial.parameters],
        lengths_mm=_lengths(result.model),
        lengths_before_mm=_lengths(result.start),
        length_factors={name: round(f, 5) for name, f in result.factors.items()},
        outer_iterations=result.outer_iterations,
        converged=result.converged,
        history=[
            LoopEntry(marker_rms_mm=_mm(markers), ground_wrench_rmse=_wrench(w, results.recordings[0]))
            for markers, w in result.history
        ],
        warnings=[*results.warnings, *notes],
        files=list(files),
        wall_s=round(results.wall_s, 3),
    )


def _trial(
    results: ConsistentResults,
    recording: ConsistentRecording,
    ways: Mapping[str, TrackedRecording],
    *,
    held_out: bool,
) -> ConsistentTrial:
    forces = results.prepared.forces.get(recording.name)
    return ConsistentTrial(
        held_out=held_out,
        forces_from=forces.source.name if forces is not None else recording.name,
        frames=int(recording.known.sum()),
        ground_wrench_rmse=WrenchErrors(**{n: _wrench(w.wrench_rmse, recording) for n, w in ways.items()}),
        marker_rms_mm=MarkerErrors(**{n: _mm(w.marker_rms_m) for n, w in ways.items()}),
        weight=ways["consistent"].weight,
    )


def _wrench(values: Array, recording: ConsistentRecording) -> GroundWrench:
    named = zip(
        ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"), values, recording.components, strict=True
    )
    return GroundWrench(**{name: round(float(value), 4) for name, value, counts in named if counts})


def _lengths(model: BodyModel) -> dict[str, float]:
    return {name: round(1e3 * length, 2) for name, length in segment_lengths(model).items()}


def _mm(metres: float) -> float:
    return round(1e3 * metres, 3)
