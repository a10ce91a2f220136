"""Everything of one subject into memory: the model, the recordings ready to compute with, their origin."""

from __future__ import annotations

import math
from collections import abc
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject import checks, reading
from scaling_service.capabilities.subject import rotations as subject_rotations
from scaling_service.capabilities.subject.axes import decide_axes, list_level_corners
from scaling_service.capabilities.subject.images import Imaged, place_images, read_images
from scaling_service.capabilities.subject.persons import select_person
from scaling_service.core.errors import TrialUnusable, blame_file
from scaling_service.core.notes import Note
from scaling_service.files import model_json, recording
from scaling_service.files.osim import models
from scaling_service.files.osim.setups import read_scale_setup
from scaling_service.model import body, builtin, labels
from scaling_service.model import subject as subjects
from scaling_service.model.anatomy import key_points
from scaling_service.model.anatomy.bones import assign_bones
from scaling_service.model.anatomy.knees import list_stiff_knees
from scaling_service.model.forces import PlateRecording
from scaling_service.model.trial import Trial
from scaling_service.recording import findings as recording_findings
from scaling_service.recording import orientation as orientations
from scaling_service.recording import person
from scaling_service.recording.faults import repair_markers
from scaling_service.recording.identity.identify import Identification
from scaling_service.recording.identity.tracking import with_tracking_markers
from scaling_service.recording.pipeline import clean
from scaling_service.recording.repeated import choose_repeated
from scaling_service.recording.settings import ProcessingSettings

