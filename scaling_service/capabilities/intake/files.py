"""What uploaded files are, from their names and contents; whatever cannot be read says why."""

from __future__ import annotations

import dataclasses
import re
from collections import abc
from pathlib import Path
from typing import Any

import numpy as np

from scaling_service.capabilities.intake import result as documents
from scaling_service.capabilities.subject.axes import agree_on_axes, list_level_corners
from scaling_service.core import errors
from scaling_service.core.arrays import Array
from scaling_service.documents import reading
from scaling_service.documents.subject import MODEL_SUFFIXES
from scaling_service.files import recording, segmentation
from scaling_service.files.delimited import FIELD
from scaling_service.files.forces import read_forces
from scaling_service.files.image_markers import read_image_markers
from scaling_service.files.mesh import read_mesh
from scaling_service.files.orientations import is_orientation_file
from scaling_service.files.osim.setups import read_scale_setup
from scaling_service.model import forces as model_forces
from scaling_service.model.trial import Trial
from scaling_service.recording import orientation
from scaling_service.recording.faults import repair_markers
from scaling_service.recording.findings import list_roles
from scaling_service.recording.plates import compute_ground_forces

_TABLES = (".csv", ".tsv")
_ROTATIONS = "rotations"  # field of the error about a recording without markers
_MESHES = (".stl", ".ply", ".obj", ".vtp")
_PLACES = ("model", "marker_set", "scale_setup", "image_markers", "trials", "forces", "bones")
"""Keys of a subject document under which files are named."""
_SNIFFED_BYTES = 200_000
_LONGEST_M = 3.0  # chosen: no bone is so long in m; one of this extent or more is in mm

_SETUPS = (
    ("scale_setup", re.compile(r"<ScaleTool\b")),
    (None, re.compile(r"<(InverseKinematicsTool|InverseDynamicsTool|ExternalLoads|ScaleSet|AnalyzeTool)\b")),
    ("marker_set", re.compile(r"<MarkerSet\b")),
)
"""What an XML file of OpenSim is; the first that fits counts, for set-ups may hold marker sets."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RecordingFile:
    """A recording as it was read, and what it alone says."""

    file: str
    trial: recording.Recording  # in the laboratory's axes, m as stated
    axes: orientation.Orientation
    forces: model_forces.GroundForces | None = None  # of its own plates, in the laboratory's axes
    problems: tuple[documents.ProblemEntry, ...] = ()

    @property
    def plates(self) -> tuple[model_forces.RawPlate, ...]:
        """Its own plates, in the laboratory's axes."""
        return self.trial.plates.plates if isinstance(self.trial.plates, model_forces.PlateRecording) else ()

    @property
    def corners(self) -> Array | None:
        """Of its own plates, where their forces can be used, (n_plates, 4, 3), m, as in the laboratory."""
        known = self.plates if self.forces is not None else ()
        return np.stack([plate.corners for plate in known]) if known else None


def make_problem(
    error: errors.InputError, severity: documents.Severity = "error", file: str | None = None
) -> documents.ProblemEntry:
    """An error as it travels, its file without the folder that it lay in."""
    named = file if error.file is None else Path(error.file).name
    return documents.ProblemEntry(
        severity=severity, file=named, field=error.field, problem=error.problem, remedy=error.remedy
    )


def look_at(file: Path, up: str | None, forward: str | None) -> RecordingFile:
    """Read one recording; ``up`` and ``forward`` are the laboratory's axes, where they are known.

    Raises InputError: its markers cannot be used at all. What is wrong with its plates stands in the result.
    """
    trial = repair_markers(recording.read_recording(file))
    if not trial.labels:
        raise errors.TrialUnusable(
            "rotations without markers, which `ik` follows with a model that is scaled",
            file=file,
            field=_ROTATIONS,
            remedy="Follow it by `scaling-service ik MODEL`, or by “Use a model again” in the page",
        )
    seen = RecordingFile(file=file.name, trial=trial, axes=decide_axes(trial, up, forward))
    if trial.plates is None:
        return seen
    try:
        return dataclasses.replace(seen, forces=compute_ground_forces(trial.plates))
    except errors.InputError as error:
        return dataclasses.replace(seen, problems=(make_problem(error, "warning", file.name),))


