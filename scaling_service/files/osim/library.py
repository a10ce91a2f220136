"""The opensim library, imported only in the worker process, and models loaded by it.

It cannot live in one process with casadi, changes the working directory and is not thread-safe.
"""

from __future__ import annotations

import importlib
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from scaling_service.core.errors import DependencyMissing, FileUnreadable, ModelRefused


@cache
def import_opensim() -> Any:
    """The opensim module with its chatter silenced.

    Raises DependencyMissing if it is not installed, or its shared libraries do not load.
    """
    try:
        module = importlib.import_module("opensim")
    except ImportError as error:
        raise DependencyMissing(
            f"the opensim library cannot be imported ({error})",
            field="opensim",
            remedy="Install it with `pip install scaling-service[opensim]`",
        ) from error
    module.Logger.setLevelString("Error")
    return module


def load(path: Path, marker_set: str | None = None) -> Any:
    """Load and connect a model.

    Raises FileUnreadable: if OpenSim cannot read it.
    Raises ModelRefused: if it holds a joint or constraint of a kind that OpenSim does not know, or the marker
        set a marker on a body that is absent.
    """
    if not path.is_file():
        raise FileUnreadable("there is no such file", file=path, remedy="Check the path")
    _refuse_unknown_types(path)
    try:
        model = import_opensim().Model(str(path))
        model.finalizeConnections()
    except RuntimeError as error:
        raise FileUnreadable(
            f"OpenSim cannot read it ({shorten_message(error)})",
            file=path,
            remedy="Open and save it in OpenSim",
        ) from error
    if marker_set is not None:
        _add_markers(model, Path(marker_set))
    return model


def shorten_message(error: RuntimeError) -> str:
    """OpenSim's message without the C++ function and source line around it."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    head = lines[0] if lines else "no message"
    return head.split("': ", 1)[1] if head.startswith("std::exception in") and "': " in head else head


def _refuse_unknown_types(path: Path) -> None:
    try:
        root = ElementTree.fromstring(path.read_bytes())
    except ElementTree.ParseError:
        return  # OpenSim's own parser is more lenient, and has read it
    known = import_opensim().OpenSimObject.getDefaultInstanceOfType
    for element in root.iter():
        name = element.get("name")
        if name and element.tag.endswith(("Joint", "Constraint")) and known(element.tag) is None:
            raise ModelRefused(
                f"'{name}' is a {element.tag}, a kind that OpenSim does not know",
                file=path,
                field=name,
                remedy="Replace it by a CustomJoint, or load a model without the plug-in",
            )


def _add_markers(model: Any, path: Path) -> None:
    """As OpenSim's scale tool: markers of the set replace those of the same name, others are added."""
    if not path.is_file():
        raise FileUnreadable("there is no such file", file=path, remedy="Check the path")
    library = import_opensim()
    try:
        markers = library.MarkerSet(str(path))
    except RuntimeError as error:
        raise FileUnreadable(
            f"OpenSim cannot read this marker set ({shorten_message(error)})",
            file=path,
            remedy="It must be an OpenSim MarkerSet file",
        ) from error
    if not markers.getSize():
        raise FileUnreadable("holds no markers", file=path, remedy="It must be an OpenSim MarkerSet file")
    for marker in list_items(markers):
        frame = marker.getParentFrameName()
        if not model.hasComponent(frame):
            raise ModelRefused(
                f"marker '{marker.getName()}' sits on '{frame}', which the model does not have",
                file=path,
                field=marker.getName(),
                remedy="Put it on one of the model's bodies",
            )
    model.updateMarkerSet(markers)
    model.finalizeConnections()


def list_items(collection: Any) -> list[Any]:
    """The members of an OpenSim set."""
    return [collection.get(k) for k in range(collection.getSize())]


def list_numbers(vector: Any) -> list[float]:
    """A SimTK vector as a list."""
    return [vector.get(k) for k in range(vector.size())]
