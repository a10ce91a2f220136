"""From a subject document to a subject: paths made absolute and looked for, names checked, files hashed."""

from __future__ import annotations

import hashlib
import os
from collections import abc
from dataclasses import replace
from pathlib import Path, PurePath

from scaling_service.bones.images import SEGMENTATION, list_files_of
from scaling_service.core import errors
from scaling_service.core.notes import Note
from scaling_service.core.text import suggest_name
from scaling_service.documents import subject as subjects
from scaling_service.documents.reading import read_document
from scaling_service.files.recording import READERS
from scaling_service.files.segmentation import list_tables
from scaling_service.model import trial as model_trial
from scaling_service.model.builtin import BUILTIN_NAMES
from scaling_service.model.subject import Subject, list_recordings


def load_subject(path: str | Path) -> Subject:
    """Read a subject file, and check that everything it names is there. No recording is read yet.

    Parameters
    ----------
    path : path
        A YAML or JSON subject file; paths in it are relative to it.

    Returns
    -------
    Subject
        With absolute paths.

    Raises
    ------
    FileUnreadable
        The file is absent or no text.
    SubjectInvalid
        It does not follow the contract, or a file that it names is absent.

    Examples
    --------
    >>> import scaling_service as ss
    >>> subject = ss.load_subject("lab/subject.json")
    >>> subject.height_m, [path.name for path in subject.evaluation]
    (1.732, ['gait_1.trc', 'gait_2.trc'])
    """
    file = Path(path)
    if file.suffix.lower() in READERS:
        raise errors.SubjectInvalid(
            "this is a recording, not a subject file",
            file=file,
            remedy="Name it under `trials:` in a subject file, and give that",
        )
    return make_subject(read_document(file), folder=file.resolve().parent, file=file)


def make_subject(
    document: subjects.SubjectDocument, *, folder: Path, file: str | Path | None = None
) -> Subject:
    """The subject that a checked document describes.

    ``folder``: what the document's paths are relative to. ``file``: named in errors. Raises SubjectInvalid:
    a file is absent, of a format that is not read, or the built-in model does not exist.
    """
    find = _Finder(folder, str(file) if file is not None else None)
    person, trials = document.subject, document.trials
    return Subject(
        id=person.id,
        model=str(find(document.model, "model")) if document.model_is_file else find.builtin(document.model),
        sex=person.sex,
        height_m=person.height_m,
        mass_kg=person.mass_kg,
        marker_set=find.optional(document.marker_set, "marker_set"),
        scale_setup=find.optional(document.scale_setup, "scale_setup"),
        marker_map=dict(document.markers),
        extra_markers=dict(document.extra_markers),
        static=None if trials.static is None else find.recording(trials.static, "trials.static"),
        calibration=find.recordings(trials.calibration, "trials.calibration"),
        evaluation=find.recordings(trials.evaluation, "trials.evaluation"),
        forces=find.all(document.forces, "forces"),
        corrections={name: list_relabellings(found) for name, found in document.corrections.items()},
        mirrored=dict(document.mirrored),
        events={name: list_events(found) for name, found in document.events.items()},
        bones=find.images(document.bones.meshes if document.bones else {}),
        bone_units=document.bones.units if document.bones else "mm",
        bone_bodies={str(bone): name for bone, name in document.bone_bodies.items()},
        image_markers=find.optional(document.image_markers, "image_markers"),
        sizes_m=document.sizes_m,
    )


def list_relabellings(corrections: abc.Iterable[subjects.Correction]) -> tuple[model_trial.Relabelling, ...]:
    """What a document says of wrong labels in one recording."""
    return tuple(model_trial.Relabelling(dict(one.labels), one.from_s, one.to_s) for one in corrections)


def list_events(entries: abc.Iterable[subjects.GaitEventEntry]) -> tuple[model_trial.GaitEvent, ...]:
    """What a document says of gait in one recording, in the order of time."""
    found = (model_trial.GaitEvent(one.side, one.kind, one.time_s) for one in entries)
    return tuple(sorted(found, key=lambda event: event.time_s))