def decide_session_axes(
    seen: abc.Sequence[RecordingFile], static: str | None, up: str | None, forward: str | None
) -> orientation.Orientation:
    """One decision for all recordings, as scaling takes it.

    ``seen``: at least one. ``static``: the file of standing. ``up``, ``forward``: as given.
    """
    first = next((item for item in seen if item.file == static), seen[0])
    decided = {Path(first.file): first.axes}
    for item in seen:
        if item is not first:
            decided[Path(item.file)] = decide_axes(item.trial, up or first.axes.up, forward)
    return agree_on_axes(decided, None if static is None else Path(static))


def make_axes_entry(
    axes: orientation.Orientation, up: str | None, forward: str | None
) -> documents.AxesEntry:
    """A decision as it travels."""
    why = [r.detail for r in axes.repairs if r.what in ("up_axis", "forward_axis", "unit")]
    return documents.AxesEntry(
        up=axes.up,
        forward=axes.forward,
        sure=axes.clarity > 0.0,
        given=up is not None and forward is not None,
        why=why,
        R_new_old=[(float(x), float(y), float(z)) for x, y, z in axes.R_new_old],
    )


def decide_axes(trial: Trial, up: str | None, forward: str | None) -> orientation.Orientation:
    """Which way is up and forward in one recording."""
    level = list_level_corners(trial) if isinstance(trial, recording.Recording) else None
    return orientation.decide(trial, roles=list_roles(trial), up=up, forward=forward, level=level)


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class InputFile:
    """One uploaded file.

    ``content``: what was read: a recording, forces, the unit of a mesh, the place of a set-up, a document.
    """

    name: str
    kind: documents.FileKind
    why: str  # how that was found
    problem: documents.ProblemEntry | None = None  # why it cannot be used
    content: RecordingFile | model_forces.GroundForces | str | abc.Mapping[str, Any] | None = None
    asks: frozenset[str] = frozenset()  # the markers that a scale set-up measures between

    @property
    def usable(self) -> bool:
        """Whether it could be read."""
        return self.problem is None


def look_into(file: Path, up: str | None, forward: str | None) -> InputFile:
    """Tell what a file is, and read it.

    ``up``, ``forward``: the laboratory's axes, where they are known.
    """
    suffix = file.suffix.lower()
    if suffix in _TABLES:
        return _read_markers(file, up, forward)
    if suffix in recording.READERS and (suffix != ".sto" or is_orientation_file(file)):
        guess = _tell(file, "recording", f"a recording, by its suffix {suffix}")
        found = _try_reading(guess, file, lambda: look_at(file, up, forward))
        if found.problem is not None and found.problem.field == _ROTATIONS:
            return _tell(file, "other", found.problem.problem)
        return found
    if file.name.lower().endswith(segmentation.MAP_SUFFIXES):
        guess = _tell(file, "segmentation", "a label map, by its suffix")
        return _try_reading(guess, file, lambda: segmentation.describe_label_map(file), "why")
    for other in file.parent.iterdir():
        if file.name in segmentation.list_tables(other.name):
            return _tell(file, "other", f"the names of the labels in {other.name}")
    match suffix:
        case ".mot" | ".sto":
            return _read_table(file)
        case ".xml":
            return _read_xml(file)
        case ".osim":
            if "<OpenSimDocument" not in _read_beginning(file):
                problem = documents.ProblemEntry(
                    severity="error",
                    file=file.name,
                    problem="it is no OpenSim model",
                    remedy="Save the model again in OpenSim 4",
                )
                return dataclasses.replace(_tell(file, "model", "a model, by its suffix"), problem=problem)
            return _tell(file, "model", "a model of OpenSim")
        case ".yaml" | ".yml" | ".json":
            # A subject file, its paths cut to the names under which files are uploaded
            def read() -> abc.Mapping[str, Any]:
                content: Any = reading.read_content(file)
                if isinstance(content, dict):  # files are uploaded by their names alone, without folders
                    content = map_files(content, lambda _, name: name.replace("\\", "/").rpartition("/")[2])
                reading.check_document(content)
                return dict(content)

            beginning = _read_beginning(file)
            if all(f'"{key}"' in beginning for key in ("schema_version", "name", "segments")):
                return _tell(file, "model", "a model of this program")
            if not re.search(r"^\W*subject\b", beginning, re.MULTILINE):
                return _tell(file, "other", "a document without a subject")
            return _try_reading(_tell(file, "subject", "it describes a subject"), file, read)
    if suffix in _MESHES:

        def read_unit() -> str:
            extent = float(np.ptp(read_mesh(file).vertices, axis=0).max())
            return "mm" if extent >= _LONGEST_M else "m"

        return _try_reading(_tell(file, "mesh", "a surface, by its suffix"), file, read_unit)
    return _tell(file, "other", "of no kind that is used here")


