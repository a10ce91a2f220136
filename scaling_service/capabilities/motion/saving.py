"""Motions with their uncertainty onto disk: complete, or nothing at all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scaling_service.capabilities.motion.document import (
    KinematicErrorDocument,
    MotionDocument,
    TrackedTrialDocument,
)
from scaling_service.capabilities.motion.motion_files import write_motion, write_motion_sd
from scaling_service.capabilities.motion.poses import poses_table
from scaling_service.capabilities.motion.run import Tracked, TrackedTrial
from scaling_service.capabilities.subject.provenance import repair_notes
from scaling_service.capabilities.subject.reading import input_hashes
from scaling_service.documents.writing import all_or_nothing, code_version, write_json
from scaling_service.files.sto import write_sto
from scaling_service.model.body import BodyModel
from scaling_service.recording.settings import ProcessingSettings

FILE_NAME = "ik.json"


def save_motions(tracked: Tracked, folder: str | Path) -> MotionDocument:
    """Write every trial's ``_ik.mot`` and ``_ik_sd.mot``, ``_poses.sto`` where asked for, and ``ik.json``.

    Parameters
    ----------
    tracked : Tracked
    folder : path
        Made if it does not exist. Other files in it stay.

    Returns
    -------
    MotionDocument
        What was written as ``ik.json``.

    Raises
    ------
    InputError
        The folder cannot be made or written to.
    """
    with all_or_nothing(Path(folder)) as scratch:
        for name, trial in tracked.result.trials.items():
            write_motion(scratch / f"{name}_ik.mot", trial.motion, tracked.result.model)
            write_motion_sd(
                scratch / f"{name}_ik_sd.mot", trial.motion, trial.uncertainty.sd, tracked.result.model
            )
            if trial.poses is not None:
                write_sto(scratch / f"{name}_poses.sto", poses_table(name, trial.motion.times, trial.poses))
        document = _document(tracked, sorted(path.name for path in scratch.iterdir()))
        write_json(scratch / FILE_NAME, document)
    return document


def _document(tracked: Tracked, files: list[str]) -> MotionDocument:
    """``ik.json``."""
    session, model = tracked.loaded.session, tracked.result.model
    processing = ProcessingSettings.smoothed(tracked.options.smooth_hz)
    return MotionDocument(
        code_version=code_version(),
        subject=tracked.subject.id,
        model=Path(tracked.subject.model).name,
        settings=tracked.options.resolved() | {"processing": processing.resolved()},
        input_hashes=input_hashes(tracked.subject, tracked.subject_file),
        seed=0,
        markers_used={name: list(labels) for name, labels in tracked.loaded.markers_used.items()},
        axes=tracked.loaded.axes,
        repairs={trial.name: repair_notes(trial.repairs) for trial in session.evaluation},
        locked=[c.name for c in model.coordinates if c.locked],
        trials={name: trial_document(trial, model) for name, trial in tracked.result.trials.items()},
        warnings=list(session.warnings),
        files=files,
        wall_s=round(tracked.wall_s, 3),
    )


def trial_document(tracked: TrackedTrial, model: BodyModel) -> TrackedTrialDocument:
    """One trial's part of ``ik.json``."""
    motion, spread = tracked.motion, tracked.uncertainty
    locked = {c.name for c in model.coordinates if c.locked}
    return TrackedTrialDocument(
        kinematic_error_mm=KinematicErrorDocument(
            mean=_mm(tracked.error.mean),
            rms=_mm(tracked.error.rms),
            max=_mm(tracked.error.max),
            per_marker={name: _mm(value) for name, value in tracked.error.per_marker.items()},
        ),
        not_determined=[n for n in motion.coordinates if n not in locked and n not in motion.estimated],
        frames_not_determined=_counts(motion.coordinates, np.isnan(motion.q).sum(axis=0).tolist()),
        frames_at_range_end=_counts(motion.coordinates, spread.at_range_end.sum(axis=0).tolist()),
        marker_noise_mm={
            name: _mm(sd)
            for name, sd in zip(motion.markers, spread.noise.tolist(), strict=True)
            if np.isfinite(sd)
        },
        frames=len(motion.times),
    )


def _counts(names: Sequence[str], counts: Sequence[int]) -> dict[str, int]:
    return {name: count for name, count in zip(names, counts, strict=True) if count}


def _mm(metres: float) -> float:
    return round(1e3 * metres, 4)
