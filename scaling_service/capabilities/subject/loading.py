"""Everything of one subject into memory: the model, the recordings ready to compute with, their origin."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from scaling_service.bones.images import SEGMENTATION, read_bones
from scaling_service.bones.results import BoneLandmarks, MeshRefused
from scaling_service.bones.whole import check_joined, collect_evidence, find_landmarks
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject import checks, labels
from scaling_service.capabilities.subject.axes import decide_axes, list_level_corners
from scaling_service.capabilities.subject.persons import select_person
from scaling_service.capabilities.subject.reading import (
    blame_file,
    hash_input_files,
    list_recordings,
    load_subject,
)
from scaling_service.core.errors import TrialUnusable
from scaling_service.documents.results import RepairNote
from scaling_service.documents.subject import SIZE_UNIT
from scaling_service.documents.writing import code_version
from scaling_service.files.image_markers import read_image_markers
from scaling_service.files.model_json import SUFFIX, read_model_json
from scaling_service.files.osim.models import read_osim, read_vertical
from scaling_service.files.osim.setups import read_scale_setup
from scaling_service.files.recording import Recording, read_recording
from scaling_service.model.anatomy.bones import assign_bones, find_body
from scaling_service.model.anatomy.markers import match_labels
from scaling_service.model.body import GROUND, BodyModel, Segment, Vector
from scaling_service.model.builtin import BUILTIN_NAMES, load_builtin, lock_unmarked
from scaling_service.model.forces import PlateRecording
from scaling_service.model.subject import ScaleSetup, Session, Subject
from scaling_service.model.trial import Bone, ImageEvidence, MeasuredSizes, Repair, Trial, merge
from scaling_service.recording import person
from scaling_service.recording.faults import repair_markers
from scaling_service.recording.findings import Finding, Recordings, Stated, refuse
from scaling_service.recording.orientation import Orientation, apply, check_axes, stand_along
from scaling_service.recording.pipeline import process
from scaling_service.recording.repeated import choose_repeated

_NOTHING: Mapping[Path, Recording] = MappingProxyType({})

_TURNED = (
    "the model stands along its {axis} axis, and motions are written with y up: lengths are its own, but in "
    "other programs these motions lie down; `scaling-service ik` on the written model follows in its own axes"
)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Loaded:
    """A session, and how its labels and axes were understood.

    ``markers_used``: model marker to the labels that were taken for it, one unless trials differ.
    ``plates``: recording to its own force plates, or why they cannot be used.
    """

    session: Session
    markers_used: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()  # what a sound person does not show; told among the warnings
    axes: str = ""  # which laboratory axes were taken for up and forward
    orientation: Orientation | None = None  # the same as a rotation, for forces
    plates: Mapping[Path, PlateRecording | TrialUnusable] = field(default_factory=dict)
    file: Path | None = None  # the subject file, where there is one

    @contextmanager
    def blame_files(self) -> Iterator[None]:
        """Let errors raised inside name the subject file, or the recording whose stem they name."""
        with blame_file(self.file), blame_file(None, list_recordings(self.session.subject)):
            yield


def open_subject(
    subject: Subject | str | Path, settings: Settings = Settings(), *, facing: bool = False
) -> Loaded:
    """Read a subject, from its file where a path is given, and all that it names; see :func:`load`."""
    check_axes(settings.up, settings.forward)
    file = None if isinstance(subject, Subject) else Path(subject)
    known = subject if isinstance(subject, Subject) else load_subject(subject)
    with blame_file(file):
        return replace(load(known, settings, facing=facing), file=file)


def load(
    subject: Subject,
    settings: Settings = Settings(),
    read: Mapping[Path, Recording] = _NOTHING,
    *,
    facing: bool = False,
    standing: bool = False,
) -> Loaded:
    """Read the model and the recordings of a subject.

    Labels become the model's marker names, positions m with Y up, gaps are filled as the settings allow;
    everything that was changed is in each trial's ``repairs``. The body moves in the laboratory's own axes,
    as forces do in their files: only what is not Y up is turned, about a level axis.

    ``read``: recordings that were read already, by :func:`read_recordings`; the others are read. ``facing``:
    whether to turn the person X forward, for results that are told along and across the way.
    ``standing``: whether motion stands as the model does, whose gravity may point along another axis than y.
    Raises InputError: whatever a file or a label is not fit for; it names the file and the remedy.
    """
    model = labels.without_computed(read_model(subject.model, subject.marker_set), subject)
    model, of_bodies = assign_bones(model, subject.bone_bodies)
    labels.check_segments(subject, model)
    raw = read_recordings(subject, read)
    subject, of_sizes = with_stated_sizes(subject, raw)
    labels.check_explicit(subject, model, list(raw.values()))
    subject, of_tracking = labels.with_tracking_markers(subject, model, raw)
    wanted = list(dict.fromkeys([*model.marker_names, *subject.extra_markers, *subject.marker_map]))
    named = {path: labels.with_model_names(found.trial, wanted, subject, path) for path, found in raw.items()}
    vertical = read_vertical(Path(subject.model)) if subject.model.lower().endswith(".osim") else 1
    axes = decide_axes(
        {path: trial for path, (trial, _) in named.items()},
        {path: list_level_corners(found) for path, found in raw.items()},
        model,
        settings,
        static=subject.static,
        facing=facing,
        vertical=vertical,
    )
    axes = stand_along(axes, vertical) if standing else axes
    of_vertical = () if standing or vertical == 1 else (_TURNED.format(axis="xyz"[vertical]),)
    clusters = labels.sort_by_segment(model, subject)
    ready: dict[Path, Trial] = {}
    for path, (trial, _) in named.items():
        with blame_file(path, [path]):
            ready[path] = process(trial, axes, clusters, settings.processing)
            checks.refuse_one_spot(model, ready[path])
    checks.refuse_repeated(ready, subject)
    findings = _ask_of_person(named, axes, subject, model, clusters)
    model, of_freedoms = lock_unmarked(model, _list_placed(model, subject, ready.values()))
    setup, of_setup = _scale_setup(subject, model, ready)
    images, of_images = gather_images(subject, model)
    session = Session(
        subject=subject,
        model=model,
        static=None if subject.static is None else ready[subject.static],
        calibration=tuple(ready[path] for path in subject.calibration),
        evaluation=tuple(ready[path] for path in subject.evaluation),
        scale_setup=setup,
        warnings=(
            *model.notes,
            *of_vertical,
            *of_sizes,
            *of_tracking,
            *of_freedoms,
            *of_setup,
            *of_bodies,
            *of_images,
            *checks.summarise_recordings(model, subject, [trial for trial, _ in named.values()]),
            *map(str, findings),
        ),
        images=images,
    )
    used = labels.list_used_labels([mapped for _, mapped in named.values()], wanted)
    plates = {path: found.plates for path, found in raw.items() if found.plates is not None}
    return Loaded(
        session=session,
        markers_used=used,
        findings=findings,
        axes=axes.description,
        orientation=axes,
        plates=plates,
    )


def _ask_of_person(
    named: Mapping[Path, tuple[Trial, Mapping[str, str]]],
    axes: Orientation,
    subject: Subject,
    model: BodyModel,
    clusters: Mapping[str, tuple[str, ...]],
) -> tuple[Finding, ...]:
    """What the recordings show that one sound person does not; raises NotAPerson beyond doubt."""
    turned = {path: apply(axes, trial) for path, (trial, _) in named.items()}
    found = person.ask(
        Recordings(
            trials=list(turned.values()),
            clusters=clusters,
            static=None if subject.static is None else turned[subject.static].name,
            stated=Stated(sex=subject.sex, height_m=subject.height_m, mass_kg=subject.mass_kg),
            model=model,
        )
    )
    with blame_file(None, list(named)):
        refuse(found)
    return found


def _list_placed(model: BodyModel, subject: Subject, trials: Iterable[Trial]) -> dict[str, str]:
    """Every marker that a recording shows, to its segment."""
    segments = {m.name: m.segment for m in model.markers} | dict(subject.extra_markers)
    shown = {label for trial in trials for label in trial.shown_labels}
    return {name: segment for name, segment in segments.items() if name in shown}


def read_recordings(subject: Subject, known: Mapping[Path, Recording] = _NOTHING) -> dict[Path, Recording]:
    """The recordings of all trials as their files hold them, their own faults taken out.

    Those that are ``known`` are not read again.
    """
    read = {}
    for path in list_recordings(subject):
        with blame_file(path, [path]):
            found = known[path] if path in known else repair_markers(read_recording(path))
            read[path] = select_person(found, subject.marker_map)
    for path, one in zip(read, choose_repeated(list(read.values())), strict=True):
        with blame_file(path, [path]):
            read[path] = person.mend(
                one, subject.corrections.get(path.name, ()), subject.mirrored.get(path.name)
            )
    return read


def read_model(name_or_path: str | Path, marker_set: str | Path | None = None) -> BodyModel:
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
            return _free_root(read_osim(Path(name_or_path), None if marker_set is None else Path(marker_set)))
    if str(name_or_path).lower().endswith(SUFFIX):
        with blame_file(Path(name_or_path)):
            return read_model_json(name_or_path)
    return load_builtin(str(name_or_path))


def _free_root(model: BodyModel) -> BodyModel:
    """The model with the whole body's place and turns unbounded: a person may walk a laboratory either way.

    Models declare a right angle to either side and a few metres, clamped or not, so that a walk back could
    not be followed. What hangs on the ground by a joint of fewer freedoms, as an arm does, keeps its ranges.
    """
    free = {coordinate for segment in model.children(GROUND) for coordinate in _free_coordinates(segment)}
    coordinates = tuple(
        replace(c, lower=-math.inf, upper=math.inf, clamped=False) if c.name in free else c
        for c in model.coordinates
    )
    return replace(model, coordinates=coordinates)


def _free_coordinates(segment: Segment) -> set[str]:
    """Those of a joint that lets its segment move in all six directions; none of another."""
    driven = {t.coordinate for j in segment.joints for t in j.law.terms if t.coordinate is not None}
    return driven if len(driven) >= 6 else set()


def with_stated_sizes(subject: Subject, trials: Mapping[Path, Trial]) -> tuple[Subject, tuple[str, ...]]:
    """The subject with height, mass and sizes that its recordings state and its file does not.

    Returns ``notes``: what two of them state differently: the subject file counts before the recordings,
    then the first recording.
    """
    own = MeasuredSizes(subject.height_m, subject.mass_kg, subject.sizes_m)
    notes = tuple(
        f"{path.name} states another {name.replace('_', ' ')} than the subject file, which counts"
        for path, trial in trials.items()
        for name in own.conflicts(trial.sizes)
    )
    known = own.or_else(merge(trial.sizes for trial in trials.values()))
    completed = replace(
        subject, height_m=known.height_m, mass_kg=known.mass_kg, sizes_m=dict(known.lengths_m)
    )
    return completed, notes


def _scale_setup(
    subject: Subject, model: BodyModel, ready: Mapping[Path, Trial]
) -> tuple[ScaleSetup | None, tuple[str, ...]]:
    """The set-up, and what it scales without effect; its marker placer leaves fixed markers alone."""
    if subject.scale_setup is None:
        return None, ()
    setup = read_scale_setup(subject.scale_setup)
    of_setup: tuple[str, ...] = ()
    standing = next(iter(p for p in (subject.static, *subject.calibration) if p is not None), None)
    if standing is not None:
        with blame_file(None, [standing]):
            of_setup = tuple(checks.require_measurements(setup, model, ready[standing], subject.scale_setup))
    if setup.placement is None:
        return setup, of_setup
    fixed = frozenset(marker.name for marker in model.markers if marker.anatomical)
    return replace(setup, placement=replace(setup.placement, fixed=fixed)), of_setup


def gather_images(subject: Subject, model: BodyModel) -> tuple[ImageEvidence | None, tuple[str, ...]]:
    """What a subject's bones and image markers say, and what to tell of it.

    Returns ``evidence``: None where there are no bones, or they cannot be used with the model. Raises
    InputError: a file cannot be read, or a mesh is not the bone that it is said to be.
    """
    if not subject.bones:
        return None, ()
    if subject.model not in BUILTIN_NAMES and not subject.model.lower().endswith(".osim"):
        note = "bones are used with built-in and .osim models only: image-based methods were left out"
        return None, (note,)
    imaged = read_bones(subject.bones, subject.bone_units)
    try:
        found = imaged.widen(find_landmarks(imaged.meshes))
        notes = (*check_joined(found), *imaged.tell())
    except MeshRefused as error:
        file = subject.bones.get(error.field or "", subject.bones.get(SEGMENTATION))
        field = f"bones.{error.field}" if error.field in subject.bones else error.field
        raise MeshRefused(error.problem, file=file, field=field, remedy=error.remedy) from None
    bones = {find_body(model, name) or name: Bone(*shape) for name, shape in imaged.meshes.items()}
    evidence = collect_evidence(found, _read_image_markers(subject, model), bones)
    said = (
        f"{name}: {text}" for name, bone in found.items() for text in (*bone.warnings, *_list_refused(bone))
    )
    return evidence, (*said, *notes)


def _list_refused(bone: BoneLandmarks) -> Iterator[str]:
    return (f"{point} was not taken: {why}" for point, why in bone.refused.items())


def _read_image_markers(subject: Subject, model: BodyModel) -> dict[str, tuple[str, Vector]]:
    """Image markers under the model's names, those on segments that the model has."""
    if subject.image_markers is None:
        return {}
    seen = read_image_markers(subject.image_markers)
    wanted = list(dict.fromkeys([*model.marker_names, *subject.extra_markers]))
    explicit = {marker: label for marker, label in subject.marker_map.items() if label in seen}
    names = match_labels(list(seen), wanted, explicit).mapped
    placed = {marker: seen[label] for marker, label in names.items()}
    return {
        marker: (segment, at)
        for marker, (bone, at) in placed.items()
        if (segment := find_body(model, bone) or bone) in model.segment_names
    }


