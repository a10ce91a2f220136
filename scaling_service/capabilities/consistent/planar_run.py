"""The planar squat of a subject: recordings in space projected on the sagittal plane."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scaling_service.capabilities.consistent.planar import (
    SagittalPlane,
    in_plane,
    loads_in_plane,
    plane_of,
    scale_squat,
    sides_joined,
)
from scaling_service.capabilities.consistent.recording import SAGITTAL, ConsistentRecording
from scaling_service.capabilities.dynamics.forces import read_trial_forces
from scaling_service.capabilities.dynamics.inertia_table import with_inertia
from scaling_service.capabilities.dynamics.settings import AS_IT_IS, DynamicsSettings
from scaling_service.capabilities.dynamics.start import Prepared
from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.capabilities.subject.loading import blamed_on, load
from scaling_service.capabilities.subject.settings import Settings
from scaling_service.core.errors import SubjectInvalid, TrialUnusable
from scaling_service.core.progress import Progress
from scaling_service.model.anatomy.markers import PLANAR_SOURCES, canonical
from scaling_service.model.forces import GroundForces, SegmentLoads
from scaling_service.model.subject import Subject
from scaling_service.model.trial import Trial
from scaling_service.recording.plates import orient_forces
from scaling_service.recording.synchronise import synchronise

STANDING = "standing"
"""How the planar model is scaled: by the standing at the beginning (Futamure et al., section II.C.2)."""

TABLE = "winter2009"
"""The table that has the squat's own lumped segments."""


def prepare_squat(
    subject: Subject,
    chosen: DynamicsSettings,
    settings: Settings,
    *,
    progress: Progress,
) -> tuple[Prepared, dict[str, ConsistentRecording]]:
    """Project a subject's squats, scale the planar model, and follow the markers.

    Raises
    ------
    SubjectInvalid
        A method to scale by was asked for.
    TrialUnusable
        Markers or forces that the planar squat needs are missing.
    """
    if chosen.start not in (None, AS_IT_IS):
        raise SubjectInvalid(
            f"the planar squat is scaled by the standing at its beginning, not by {chosen.start}",
            field="--start",
            remedy="Leave it out",
        )
    progress("reading the recordings", 0.0)
    loaded = load(subject, settings)
    axes = loaded.orientation
    assert axes is not None  # a session that was read has axes
    paths = dict.fromkeys((*subject.calibration, *subject.evaluation))
    trials = {t.name: t for t in loaded.session.dynamic}
    planar: dict[str, tuple[Trial, SegmentLoads, SagittalPlane, Path]] = {}
    for path in paths:
        read = read_trial_forces(path, subject.forces.get(path.name))
        if read is None:
            continue
        source, raw = read
        with blamed_on(path, [path]):
            trial = sides_joined(_named(trials[path.stem]))
            plane = plane_of(trial)
        with blamed_on(source, [source]):
            forces = synchronise(orient_forces(axes, raw), trial.times, cutoff_hz=chosen.cutoff_hz)
        planar[path.stem] = (in_plane(trial, plane), loads_in_plane(_on_ground(forces), plane), plane, source)
    if not planar:
        raise TrialUnusable(
            "no movement has forces: neither plates in its C3D file nor a file of forces",
            field="forces",
            remedy="Name each trial's file of forces under `forces:`, or record with force plates",
        )
    first = next(iter(planar.values()))
    model = loaded.session.model if chosen.start == AS_IT_IS else scale_squat(loaded.session.model, first[0])
    inertia = chosen.inertia or TABLE
    massive = with_inertia(model, subject, inertia, scaled=True)
    motions = {name: inverse_kinematics(massive.model, found[0]) for name, found in planar.items()}
    recordings = {
        name: ConsistentRecording(
            trial,
            motions[name],
            loads,
            np.asarray(np.isfinite(loads.total).all(axis=1)),
            np.zeros((len(trial.times), 3)),
            SAGITTAL,
        )
        for name, (trial, loads, _, _) in planar.items()
    }
    prepared = Prepared(
        subject,
        loaded,
        chosen.start or STANDING,
        massive.inertia,
        massive.model,
        motions,
        {},
        subject.height_m or 0.0,
        None,
        (*loaded.session.warnings, *massive.notes),
    )
    return prepared, recordings


def _named(trial: Trial) -> Trial:
    """Labels of a body in space under the built-in models' names; those of the planar model stay."""
    wanted = {source for sources in PLANAR_SOURCES.values() for source in sources}
    taken = set(trial.labels)
    names: dict[str, str] = {}
    for label in trial.labels:
        known = canonical(label)
        if known in wanted and known not in taken and label not in PLANAR_SOURCES:
            names[label] = known
            taken.add(known)
    return trial.relabelled(names)


def _on_ground(forces: GroundForces) -> SegmentLoads:
    """All plates together; unknown where one of them is not known."""
    return SegmentLoads(forces.times, forces.plates, forces.force, forces.moment)