class _Finder:
    """Looks for the files that a document names."""

    def __init__(self, folder: Path, file: str | None) -> None:
        self._folder, self._file = folder, file

    def __call__(self, path: str, field: str) -> Path:
        found = self._folder / Path(path).expanduser()
        if not found.is_file():
            problem = "is a folder, not a file" if found.is_dir() else "does not exist"
            # What lies in that folder under a similar name
            folder = found.parent
            names = [p.name for p in folder.iterdir() if p.is_file()] if folder.is_dir() else []
            guess = suggest_name(found.name, names, cutoff=0.75)  # suffixes are alike
            raise errors.SubjectInvalid(
                f"'{path}' {problem} (looked for {found})",
                file=self._file,
                field=field,
                remedy=guess.strip() or "Paths are relative to the subject file: correct the path",
            )
        # Not resolved: results are named as the subject file names the recording, not as a link's target.
        return found.absolute()

    def optional(self, path: str | None, field: str) -> Path | None:
        return None if path is None else self(path, field)

    def all(self, paths: abc.Mapping[str, str], field: str) -> dict[str, Path]:
        return {name: self(path, f"{field}.{name}") for name, path in paths.items()}

    def images(self, paths: abc.Mapping[str, str]) -> dict[str, Path]:
        """Bones' files; a segmentation may be a folder."""
        found = {}
        for name, path in paths.items():
            place = self._folder / Path(path).expanduser()
            folder = name == SEGMENTATION and place.is_dir()
            found[name] = place.absolute() if folder else self(path, f"bones.{name}")
        return found

    def recording(self, path: str, field: str) -> Path:
        if PurePath(path).suffix.lower() not in READERS:
            raise errors.SubjectInvalid(
                f"'{path}' is of no format that recordings are read from",
                file=self._file,
                field=field,
                remedy=f"Export it as {' or '.join(READERS)}",
            )
        return self(path, field)

    def recordings(self, paths: list[str], field: str) -> tuple[Path, ...]:
        return tuple(self.recording(path, f"{field}.{k}") for k, path in enumerate(paths))

    def builtin(self, name: str) -> str:
        if name in BUILTIN_NAMES:
            return name
        raise errors.SubjectInvalid(
            f"there is no built-in model '{name}'",
            file=self._file,
            field="model",
            remedy=f"{suggest_name(name, BUILTIN_NAMES)}Use one of {', '.join(BUILTIN_NAMES)}, "
            "or the path of an .osim or model.json",
        )


def with_stated_sizes(
    subject: Subject, trials: abc.Mapping[Path, model_trial.Trial]
) -> tuple[Subject, tuple[Note, ...]]:
    """The subject with height, mass and sizes that its recordings state and its file does not.

    Returns ``notes``: what two of them state differently: the subject file counts before the recordings,
    then the first recording.
    """
    own = model_trial.MeasuredSizes(subject.height_m, subject.mass_kg, subject.sizes_m)
    notes = tuple(
        Note(
            code="another_size",
            problem=f"{path.name} states another {name.replace('_', ' ')} than the subject file, "
            "which counts",
        )
        for path, trial in trials.items()
        for name in own.conflicts(trial.sizes)
    )
    known = own.or_else(model_trial.merge(trial.sizes for trial in trials.values()))
    completed = replace(
        subject, height_m=known.height_m, mass_kg=known.mass_kg, sizes_m=dict(known.lengths_m)
    )
    return completed, notes


def hash_input_files(subject: Subject, subject_file: Path | None = None) -> dict[str, str]:
    """SHA-256 of the subject file and of every file that it names.

    Returns file to hexadecimal digest. Files at or below the subject file's folder are named relative to
    it, so that the same data elsewhere give the same document.
    """
    folder = None if subject_file is None else subject_file.resolve().parent
    found: dict[str, str] = {}
    inputs: list[Path] = []
    if subject_file is not None:
        inputs.append(subject_file.resolve())
    if subject.model.lower().endswith(subjects.MODEL_SUFFIXES):
        inputs.append(Path(subject.model))
    inputs.extend(
        p for p in (subject.marker_set, subject.scale_setup, subject.image_markers) if p is not None
    )
    inputs.extend(list_recordings(subject))
    inputs.extend(subject.forces.values())
    for bone in subject.bones.values():
        inputs.extend(list_files_of(bone))
        inputs.extend(table for name in list_tables(bone.name) if (table := bone.with_name(name)).is_file())
    for path in inputs:
        place = Path(os.path.abspath(path))  # noqa: PTH100 (links keep their names, ".." goes)
        inside = folder is not None and place.is_relative_to(folder)
        name = place.relative_to(folder).as_posix() if inside and folder is not None else str(place)
        found[name] = hash_file(path)
    return found


def hash_file(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