def _tell(file: Path, kind: documents.FileKind, why: str, content: str | None = None) -> InputFile:
    return InputFile(name=file.name, kind=kind, why=why, content=content)


def _read_markers(file: Path, up: str | None, forward: str | None) -> InputFile:
    """CSV and TSV hold markers on an image, a recording, or anything else."""
    other = _read_csv(file)
    if other.kind != "other":
        return other
    guess = _tell(file, "recording", "a table of markers over time")
    found = _try_reading(guess, file, lambda: look_at(file, up, forward))
    if found.problem is None or found.problem.field not in (FIELD, "time"):
        return found
    return other if found.problem.field == FIELD else dataclasses.replace(other, why=found.problem.problem)


def _try_reading(
    guess: InputFile, file: Path, read: abc.Callable[[], Any], gives: str = "content"
) -> InputFile:
    """The guess with what was read, or with why nothing could be."""
    try:
        return dataclasses.replace(guess, **{gives: read()})
    except errors.InputError as error:
        return dataclasses.replace(guess, problem=make_problem(error, file=file.name))


def _read_table(file: Path) -> InputFile:
    """MOT and STO hold forces or motion."""
    found = _try_reading(_tell(file, "forces", "a table, by its suffix"), file, lambda: read_forces(file))
    if found.problem is None:
        return dataclasses.replace(found, why="it has columns of ground forces")
    if found.problem.field == "columns":
        return _tell(file, "other", "a table without ground forces, such as a motion")
    return found


def _read_csv(file: Path) -> InputFile:
    text = _read_beginning(file).partition("\n")[0].lower()
    if "marker" not in text or "segment" not in text:
        return _tell(file, "other", "a table without the columns marker and segment")
    guess = _tell(file, "image_markers", "it has the columns of image markers")
    return _try_reading(guess, file, lambda: ", ".join(read_image_markers(file)))


def _read_xml(file: Path) -> InputFile:
    text = _read_beginning(file)
    for place, pattern in _SETUPS:
        if pattern.search(text):
            if place is None:
                return _tell(file, "other", "a set-up of OpenSim that is not used here")
            if place == "marker_set":
                return _tell(file, "setup", "a marker set of OpenSim", place)

            def list_asked() -> frozenset[str]:
                asked = read_scale_setup(file).measurements
                return frozenset(marker for one in asked for pair in one.pairs for marker in pair)

            return _try_reading(
                _tell(file, "setup", "a scale set-up of OpenSim", place), file, list_asked, "asks"
            )
    return _tell(file, "other", "XML that is not used here")


def map_files(document: abc.Mapping[str, Any], change: abc.Callable[[str, str], str]) -> dict[str, Any]:
    """A subject document, which need not be whole, with every name of a file changed.

    ``change``: from the place where it stands, such as ``trials.calibration.0``, and the name.
    """

    def map_value(place: str, value: Any) -> Any:
        if isinstance(value, list):
            return [map_value(f"{place}.{k}", item) for k, item in enumerate(value)]
        if isinstance(value, dict):
            return {key: map_value(f"{place}.{key}", item) for key, item in value.items()}
        return change(place, value) if isinstance(value, str) and place != "bones.units" else value

    is_file = str(document.get("model")).lower().endswith(MODEL_SUFFIXES)
    named = [key for key in _PLACES if key in document and (key != "model" or is_file)]
    return {**document, **{key: map_value(key, document[key]) for key in named}}


def _read_beginning(file: Path) -> str:
    with file.open("rb") as stream:
        return stream.read(_SNIFFED_BYTES).decode("utf-8", errors="replace")


def merge_known(found: abc.Sequence[InputFile], document: abc.Mapping[str, Any]) -> dict[str, Any]:
    """The document; while it names no recordings, with what a subject file among the files says."""
    file = next(
        (f.content for f in found if f.kind == "subject" and isinstance(f.content, abc.Mapping)), None
    )
    if file is None or document.get("trials"):
        return dict(document)
    return {**file, **document, "subject": {**file["subject"], **document["subject"]}}
