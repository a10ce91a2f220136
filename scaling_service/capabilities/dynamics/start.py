"""What dynamics starts from: a model of the person with mass, its motions, and the forces on its feet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from scaling_service.capabilities.dynamics.feet import feet_of, foot_markers
from scaling_service.capabilities.dynamics.forces import TrialForces, read_trial_forces, trial_forces
from scaling_service.capabilities.dynamics.inertia_table import with_inertia
from scaling_service.capabilities.dynamics.settings import AS_IT_IS as AS_IT_IS
from scaling_service.capabilities.dynamics.settings import PLAIN, UNSMOOTHED, DynamicsSettings
from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.capabilities.scaling import run as tasks
from scaling_service.capabilities.subject.loading import Loaded, blamed_on, load, recordings
from scaling_service.capabilities.subject.reading import load_subject
from scaling_service.capabilities.subject.settings import Settings
from scaling_service.core.errors import SubjectInvalid, TrialUnusable
from scaling_service.core.progress import Progress
from scaling_service.core.text import few
from scaling_service.model.body import BodyModel
from scaling_service.model.forces import GroundForces
from scaling_service.model.results import Calibration, Motion
from scaling_service.model.subject import Subject
from scaling_service.recording.orientation import check_axes

Read = tuple[Path, GroundForces]
"""A file and the forces in it."""


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """Everything that dynamics needs, in memory.

    Parameters
    ----------
    subject : Subject
    loaded : Loaded
    start : str
        The method that scaled the model, or ``AS_IT_IS``.
    inertia : str
        A table's name, or ``model``.
    model : BodyModel
        Of the person's size and mass.
    motions : mapping
        Of the trials with forces, by their stems.
    forces : mapping
        Of the same trials, at the times of their motions.
    height_m : float
    calibration : Calibration, optional
        How the model was scaled; None for the given model.
    warnings : tuple of str
    """

    subject: Subject
    loaded: Loaded
    start: str
    inertia: str
    model: BodyModel
    motions: Mapping[str, Motion]
    forces: Mapping[str, TrialForces]
    height_m: float
    calibration: Calibration | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class _Started:
    method: str
    calibration: Calibration | None
    model: BodyModel
    motions: Mapping[str, Motion]
    warnings: tuple[str, ...]


def prepare(
    subject: Subject | str | Path,
    chosen: DynamicsSettings = PLAIN,
    settings: Settings = UNSMOOTHED,
    *,
    progress: Progress | None = None,
) -> Prepared:
    """Read a subject's recordings with forces, scale its model, and follow the markers.

    Parameters
    ----------
    subject : Subject or path of a subject file
    chosen : DynamicsSettings
    settings : Settings
    progress : callable, optional

    Raises
    ------
    InputError
        Whatever in the subject file, the model, the recordings or their forces cannot be used.
    """
    file = None if isinstance(subject, Subject) else Path(subject)
    chosen.check()
    check_axes(settings.up, settings.forward)
    known = subject if isinstance(subject, Subject) else load_subject(Path(subject))
    with blamed_on(file):
        read = _forces_read(known)
        loaded = load(known, settings)
        known = loaded.session.subject  # with what the recordings state
        height = _height(known)
        feet_of(loaded.session.model)
        with blamed_on(None, recordings(known)):
            forces = _forces(loaded, known, read, chosen.cutoff_hz)
            started = _started(loaded, settings, chosen.start, tuple(forces), progress)
            massive = with_inertia(started.model, known, chosen.inertia, scaled=started.method != AS_IT_IS)
    return Prepared(
        known,
        loaded,
        started.method,
        massive.inertia,
        massive.model,
        started.motions,
        forces,
        height,
        started.calibration,
        (*loaded.session.warnings, *started.warnings, *massive.notes, *_left_out(known, read)),
    )


def _height(subject: Subject) -> float:
    if subject.height_m is None:
        raise SubjectInvalid(
            "residuals are told in shares of body weight times height, and no height is given",
            field="subject.height_m",
            remedy="Give the person's stature in m",
        )
    return subject.height_m


def _forces_read(subject: Subject) -> dict[Path, Read]:
    """Every movement's forces, of those that have some."""
    moving = dict.fromkeys((*subject.calibration, *subject.evaluation))
    found = {path: read_trial_forces(path, subject.forces.get(path.name)) for path in moving}
    read = {path: forces for path, forces in found.items() if forces is not None}
    if not read:
        raise TrialUnusable(
            "no movement has forces: neither plates in its C3D file nor a file of forces",
            field="forces",
            remedy="Name each trial's file of forces under `forces:`, or record with force plates",
        )
    return read


def _left_out(subject: Subject, read: Mapping[Path, Read]) -> tuple[str, ...]:
    without = [path.stem for path in (*subject.calibration, *subject.evaluation) if path not in read]
    return (f"{few(list(dict.fromkeys(without)))}: no forces, so no dynamics",) if without else ()


def _forces(
    loaded: Loaded, subject: Subject, read: Mapping[Path, Read], cutoff_hz: float
) -> dict[str, TrialForces]:
    session, axes = loaded.session, loaded.orientation
    assert axes is not None  # a session that was read has axes
    trials = {trial.name: trial for trial in session.dynamic}
    found = {}
    for path, (source, forces) in read.items():
        trial = trials[path.stem]
        feet = foot_markers(session.model, trial, subject.extra_markers)
        found[path.stem] = trial_forces(source, forces, trial, feet, axes, cutoff_hz=cutoff_hz)
    return found


def _started(
    loaded: Loaded,
    settings: Settings,
    start: str | None,
    wanted: tuple[str, ...],
    progress: Progress | None,
) -> _Started:
    session = loaded.session
    method = start or ("EB_am" if session.images is not None else "MB_am")
    if method == AS_IT_IS:
        motions = {t.name: inverse_kinematics(session.model, t) for t in session.dynamic if t.name in wanted}
        return _Started(method, None, session.model, motions, ())
    results = tasks.run(loaded, (method,), settings, progress=progress)
    scaling = results.scalings[method]
    told = [w for w in results.warnings if w not in session.warnings]
    return _Started(
        method,
        scaling.calibration,
        scaling.calibration.model,
        {name: motion for name, motion in scaling.motions.items() if name in wanted},
        (*told, *scaling.calibration.warnings),
    )
