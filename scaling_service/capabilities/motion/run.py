"""The motion of recordings with a model that exists, from files to a result in memory."""

from __future__ import annotations

import time
from collections import abc
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from scaling_service.capabilities.motion import clinical_angles, inverse_kinematics, result
from scaling_service.capabilities.motion import everyday as ordinary
from scaling_service.capabilities.motion import kinematic_error as kinematic_errors
from scaling_service.capabilities.motion import uncertainty as uncertainties
from scaling_service.capabilities.motion.beside_markers import join_recordings
from scaling_service.capabilities.motion.mounting import mount
from scaling_service.capabilities.motion.options import MotionOptions
from scaling_service.capabilities.motion.task import Task
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.files import read_files
from scaling_service.capabilities.subject.loading import load
from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError, blame_file
from scaling_service.core.notes import Note
from scaling_service.core.progress import Progress, show_nothing
from scaling_service.documents.subject import MODEL_SUFFIXES
from scaling_service.files.osim.setups import read_body_frames
from scaling_service.files.recording import READERS
from scaling_service.model import poses
from scaling_service.model import subject as subjects
from scaling_service.model.anatomy.frames import SIDES
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import BUILTIN_NAMES
from scaling_service.model.trial import Trial
from scaling_service.recording.orientation import check_axes
from scaling_service.recording.same_person import ask_same_person
from scaling_service.recording.settings import ProcessingSettings

_READING = 0.2  # chosen: about the share of reading and processing


def ik(
    model: str | Path,
    recordings: abc.Sequence[str | Path],
    options: MotionOptions = MotionOptions(),
    *,
    marker_set: str | Path | None = None,
    standing: str | Path | None = None,
    subject: str = "",
    subject_file: Path | None = None,
    progress: Progress | None = None,
) -> result.Tracked:
    """Follow recordings with a model that exists.

    Parameters
    ----------
    model : str or path
        A built-in name, an ``.osim`` file, or the ``model.json`` that scaling, dynamics, consistent or
        discovery wrote.
    recordings : sequence of path
        C3D or TRC files of markers, C3D files of segment poses (Theia3D), STO files of sensors' orientations
        (OpenSense). One decision on the laboratory's axes is taken for all.
    options : MotionOptions
        How recordings are read and followed.
    marker_set : path, optional
        OpenSim markers to add; ``.osim`` only.
    standing : path, optional
        Sensors' orientations while the person stands as the model does by default: they tell how sensors are
        put on. The first frame of the first recording is taken so unless it is given, or sensors have the
        axes of their segments.
    subject : str
        Whose recordings they are, for the document.
    subject_file : Path, optional
        Files beside it are named relative to it in the document.
    progress : callable, optional
        Called with what is being done and the share that is done, 0 to 1.

    Returns
    -------
    Tracked
        The motion of every recording with its standard deviations.

    Raises
    ------
    InputError
        Something in the model or the recordings cannot be used.

    Notes
    -----
    Least squares over all markers of a frame (Lu & O'Connor 1999, J Biomech 32:129-134).

    Examples
    --------
    >>> import scaling_service as ss
    >>> tracked = ss.ik("compared/MB/model.json", ["lab/gait_1.trc", "lab/gait_2.trc"])
    >>> tracked.errors.to_frame()["trial"].tolist()
    ['gait_1', 'gait_2']
    """
    clock = time.perf_counter()
    report = progress or show_nothing
    check_axes(options.up, options.forward)
    files = tuple(Path(path).absolute() for path in recordings)
    if not files:
        raise InputError(
            "no recording is given", field="recordings", remedy="Name at least one C3D, TRC or STO"
        )
    by_stem: dict[str, Path] = {}
    for file in files:
        other = by_stem.get(file.stem)
        # One of markers and one of sensors are one movement.
        if other is not None and (file.suffix.lower() == ".sto") == (other.suffix.lower() == ".sto"):
            raise InputError(
                f"it and '{other}' have the same name without suffix",
                file=file,
                field="recordings",
                remedy="Results are named by it: leave one out, or rename one",
            )
        by_stem[file.stem] = file
    name = str(model)
    if marker_set is not None and not name.lower().endswith(".osim"):
        raise InputError(
            f"a marker set belongs to .osim models only, and the model is '{name}'",
            field="marker_set",
            remedy="Leave it out, or give the path of an .osim file",
        )
    if name.lower().endswith(MODEL_SUFFIXES):
        place = str(Path(name).absolute())
    else:
        if Path(name).suffix.lower() in READERS or name not in BUILTIN_NAMES:
            raise InputError(
                f"'{name}' is no model",
                field="model",
                remedy=f"Give one of {', '.join(BUILTIN_NAMES)}, or the path of an .osim file or "
                "a model.json",
            )
        place = name
    places = subjects.Subject(
        id=subject,
        model=place,
        marker_set=None if marker_set is None else Path(marker_set),
        marker_map=dict(options.markers),
        static=None if standing is None else Path(standing).absolute(),
        evaluation=files,
    )
    report("reading the recordings", 0.0)
    processing = ProcessingSettings.smoothed(options.smooth_hz)
    settings = Settings(processing=processing, up=options.up, forward=options.forward)
    with _without_subject_file(), blame_file(None, files):
        read = read_files(places)
        loaded = replace(load(places, read, settings, standing=not options.angles), file=subject_file)
        session, found = loaded.session, {}
        trials, mounted = join_recordings(session.evaluation), None
        if any(trial.rotations is not None for trial in trials):
            stood = session.static if session.static and session.static.rotations else None
            placed = _list_frames(session.subject)
            mounted = mount(session.model, trials, stood, placed=placed, turned=options.up is not None)
            trials = mounted.trials
            session = replace(session, notes=(*session.notes, *mounted.notes))
        told = (note for trial in trials for note in _ask_whose_model(session.model, trial))
        loaded = replace(loaded, session=replace(session, notes=(*session.notes, *told)))
        for k, trial in enumerate(trials):
            report(f"following {trial.name}", _READING + (1.0 - _READING) * k / len(trials))
            own = session.model if mounted is None or trial.rotations is None else mounted.model
            found[trial.name] = track(own, trial, skin=not options.bone_pins, angles=options.angles)
    report("done", 1.0)
    return result.Tracked(loaded, found, options, time.perf_counter() - clock)