_NOTHING: abc.Mapping[Path, recording.Recording] = MappingProxyType({})


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Loaded:
    """A session, and how its labels and axes were understood.

    ``markers_used``: model marker to the labels that were taken for it, one unless trials differ.
    ``plates``: recording to its own force plates, or why they cannot be used.
    """

    session: subjects.Session
    markers_used: abc.Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    axes: str = ""  # which laboratory axes were taken for up and forward
    orientation: orientations.Orientation | None = None  # the same as a rotation, for forces
    plates: abc.Mapping[Path, PlateRecording | TrialUnusable] = field(default_factory=dict)
    file: Path | None = None  # the subject file, where there is one

    def blame_files(self) -> AbstractContextManager[None]:
        """Let errors raised inside name the subject file, or the recording whose stem they name."""
        return blame_file(self.file, subjects.list_recordings(self.session.subject))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Files:
    """What the files of a subject hold: the model, and the recordings under labels of their own.

    ``model``: with points in space that recordings show, and without following those that software computes.
    ``vertical``: the axis along which it stands. ``static``: the recording of standing.
    """

    model: body.BodyModel
    recordings: abc.Mapping[Path, recording.Recording]
    static: Path | None
    vertical: int
    scale_setup: subjects.ScaleSetup | None
    images: Imaged | None
    notes: tuple[Note, ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Understood:
    """The recordings under the model's names, in m and turned as the session is, not yet smoothed or filled.

    ``labels``: model marker to the labels that were taken for it, one unless recordings differ. ``clusters``:
    segment to the markers on it.
    """

    subject: subjects.Subject
    trials: abc.Mapping[Path, Trial]
    labels: abc.Mapping[str, tuple[str, ...]]
    clusters: abc.Mapping[str, tuple[str, ...]]
    axes: orientations.Orientation
    notes: tuple[Note, ...]


def open_subject(
    subject: subjects.Subject | str | Path,
    settings: Settings = Settings(),
    *,
    facing: bool = False,
    rotations: bool = False,
) -> Loaded:
    """Read a subject, from its file where a path is given, and all that it names; see :func:`load`.

    ``rotations``: whether recordings of rotations without markers are wanted, apart from the others.
    Raises TrialUnusable where they are not, and there are any.
    """
    orientations.check_axes(settings.up, settings.forward)
    file = None if isinstance(subject, subjects.Subject) else Path(subject)
    known = subject if isinstance(subject, subjects.Subject) else reading.load_subject(subject)
    with blame_file(file):
        loaded = load(known, read_files(known), settings, facing=facing)
        return replace(
            loaded, session=subject_rotations.part_rotations(loaded.session, wanted=rotations), file=file
        )


def load(
    subject: subjects.Subject,
    files: Files,
    settings: Settings = Settings(),
    *,
    facing: bool = False,
    standing: bool = False,
    who: Identification | None = None,
) -> Loaded:
    """Understand, question and prepare what the files of a subject hold.

    Labels become the model's marker names, positions m with Y up, gaps are filled as the settings allow;
    everything that was changed is in each trial's ``repairs``. The body moves in the laboratory's own axes,
    as forces do in their files: only what is not Y up is turned, about a level axis.

    ``files``: by :func:`read_files`. ``facing``: whether to turn the person X forward, for results that are
    told along and across the way.
    ``standing``: whether motion stands as the model does, whose gravity may point along another axis than y.
    ``who``: what geometry tells of the labels, where it was asked already.
    Raises InputError: whatever a file or a label is not fit for; it names the file and the remedy.
    """
    with blame_file(None, files.recordings):
        understood = understand(subject, files, settings, facing=facing, standing=standing, who=who)
        findings = question(understood, files.model)
        return prepare(understood, findings, files, settings.processing)


def read_files(subject: subjects.Subject, known: abc.Mapping[Path, recording.Recording] = _NOTHING) -> Files:
    """Read the model with its bones, the recordings, the scale set-up and the images; nothing else is read.

    ``known``: recordings that were read already, by :func:`read_recordings`. Raises InputError: a file cannot
    be read, or lacks what the subject says of it.
    """
    model, of_bones = assign_bones(read_model(subject.model, subject.marker_set), subject.bone_bodies)
    labels.check_segments(subject, model)
    recordings = read_recordings(subject, known)
    every = [label for found in recordings.values() for label in found.labels]
    followed = labels.without_computed(key_points.add_key_points(model, every), subject)
    if every:
        labels.check_explicit(subject, followed, every)
    return Files(
        model=followed,
        recordings=recordings,
        static=subject.static,
        vertical=models.read_vertical(Path(subject.model)) if subject.model.lower().endswith(".osim") else 1,
        scale_setup=None if subject.scale_setup is None else read_scale_setup(subject.scale_setup),
        images=read_images(subject),
        notes=(
            *(Note(code="model", problem=text) for text in model.notes),
            *_tell_stiff_knees(model),
            *of_bones,
        ),
    )


def _tell_stiff_knees(model: body.BodyModel) -> abc.Iterator[Note]:
    for joint in list_stiff_knees(model):
        yield Note(
            code="stiff_knee",
            place=joint,
            problem="it does not move: what this knee does in recordings goes into other joints and markers",
            remedy="Unlock its coordinate in the model, unless this person's knee is stiff",
        )


def understand(
    subject: subjects.Subject,
    files: Files,
    settings: Settings,
    *,
    facing: bool = False,
    standing: bool = False,
    who: Identification | None = None,
) -> Understood:
    """Whose marker each label is, which way is up and forward, and the unit; options as in :func:`load`."""
    model, recordings = files.model, files.recordings
    marked = {path: found for path, found in recordings.items() if found.labels}
    if not marked and files.vertical != 1:
        raise TrialUnusable(
            f"the model stands along {'xyz'[files.vertical]}; rotations are followed by those along y",
            field="model",
            remedy="Turn the model so that its gravity points along -y",
        )
    subject, of_sizes = reading.with_stated_sizes(subject, recordings)
    of_tracking: tuple[Note, ...] = ()
    if marked:
        static = None if files.static is None else marked.get(files.static)
        movements = [found for path, found in marked.items() if path != files.static]
        subject, of_tracking = with_tracking_markers(subject, model, static, movements, who)
    wanted = list(dict.fromkeys([*model.marker_names, *subject.extra_markers, *subject.marker_map]))
    clusters = labels.sort_by_segment(model, subject)
    named = {}
    for path, found in marked.items():
        with blame_file(path, [path]):
            named[path] = labels.with_model_names(found.trial, wanted, subject, path)
    if marked:
        axes = decide_axes(
            {path: trial for path, (trial, _) in named.items()},
            {path: list_level_corners(found) for path, found in recordings.items()},
            model,
            settings,
            static=files.static,
            facing=facing,
            vertical=files.vertical,
        )
    else:
        first = next(iter(recordings.values()))
        axes = subject_rotations.decide_axes_of_rotations(first.trial, settings)
    axes = orientations.stand_along(axes, files.vertical) if standing else axes
    of_axes: tuple[Note, ...] = ()
    if not standing and files.vertical != 1:
        said = (
            f"the model stands along its {'xyz'[files.vertical]} axis, and motions are written with y up: "
            "lengths are its own, but in other programs these motions lie down; `scaling-service ik` on the "
            "written model follows in its own axes"
        )
        of_axes = (Note(code="lying", problem=said),)
    return Understood(
        subject=subject,
        trials={
            path: orientations.apply(axes, named[path][0])
            if path in named
            else orientations.turn_rotations(  # whose laboratory may be another
                subject_rotations.decide_axes_of_rotations(found.trial, settings), found.trial
            )
            for path, found in recordings.items()
        },
        labels={
            name: taken
            for name in wanted
            if (taken := tuple(dict.fromkeys(used[name] for _, used in named.values() if name in used)))
        },
        clusters=clusters,
        axes=axes,
        notes=(*files.notes, *of_sizes, *of_axes, *of_tracking),
    )


def question(understood: Understood, model: body.BodyModel) -> tuple[recording_findings.Finding, ...]:
    """What the recordings show that those of one sound person do not.

    Raises SubjectInvalid: two are one recording. Raises TrialUnusable: two labels of one ball. Raises
    NotAPerson: a finding beyond doubt.
    """
    subject = understood.subject
    trials = {path: trial for path, trial in understood.trials.items() if trial.labels}
    if not trials:
        return ()
    given = recording_findings.Recordings(
        trials=list(trials.values()),
        clusters=understood.clusters,
        static=trials[subject.static].name if subject.static in trials else None,
        stated=recording_findings.Stated(sex=subject.sex, height_m=subject.height_m, mass_kg=subject.mass_kg),
        model=model,
    )
    for trial in trials.values():
        checks.refuse_one_spot(model, trial)
    checks.refuse_repeated(trials, subject)
    return recording_findings.refuse(person.ask(given))


def prepare(
    understood: Understood,
    findings: abc.Iterable[recording_findings.Finding],
    files: Files,
    settings: ProcessingSettings,
) -> Loaded:
    """Smooth and fill the recordings, lock what they do not show, and add what else the files hold."""
    subject, model = understood.subject, files.model
    ready = reading.apply_to_each(
        lambda _, trial: clean(trial, understood.clusters, settings) if trial.labels else trial,
        understood.trials,
    )
    setup, of_setup = files.scale_setup, tuple[Note, ...]()
    standing = next(iter(p for p in (subject.static, *subject.calibration) if p is not None), None)
    if setup is not None and subject.scale_setup is not None and standing is not None:
        of_setup = tuple(checks.require_measurements(setup, model, ready[standing], subject.scale_setup))
    if setup is not None and setup.placement is not None:  # its marker placer leaves these alone
        fixed = frozenset(marker.name for marker in model.markers if marker.anatomical)
        setup = replace(setup, placement=replace(setup.placement, fixed=fixed))
    marked = [trial for trial in understood.trials.values() if trial.labels]
    summary = tuple(checks.summarise_recordings(model, subject, marked)) if marked else ()
    followed = list(dict.fromkeys([*model.marker_names, *subject.extra_markers]))
    images = None
    if files.images is not None:
        images = place_images(files.images, model, followed, subject.marker_map)
    seen = [label for trial in marked for label in trial.shown_labels]
    of_video = key_points.tell_key_points(model, seen)
    placed = labels.list_placed(model, subject, understood.trials.values())
    model, of_freedoms = builtin.lock_unmarked(model, placed)
    session = subjects.Session(
        subject=subject,
        model=model,
        static=None if subject.static is None else ready[subject.static],
        calibration=tuple(ready[path] for path in subject.calibration),
        evaluation=tuple(ready[path] for path in subject.evaluation),
        scale_setup=setup,
        notes=(
            *understood.notes,
            *of_freedoms,
            *of_setup,
            *(() if files.images is None else files.images.notes),
            *(of_video or summary),
            *findings,
        ),
        images=images,
    )
    return Loaded(
        session=session,
        markers_used=understood.labels,
        axes=understood.axes.description,
        orientation=understood.axes,
        plates={path: found.plates for path, found in files.recordings.items() if found.plates is not None},
    )


def read_recordings(
    subject: subjects.Subject, known: abc.Mapping[Path, recording.Recording] = _NOTHING
) -> dict[Path, recording.Recording]:
    """The recordings of all trials as their files hold them, their own faults taken out.

    Those that are ``known`` are not read again.
    """
    read = {}
    for path in subjects.list_recordings(subject):
        with blame_file(path, [path]):
            found = known[path] if path in known else repair_markers(recording.read_recording(path))
            read[path] = select_person(found, subject.marker_map)
    for path, one in zip(read, choose_repeated(list(read.values())), strict=True):
        with blame_file(path, [path]):
            wrong = subject.corrections.get(path.name, ())
            whole = one.take_unlabelled({label for item in wrong for label in item.labels})
            events = subject.events.get(path.name, whole.events)
            read[path] = replace(person.mend(whole, wrong, subject.mirrored.get(path.name)), events=events)
    return read


def read_model(name_or_path: str | Path, marker_set: str | Path | None = None) -> body.BodyModel:
    """Read a body model: a built-in one by its name, another by its path.

    Parameters
    ----------
    name_or_path : str or path
        What ends in ``.osim`` (OpenSim's) or ``.json`` (written by this program) is a path.
    marker_set : path, optional
        OpenSim markers to add; ``.osim`` only.

    Returns
    -------
    BodyModel
        Lengths in m, masses in kg.

    Raises
    ------
    InputError
        There is no such model, or it cannot be read or represented.

    Examples
    --------
    >>> import scaling_service as ss
    >>> ss.read_model("lower_limb_14dof")
    BodyModel 'lower_limb_14dof': 5 segments, 14 coordinates, 16 markers, 32.6 kg
    """
    if str(name_or_path).lower().endswith(".osim"):
        with blame_file(Path(name_or_path)):
            # The model with the whole body's place and turns unbounded: a person may walk a laboratory either
            # way. Models declare a right angle to either side and a few metres, clamped or not, so that a
            # walk back could not be followed. What hangs on the ground by a joint of fewer freedoms, as an
            # arm does, keeps its ranges.
            model = models.read_osim(Path(name_or_path), None if marker_set is None else Path(marker_set))
            free: set[str] = set()
            for segment in model.children(body.GROUND):
                driven = {
                    t.coordinate for j in segment.joints for t in j.law.terms if t.coordinate is not None
                }
                free |= driven if len(driven) >= 6 else set()  # all six directions
            coordinates = tuple(
                replace(c, lower=-math.inf, upper=math.inf, clamped=False) if c.name in free else c
                for c in model.coordinates
            )
            return replace(model, coordinates=coordinates)
    if str(name_or_path).lower().endswith(model_json.SUFFIX):
        with blame_file(Path(name_or_path)):
            return model_json.read_model_json(name_or_path)
    return builtin.load_builtin(str(name_or_path))
