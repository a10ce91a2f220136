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
from scaling_service.capabilities.motion.motion_files import (
    poses_table,
    write_clinical_angles,
    write_motion,
    write_motion_sd,
)
from scaling_service.capabilities.motion.run import Tracked, TrackedTrial
from scaling_service.capabilities.subject.loading import provenance
from scaling_service.documents.writing import all_or_nothing, write_json
from scaling_service.files.sto import write_sto
from scaling_service.model.body import BodyModel
from scaling_service.recording.settings import ProcessingSettings

FILE_NAME = "ik.json"


def save_motions(tracked: Tracked, folder: str | Path) -> MotionDocument:
    """Write every trial's motion and standard deviations, ``ik.json``, and what else is asked for.

    Parameters
    ----------
    tracked : Tracked
        From :func:`ik`.
    folder : path
        Made if it does not exist. Other files in it stay.

    Returns
    -------
    MotionDocument
        What was written as ``ik.json``: errors in mm.

    Raises
    ------
    InputError
        The folder cannot be made or written to.

    Examples
    --------
    >>> import scaling_service as ss
    >>> document = ss.save_motions(ss.ik("compared/MB/model.json", ["lab/gait_1.trc"]), "followed")
    >>> list(document.trials)
    ['gait_1']
    """
    model = tracked.loaded.session.model
    with all_or_nothing(Path(folder)) as scratch:
        for name, trial in tracked.trials.items():
            write_motion(scratch / f"{name}_ik.mot", trial.motion, model)
            write_motion_sd(scratch / f"{name}_ik_sd.mot", trial.motion, trial.uncertainty.sd, model)
            if trial.angles is not None:
                write_clinical_angles(scratch, trial.angles)
            if tracked.options.poses:
                write_sto(scratch / f"{name}_poses.sto", poses_table(trial.motion, model))
        document = _document(tracked, sorted(path.name for path in scratch.iterdir()))
        write_json(scratch / FILE_NAME, document)
    return document


def _document(tracked: Tracked, files: list[str]) -> MotionDocument:
    loaded, session, options = tracked.loaded, tracked.loaded.session, tracked.options
    processing = ProcessingSettings.smoothed(options.smooth_hz).resolved()
    settings = options.resolved() | {"processing": processing}
    return MotionDocument(
        **provenance(loaded, session.evaluation, settings),
        model=Path(session.subject.model).name,
        axes=loaded.axes,
        units={c.name: "deg" if c.kind == "rotation" else "m" for c in session.model.coordinates},
        locked=[c.name for c in session.model.coordinates if c.locked],
        trials={name: trial_document(trial, session.model) for name, trial in tracked.trials.items()},
        warnings=list(session.warnings),
        files=files,
        wall_s=round(tracked.wall_s, 3),
    )


def trial_document(tracked: TrackedTrial, model: BodyModel) -> TrackedTrialDocument:
    """One trial's part of ``ik.json``."""
    motion, spread = tracked.motion, tracked.uncertainty
    locked = {c.name for c in model.coordinates if c.locked}
    error = tracked.error
    return TrackedTrialDocument(
        kinematic_error_mm=KinematicErrorDocument(
            mean=_mm(error.mean),
            rms=_mm(error.rms),
            max=_mm(error.max),
            per_marker={name: _mm(value) for name, value in error.per_marker.items()},
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
