"""Motions with their uncertainty onto disk: complete, or nothing at all."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np

from scaling_service.capabilities.motion.motion_files import write_motion, write_motion_sd
from scaling_service.capabilities.motion.poses import SegmentPoses
from scaling_service.capabilities.motion.recordings import Tracked, processing_of
from scaling_service.capabilities.motion.result import MotionDocument, TrackedTrial, trial_document
from scaling_service.capabilities.subject.hashes import input_hashes
from scaling_service.capabilities.subject.provenance import repair_notes
from scaling_service.documents.writing import all_or_nothing, code_version, write_json
from scaling_service.files.sto import Table, write_sto
from scaling_service.model.body import BodyModel

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
            _write_trial(scratch, name, trial, tracked.result.model)
        document = motion_document(tracked, sorted(path.name for path in scratch.iterdir()))
        write_json(scratch / FILE_NAME, document)
    return document


def _write_trial(folder: Path, name: str, trial: TrackedTrial, model: BodyModel) -> None:
    write_motion(folder / f"{name}_ik.mot", trial.motion, model)
    write_motion_sd(folder / f"{name}_ik_sd.mot", trial.motion, trial.uncertainty.sd, model)
    if trial.poses is not None:
        write_sto(folder / f"{name}_poses.sto", poses_table(name, trial.motion.times, trial.poses))


def poses_table(name: str, times: np.ndarray, poses: SegmentPoses) -> Table:
    """Columns as OpenSim's BodyKinematics has them: origin in ground (m), body-fixed X-Y-Z angles (deg)."""
    values = np.concatenate([poses.origins, np.degrees(poses.angles)], axis=2)
    columns = [
        f"{segment}_{part}" for segment in poses.segments for part in ("X", "Y", "Z", "Ox", "Oy", "Oz")
    ]
    return Table(
        name,
        ("time", *columns),
        np.concatenate([times[:, None], values.reshape(len(times), -1)], axis=1),
        in_degrees=True,
    )


def motion_document(tracked: Tracked, files: list[str]) -> MotionDocument:
    """``ik.json``."""
    session, model = tracked.loaded.session, tracked.result.model
    return MotionDocument(
        code_version=code_version(),
        subject=tracked.subject.id,
        model=Path(tracked.subject.model).name,
        settings=tracked.options.resolved() | {"processing": asdict(processing_of(tracked.options))},
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
