"""Recordings of rotations without markers: which way is up in them, and that they stand apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scaling_service.capabilities.shared.settings import Settings
from scaling_service.core.arrays import Array
from scaling_service.core.errors import TrialUnusable
from scaling_service.core.notes import Note
from scaling_service.model import trial as trials
from scaling_service.model.anatomy.rotations import read_rotation_table
from scaling_service.model.subject import Session
from scaling_service.recording import orientation


def decide_axes_of_rotations(trial: trials.Trial, settings: Settings) -> orientation.Orientation:
    """Which axes of a recording without markers point up and forward.

    Of a markerless system by where thighs and feet are, else by the segments' upright axis as documented;
    where sensors' world is up shows with a model alone (see ``motion/mounting.py``), so that it is kept here
    unless it is given.
    """
    held, table = trial.rotations, read_rotation_table()
    assert held is not None
    if held.of == "sensors" and settings.up is None:
        return orientation.Orientation(np.eye(3))
    upright = None
    if held.of == "segments":
        upright = _find_upright_of_segments(held, int(np.abs(table.axes[1]).argmax()))
    points = held.origins
    if points is None:  # a stick of one metre that stands
        ends = np.stack([np.zeros(3), np.zeros(3) + (np.ones(3) if upright is None else upright)])
        points = np.broadcast_to(ends, (trial.n_frames, 2, 3))
    labels = tuple(f"point {k}" for k in range(points.shape[1]))
    as_points = replace(trial, labels=labels, markers=points, rotations=None)
    return orientation.decide(
        as_points, up=settings.up, forward=settings.forward, upright=upright, facing=False
    )


def _find_upright_of_segments(held: trials.Rotations, axis: int) -> Array:
    """Where a body is upright on average, (3,). ``axis``: of the segments' own that is said to be so."""

    def list_rows(part: str) -> list[int]:
        return [k for k, label in enumerate(held.labels) if part in label.lower()]

    high, low = list_rows("thigh"), list_rows("foot")
    if held.origins is not None and high and low:
        along = np.nanmean(
            held.origins[:, high] - held.origins[:, low].mean(axis=1, keepdims=True), axis=(0, 1)
        )
        return np.asarray(along / np.linalg.norm(along))
    trunk = list_rows("pelvis") + list_rows("torso")
    return np.asarray(np.nanmean(held.matrices[:, trunk or slice(None), :, axis], axis=(0, 1)))


def part_rotations(session: Session, *, wanted: bool) -> Session:
    """The session with recordings of rotations without markers apart."""
    turned = {
        path: trial
        for path, trial in zip(
            (*session.subject.calibration, *session.subject.evaluation),
            (*session.calibration, *session.evaluation),
            strict=True,
        )
        if not trial.labels
    }
    marked = {trial.name for trial in (*session.calibration, *session.evaluation) if trial.labels}
    beside = [trial.name for trial in turned.values() if trial.name in marked]
    turned = {path: trial for path, trial in turned.items() if trial.name not in marked}
    stood = session.static if session.static is not None and not session.static.labels else None
    if (turned or stood) and not wanted:
        raise TrialUnusable(
            "it holds rotations and no markers, which `ik` and `scale` take, and nothing else does",
            file=str(next(iter(turned), session.subject.static)),
            field="trials",
            remedy="Follow it by `scaling-service ik`, and leave it out here",
        )
    both = [
        t.name
        for t in (session.static, *session.calibration, *session.evaluation)
        if t and t.labels and t.rotations is not None
    ]
    unused = [
        Note(
            code="rotations_unused",
            place=name,
            problem="its rotations are not used, its markers are",
            remedy="Follow it by `scaling-service ik`, which takes both",
        )
        for name in (*both, *beside)
    ]
    return replace(
        session,
        notes=(*session.notes, *unused),
        static=None if stood else session.static,
        calibration=tuple(t for t in session.calibration if t.labels),
        evaluation=tuple(t for t in session.evaluation if t.labels),
        rotations=tuple(turned.values()),
        standing_rotations=stood,
    )
