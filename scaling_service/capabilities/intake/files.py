"""What uploaded files are, told by their names and contents; whatever cannot be read says why."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from scaling_service.capabilities.intake.document import ProblemEntry
from scaling_service.capabilities.intake.recordings import RecordingFile, look_at, problem_of
from scaling_service.core.errors import InputError
from scaling_service.documents.reading import check_document, read_content
from scaling_service.files.forces import read_forces
from scaling_service.files.image_markers import read_image_markers
from scaling_service.files.mesh import read_mesh
from scaling_service.files.recording import READERS
from scaling_service.model.forces import GroundForces

Kind = Literal["recording", "forces", "model", "mesh", "image_markers", "setup", "subject", "other"]

_MESHES = (".stl", ".ply", ".obj", ".vtp")
_SNIFFED_BYTES = 200_000
_LONGEST_M = 3.0  # chosen: no bone is so long in m; one of this extent or more is in mm

_SETUPS = (
    ("scale_setup", re.compile(r"<ScaleTool\b")),
    (None, re.compile(r"<(InverseKinematicsTool|InverseDynamicsTool|ExternalLoads|ScaleSet|AnalyzeTool)\b")),
    ("marker_set", re.compile(r"<MarkerSet\b")),
)
"""What an XML file of OpenSim is; the first that fits counts, for set-ups may hold marker sets."""


@dataclass(frozen=True, slots=True, eq=False)
class InputFile:
    """One uploaded file.

    ``content``: what was read: a recording, forces, the unit of a mesh, the place of a set-up, a document.
    """

    name: str
    kind: Kind
    why: str  # how that was told
    problem: ProblemEntry | None = None  # why it cannot be used
    content: RecordingFile | GroundForces | str | Mapping[str, Any] | None = None

    @property
    def usable(self) -> bool:
        """Whether it could be read."""
        return self.problem is None


def look_into(file: Path, up: str | None, forward: str | None) -> InputFile:
    """Tell what a file is, and read it.

    ``up``, ``forward``: the laboratory's axes, where they are known.
    """
    suffix = file.suffix.lower()
    if suffix in READERS:
        guess = InputFile(file.name, "recording", f"a recording, by its suffix {suffix}")
        return _tried(guess, file, lambda: look_at(file, up, forward))
    reader = _READERS.get(suffix)
    if reader is None:
        return InputFile(file.name, "other", "of no kind that is used here")
    return reader(file)


def _tried(guess: InputFile, file: Path, read: Callable[[], Any]) -> InputFile:
    """The guess with what was read, or with why nothing could be."""
    try:
        return replace(guess, content=read())
    except InputError as error:
        return replace(guess, problem=problem_of(error, file=file.name))


def _table(file: Path) -> InputFile:
    """MOT and STO hold forces or motion."""
    try:
        return InputFile(file.name, "forces", "it has columns of ground forces", content=read_forces(file))
    except InputError as error:
        if error.field == "columns":
            return InputFile(file.name, "other", "a table without ground forces, such as a motion")
        return InputFile(file.name, "forces", "a table, by its suffix", problem_of(error, file=file.name))


def _mesh(file: Path) -> InputFile:
    def unit() -> str:
        extent = float(np.ptp(read_mesh(file).vertices, axis=0).max())
        return "mm" if extent >= _LONGEST_M else "m"

    return _tried(InputFile(file.name, "mesh", "a surface, by its suffix"), file, unit)


def _csv(file: Path) -> InputFile:
    text = _beginning(file).partition("\n")[0].lower()
    if "marker" not in text or "segment" not in text:
        return InputFile(file.name, "other", "a table without the columns marker and segment")
    guess = InputFile(file.name, "image_markers", "it has the columns of image markers")
    return _tried(guess, file, lambda: ", ".join(read_image_markers(file)))


def _xml(file: Path) -> InputFile:
    text = _beginning(file)
    for place, pattern in _SETUPS:
        if pattern.search(text):
            if place is None:
                return InputFile(file.name, "other", "a set-up of OpenSim that is not used here")
            told = "a scale set-up" if place == "scale_setup" else "a marker set"
            return InputFile(file.name, "setup", f"{told} of OpenSim", content=place)
    return InputFile(file.name, "other", "XML that is not used here")


def _osim(file: Path) -> InputFile:
    if "<OpenSimDocument" not in _beginning(file):
        problem = ProblemEntry(
            severity="error",
            file=file.name,
            problem="it is no OpenSim model",
            remedy="Save the model again in OpenSim 4",
        )
        return InputFile(file.name, "model", "a model, by its suffix", problem)
    return InputFile(file.name, "model", "a model of OpenSim")


def _document(file: Path) -> InputFile:
    """A subject file, its paths cut to the names under which files are uploaded."""

    def read() -> Mapping[str, Any]:
        content = _with_plain_names(read_content(file))
        check_document(content)
        return dict(content)

    beginning = _beginning(file)
    if all(f'"{key}"' in beginning for key in ("schema_version", "name", "segments")):
        return InputFile(file.name, "model", "a model of this program")
    if not re.search(r"^\W*subject\b", beginning, re.MULTILINE):
        return InputFile(file.name, "other", "a document without a subject")
    return _tried(InputFile(file.name, "subject", "it describes a subject"), file, read)


def _with_plain_names(content: Any) -> Any:
    """Paths without their folders, wherever files are named."""
    if not isinstance(content, dict):
        return content
    plain = dict(content)
    for key in ("marker_set", "scale_setup", "image_markers", "model"):
        if isinstance(plain.get(key), str):
            plain[key] = _base(plain[key])
    if isinstance(plain.get("trials"), dict):
        plain["trials"] = {
            key: [_base(name) for name in value] if isinstance(value, list) else _base(value)
            for key, value in plain["trials"].items()
        }
    for key in ("forces", "bones"):
        if isinstance(plain.get(key), dict):
            plain[key] = {name: _base(value) for name, value in plain[key].items()}
    return plain


def _base(path: Any) -> Any:
    return path.replace("\\", "/").rpartition("/")[2] if isinstance(path, str) else path


def _beginning(file: Path) -> str:
    with file.open("rb") as stream:
        return stream.read(_SNIFFED_BYTES).decode("utf-8", errors="replace")


_READERS: Mapping[str, Callable[[Path], InputFile]] = MappingProxyType(
    {".mot": _table, ".sto": _table, ".csv": _csv, ".xml": _xml, ".osim": _osim}
    | dict.fromkeys(_MESHES, _mesh)
    | dict.fromkeys((".yaml", ".yml", ".json"), _document)
)
"""Suffix to what tells more."""
