"""Dynamically consistent motion onto disk: complete, or nothing at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from scaling_service.capabilities.consistent.document import (
    ConsistentDocument,
    ConsistentTrial,
    GroundWrench,
    InertialEntry,
    LoopEntry,
    MarkerErrors,
    WrenchErrors,
)
from scaling_service.capabilities.consistent.estimate import Followed
from scaling_service.capabilities.consistent.recording import SPATIAL, ConsistentRecording
from scaling_service.capabilities.consistent.report import ConsistentData, TrialCurves, consistent_page
from scaling_service.capabilities.consistent.run import ConsistentResults, factors_of
from scaling_service.capabilities.dynamics.model_files import write_massive_model
from scaling_service.capabilities.motion.motion_files import write_motion
from scaling_service.capabilities.subject.hashes import input_hashes
from scaling_service.capabilities.subject.provenance import repair_notes
from scaling_service.documents.writing import REPORT, all_or_nothing, code_version, write_json
from scaling_service.model.anatomy.lengths import segment_lengths
from scaling_service.model.body import BodyModel
from scaling_service.model.massive import total_mass
from scaling_service.model.results import Motion
from scaling_service.numerics.multibody.laws import Array

FILE_NAME = "consistent.json"


def save_consistent(
    results: ConsistentResults, folder: str | Path, *, report: bool = True
) -> ConsistentDocument:
    """Write motions, ``model.*``, ``consistent.json`` and ``report.html`` into a folder.

    Returns
    -------
    ConsistentDocument
        What was written as ``consistent.json``.

    Raises
    ------
    InputError
        The folder cannot be made or written to.
    """
    with all_or_nothing(Path(folder)) as scratch:
        for recording, followed in zip(results.recordings, results.result.consistent, strict=True):
            motion = _motion(recording, followed, results.result.model)
            write_motion(scratch / f"{recording.name}_ik.mot", motion, results.result.model)
        notes = write_massive_model(scratch, results.result.model, results.prepared, factors_of(results))
        files = sorted(path.name for path in scratch.iterdir())
        document = consistent_document(results, files, notes)
        write_json(scratch / FILE_NAME, document)
        if report:
            page = consistent_page(ConsistentData(document, _curves(results)))
            (scratch / REPORT).write_text(page.html(), encoding="utf-8")
    return document


def consistent_document(
    results: ConsistentResults, files: Sequence[str] = (), notes: Sequence[str] = ()
) -> ConsistentDocument:
    """``consistent.json``, with the files and notes that writing them added."""
    prepared, result = results.prepared, results.result
    return ConsistentDocument(
        code_version=code_version(),
        subject=prepared.subject.id,
        settings=results.settings.resolved() | {"consistent": asdict(results.chosen)},
        input_hashes=input_hashes(prepared.subject, results.subject_file),
        seed=results.settings.seed,
        markers_used={name: list(labels) for name, labels in prepared.loaded.markers_used.items()},
        repairs={trial.name: repair_notes(trial.repairs) for trial in prepared.loaded.session.dynamic},
        start=prepared.start,
        inertia=prepared.inertia,
        mass_kg=round(total_mass(prepared.model), 3),
        trials={r.name: _trial(results, k) for k, r in enumerate(results.recordings)},
        inertial=[
            InertialEntry(
                segment=p.segment,
                quantity=p.quantity,
                before=p.before,
                after=p.after,
                sd=p.sd,
                moved=p.moved if p.prior_sd else 0.0,
                identifiable=p.identifiable,
            )
            for p in (result.inertial.parameters if result.inertial is not None else ())
        ],
        lengths_mm=_lengths(result.model),
        lengths_before_mm=_lengths(result.start),
        length_factors={name: round(f, 5) for name, f in result.factors.items()},
        outer_iterations=result.outer_iterations,
        converged=result.converged,
        history=[
            LoopEntry(
                marker_rms_mm=round(1e3 * markers, 3), ground_wrench_rmse=_wrench(w, results.recordings[0])
            )
            for markers, w in result.history
        ],
        warnings=[*results.warnings, *notes],
        files=list(files),
        wall_s=round(results.wall_s, 3),
    )


def _lengths(model: BodyModel) -> dict[str, float]:
    return {name: round(1e3 * length, 2) for name, length in segment_lengths(model).items()}


def _trial(results: ConsistentResults, k: int) -> ConsistentTrial:
    recording, result = results.recordings[k], results.result
    ways = {"classical": result.classical, "consistent": result.consistent, "predicted": result.predicted}
    found = {name: way[k] for name, way in ways.items()}
    forces = results.prepared.forces.get(recording.name)
    return ConsistentTrial(
        held_out=k >= results.fitted,
        forces_from=forces.source.name if forces is not None else recording.name,
        frames=int(np.isfinite(recording.wrench).all(axis=1).sum()),
        ground_wrench_rmse=WrenchErrors(**{n: _wrench(f.wrench_rmse, recording) for n, f in found.items()}),
        marker_rms_mm=MarkerErrors(**{n: round(1e3 * f.marker_rms_m, 3) for n, f in found.items()}),
        weight=found["consistent"].weight,
    )


def _wrench(values: Array, recording: ConsistentRecording) -> GroundWrench:
    fx, fy, fz, mx, my, mz = (round(float(v), 4) for v in values)
    if recording.components == SPATIAL:
        return GroundWrench(fx_N=fx, fy_N=fy, mz_Nm=mz, fz_N=fz, mx_Nm=mx, my_Nm=my)
    return GroundWrench(fx_N=fx, fy_N=fy, mz_Nm=mz)


def _motion(recording: ConsistentRecording, followed: Followed, model: BodyModel) -> Motion:
    motion = recording.motion
    return Motion(
        recording.name,
        followed.rated.times,
        model.coordinate_names,
        followed.rated.q,
        motion.markers,
        followed.gaps.marker_gaps,
        motion.estimated,
    )


def _curves(results: ConsistentResults) -> dict[str, TrialCurves]:
    result = results.result
    found = {}
    for k, recording in enumerate(results.recordings):
        measured = recording.wrench
        ways = (result.classical[k], result.consistent[k], result.predicted[k])
        modelled = [np.where(np.isfinite(measured), measured - way.gaps.wrench_gaps, np.nan) for way in ways]
        distances = [np.sqrt(np.mean(way.gaps.marker_gaps**2, axis=0).sum(axis=1)) for way in ways]
        found[recording.name] = TrialCurves(
            recording.trial.times,
            measured,
            modelled[0],
            modelled[1],
            modelled[2],
            recording.motion.markers,
            distances[0],
            distances[1],
            recording.components,
        )
    return found
