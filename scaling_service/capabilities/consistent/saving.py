"""Dynamically consistent motion onto disk: complete, or nothing at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scaling_service.capabilities.consistent import result as documents
from scaling_service.capabilities.consistent import words
from scaling_service.capabilities.consistent.estimate import TrackedRecording
from scaling_service.capabilities.consistent.recording import ConsistentRecording
from scaling_service.capabilities.consistent.result import ConsistentResults
from scaling_service.capabilities.dynamics import saving
from scaling_service.capabilities.motion.saving import write_motion
from scaling_service.capabilities.motion.tables import tabulate_coordinates
from scaling_service.capabilities.playback.scene import FOLDER
from scaling_service.core.tables import ResultTable
from scaling_service.documents import writing
from scaling_service.files.table_files import ArrayFiles
from scaling_service.model.body import BodyModel
from scaling_service.model.results import Motion
from scaling_service.report import onefile

FILE_NAME = "consistent.json"
WRENCHES_FILE = f"{FOLDER}/wrenches.json"


def save_consistent(
    results: ConsistentResults, folder: str | Path, *, report: bool = True
) -> documents.ConsistentDocument:
    """Write motions, ``model.*``, ``consistent.json`` (returned) and ``report.html`` into a folder."""
    result = results.result
    with writing.all_or_nothing(Path(folder)) as scratch:
        for recording, tracked in zip(results.recordings, result.consistent, strict=True):
            motion = _write_motion_part(recording, tracked, result.model)
            write_motion(scratch / f"{recording.name}_ik.mot", motion, result.model)
        # Each segment's factors against the generic model: of the scaling, times those of the loop.
        calibration = results.prepared.calibration
        factors = {} if calibration is None else dict(calibration.scale_factors)
        for name, factor in results.result.factors.items():
            x, y, z = factors.get(name, (1.0, 1.0, 1.0))
            factors[name] = (factor * x, factor * y, factor * z)
        notes = saving.write_massive_model(scratch, result.model, results.prepared, factors)
        document = saving.write_document(
            scratch / FILE_NAME, results.document, [*results.document.warnings, *notes]
        )
        if report:
            # `report.html`: the result's views with the ground wrench over time.
            files = onefile.collect_files(lambda folder: write_wrenches(results, folder, brief=True))
            onefile.Report(
                kind="consistent",
                name=FILE_NAME,
                summary=words.summarise(document),
                document=document,
                files=files,
                beside=document.files,
            ).write(scratch)
    return document


def tabulate_consistent(
    results: ConsistentResults, document: documents.ConsistentDocument
) -> dict[str, ResultTable]:
    """Errors in the three ways, lengths before and after, and the consistent motions, by name."""
    errors = tuple(
        (name, "held out" if trial.held_out else "used to fit", way, *wrench.model_dump().values(), off)
        for name, trial in document.trials.items()
        for (way, wrench), off in zip(
            trial.ground_wrench_rmse, trial.marker_rms_mm.model_dump().values(), strict=True
        )
    )
    components = tuple(documents.GroundWrench.model_fields)
    lengths = tuple((name, document.lengths_before_mm[name], v) for name, v in document.lengths_mm.items())
    model = results.result.model
    motions = {
        f"motion_{recording.name}": tabulate_coordinates(
            recording.name, _write_motion_part(recording, tracked, model), model, system="consistent"
        )
        for recording, tracked in zip(results.recordings, results.result.consistent, strict=True)
    }
    columns = ("trial", "role", "way", *components, "markers_mm")
    return {
        "errors": ResultTable("RMS error", columns, errors),
        "lengths": ResultTable("Segment lengths", ("segment", "start_mm", "found_mm"), lengths),
        **motions,
    }


def write_wrenches(
    results: ConsistentResults, outputs: Path, *, brief: bool = False
) -> documents.WrenchScene:
    """Write ``scene/wrenches.json`` with its tables: the ground wrench measured, and in each way.

    ``outputs``: the folder of the job's files. ``brief``: whether numbers are kept in brief.
    """
    files = ArrayFiles(outputs, FOLDER, brief=brief)
    found = {}
    for recording, ways in results.tracked:
        wrenches = {"measured": recording.wrench}
        wrenches |= {way: recording.wrench - tracked.gaps.wrench_gaps for way, tracked in ways.items()}
        times, name = recording.trial.times, recording.name
        found[name] = documents.WrenchTrial(
            start_s=float(times[0]),
            rate_hz=round(1.0 / float(np.median(np.diff(times))), 6),
            components=[bool(yes) for yes in recording.components],
            wrenches={way: files.write(f"{name}.{way}", each, "N, N m") for way, each in wrenches.items()},
        )
    document = documents.WrenchScene(trials=found)
    writing.write_json(outputs / WRENCHES_FILE, document)
    return document


def _write_motion_part(recording: ConsistentRecording, tracked: TrackedRecording, model: BodyModel) -> Motion:
    motion = recording.motion
    return Motion(
        trial=recording.name,
        times=tracked.rated.times,
        coordinates=model.coordinate_names,
        q=tracked.rated.q,
        markers=motion.markers,
        residuals=tracked.gaps.marker_gaps,
        estimated=motion.estimated,
    )