def _ask_whose_model(model: BodyModel, trial: Trial) -> abc.Iterator[Note]:
    """Whether the recording can be of the model's person: its markers in one pose are one more recording."""
    at = poses.pose_neutral_markers(model)
    if not at:
        return
    places = np.array([[at[name] for name in at]])
    likeness = Trial(name="the model", times=np.zeros(1), labels=tuple(at), markers=places, rate_hz=1.0)
    for found in ask_same_person((trial, likeness)):
        yield Note(
            code=found.code,
            place=trial.name,
            problem=found.problem,
            remedy="Scale the model by a recording of this person and this placement of the markers",
            hint="scale the model by a recording of this person and this placement",
        )


def track(model: BodyModel, trial: Trial, *, skin: bool = True, angles: bool = False) -> result.TrackedTrial:
    """Track one trial, in the session's axes and with the model's marker names.

    ``skin``: whether standard deviations hold what skin does over the bone. ``angles``: whether to give the
    conventional angles, too. Raises ModelRefused: they are asked of a model that has none.
    """
    names, rates = clinical_angles.compute_clinical_rates(model) if angles else ((), None)
    task = Task.of(model, trial)
    everyday = (skin or any(m.is_direction for m in model.markers)) and model.knows_its_person
    q, motion = inverse_kinematics.follow_task(task, trial, everyday=everyday)
    # What is not determined in a frame is NaN there, what is so in no frame stands at its default.
    ever = np.array([name in motion.estimated for name in motion.coordinates]) | ~task.free
    known = np.isfinite(motion.q) & ever
    if everyday:
        uncertainty = ordinary.estimate_everyday_sd(model, trial, task, q, known, rates)
    else:
        fields = tuple(uncertainties.list_skin_fields(task)) if skin else ()
        uncertainty = uncertainties.estimate_coordinate_sd(task, q, motion.residuals, known, fields, rates)
        if skin and model.departures:
            departures = dict(model.departures)
            own = np.array([departures.get(name, np.nan) for name in model.coordinate_names])
            uncertainty = uncertainties.count_departures(uncertainty, own, q, rates)
        uncertainty = replace(uncertainty, sd=task.ranges.combine(uncertainty.sd))
    conventional, combined = None, uncertainty.combined
    if combined is not None:
        sd = {s: {a: combined[:, k] for k, (side, a) in enumerate(names) if side == s} for s in SIDES}
        conventional = replace(clinical_angles.compute_clinical_angles(model, motion), sd=sd)
    error = kinematic_errors.kinematic_error(motion, model)
    return result.TrackedTrial(motion, uncertainty, error, conventional)


def follow_rotations(
    model: BodyModel, session: subjects.Session, *, turned: bool
) -> tuple[dict[str, result.TrackedTrial], tuple[Note, ...]]:
    """A session's recordings of rotations as a scaled model follows them, and what to tell of their mounting.

    ``turned``: whether the session's axes are those of the sensors' world.
    """
    if not session.rotations:
        return {}, ()
    placed = _list_frames(session.subject)
    mounted = mount(model, session.rotations, session.standing_rotations, placed=placed, turned=turned)
    return {trial.name: track(mounted.model, trial) for trial in mounted.trials}, mounted.notes


def _list_frames(subject: subjects.Subject) -> dict[str, tuple[str, Array]]:
    """Frames that the subject's OpenSim model has on its bodies, as OpenSense's IMU placer leaves them."""
    model = subject.model
    return read_body_frames(Path(model)) if model.lower().endswith(".osim") else {}


@contextmanager
def _without_subject_file() -> abc.Iterator[None]:
    """Let remedies that speak of a subject file say where labels are mapped here."""
    try:
        yield
    except InputError as error:
        if error.remedy is not None:
            error.remedy = error.remedy.replace(
                "under `markers:` in the subject file", "by --marker MARKER=LABEL (`markers` over HTTP)"
            ).partition("; or say in the subject file")[0]
        raise