def record_provenance(
    loaded: Loaded, trials: Iterable[Trial], settings: Mapping[str, Any], seed: int = 0
) -> dict[str, Any]:
    """The fields of a ``Provenance``: what is needed to get the same results again.

    ``trials``: those whose repairs are reported. ``settings``: as resolved, defaults included.
    """
    subject = loaded.session.subject
    return {
        "code_version": code_version(),
        "subject": subject.id,
        "settings": settings,
        "input_hashes": hash_input_files(subject, loaded.file),
        "seed": seed,
        "markers_used": {name: list(labels) for name, labels in loaded.markers_used.items()},
        "repairs": {trial.name: repair_notes(trial.repairs) for trial in trials},
    }


def read_stated_sizes(subject: Subject) -> dict[str, float]:
    """Height, mass and sizes measured by hand, each with its unit in the name, as subject files have them."""
    whole = {"height_m": subject.height_m, "mass_kg": subject.mass_kg}
    lengths = {f"{name}{SIZE_UNIT}": round(value * 1e3, 2) for name, value in subject.sizes_m.items()}
    return {name: value for name, value in whole.items() if value is not None} | lengths


def repair_notes(repairs: Iterable[Repair]) -> list[RepairNote]:
    """What was changed in a recording, as results tell it."""
    return [RepairNote(what=r.what, where=r.where, detail=r.detail, frames=r.frames) for r in repairs]
