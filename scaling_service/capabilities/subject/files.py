"""What the files of a subject hold: the model, the recordings, the images; read once, nothing understood."""

from __future__ import annotations

import math
from collections import abc
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

from scaling_service.capabilities.subject.images import Imaged, read_images
from scaling_service.capabilities.subject.persons import select_person
from scaling_service.core.errors import blame_file
from scaling_service.core.notes import Note
from scaling_service.files import model_json, recording
from scaling_service.files.osim import models
from scaling_service.files.osim.setups import read_scale_setup
from scaling_service.model import body, builtin, labels
from scaling_service.model import subject as subjects
from scaling_service.model.anatomy import key_points
from scaling_service.model.anatomy.bones import assign_bones
from scaling_service.model.anatomy.knees import list_stiff_knees
from scaling_service.recording import person
from scaling_service.recording.faults import repair_markers
from scaling_service.recording.repeated import choose_repeated

_NOTHING: abc.Mapping[Path, recording.Recording] = MappingProxyType({})


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
