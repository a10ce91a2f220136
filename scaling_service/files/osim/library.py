"""The opensim library, imported only in the worker process, and models loaded by it.

It cannot live in one process with casadi, changes the working directory and is not thread-safe.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from scaling_service.core import errors

_WITHOUT_KINEMATICS = ("ForceSet", "ControllerSet", "ProbeSet", "ComponentSet")
"""Sets of a model that its motion does not need."""
_NAMING_OTHERS = ("ControllerSet", "ProbeSet")
"""Of these, the sets whose members name forces: they are set aside with any force."""
_KNOWN = "known.osim"  # in the worker's own scratch directory


@cache
def import_opensim() -> Any:
    """The opensim module with its chatter silenced.

    Raises DependencyMissing if it is not installed, or its shared libraries do not load.
    """
    try:
        module = importlib.import_module("opensim")
    except ImportError as error:
        raise errors.DependencyMissing(
            f"the opensim library cannot be imported ({error})",
            field="opensim",
            remedy="Install it with `pip install scaling-service[opensim]`",
        ) from error
    module.Logger.setLevelString("Error")
    return module


def load(path: Path, marker_set: str | None = None) -> Any:
    """Load and connect a model, without the forces and the like that :func:`list_unknown` lists.

    Raises FileUnreadable: if OpenSim cannot read it.
    Raises ModelRefused: if it holds a joint or constraint of a kind that OpenSim does not know, or the marker
        set a marker on a body that is absent.
    """
    if not path.is_file():
        raise errors.FileUnreadable("there is no such file", file=path, remedy="Check the path")
    known = path
    if list_unknown(path):
        # The model without what a plug-in defines, and what may name that
        root, known = ElementTree.fromstring(path.read_bytes()), Path(_KNOWN)
        sets = _find_idle_sets(root)
        for kind, elements in _find_aside(sets).items():
            for element in elements:
                sets[kind].remove(element)
        ElementTree.ElementTree(root).write(known, encoding="utf-8", xml_declaration=True)
    try:
        model = import_opensim().Model(str(known))
        model.finalizeConnections()
    except RuntimeError as error:
        raise errors.FileUnreadable(
            f"OpenSim cannot read it ({shorten_message(error)})",
            file=path,
            remedy="Open and save it in OpenSim",
        ) from error
    if marker_set is not None:
        # As OpenSim's scale tool: markers of the set replace those of the same name, others are added.
        path = Path(marker_set)
        if not path.is_file():
            raise errors.FileUnreadable("there is no such file", file=path, remedy="Check the path")
        library = import_opensim()
        try:
            markers = library.MarkerSet(str(path))
        except RuntimeError as error:
            raise errors.FileUnreadable(
                f"OpenSim cannot read this marker set ({shorten_message(error)})",
                file=path,
                remedy="It must be an OpenSim MarkerSet file",
            ) from error
        if not markers.getSize():
            raise errors.FileUnreadable(
                "holds no markers", file=path, remedy="It must be an OpenSim MarkerSet file"
            )
        for marker in list_items(markers):
            frame = marker.getParentFrameName()
            if not model.hasComponent(frame):
                raise errors.ModelRefused(
                    f"marker '{marker.getName()}' sits on '{frame}', which the model does not have",
                    file=path,
                    field=marker.getName(),
                    remedy="Put it on one of the model's bodies",
                )
        model.updateMarkerSet(markers)
        model.finalizeConnections()
    return model


def shorten_message(error: RuntimeError) -> str:
    """OpenSim's message without the C++ function and source line around it."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    head = lines[0] if lines else "no message"
    return head.split("': ", 1)[1] if head.startswith("std::exception in") and "': " in head else head


def list_unknown(path: Path) -> list[tuple[str, str]]:
    """Name and kind of all that a plug-in defines and motion does not need.

    Raises ModelRefused: a joint or constraint is of a kind that OpenSim does not know.
    """
    try:
        root = ElementTree.fromstring(path.read_bytes())
    except ElementTree.ParseError:
        return []  # OpenSim's own parser is more lenient, and has read it
    for element in root.iter():
        name = element.get("name")
        if name and element.tag.endswith(("Joint", "Constraint")) and _is_unknown(element):
            raise errors.ModelRefused(
                f"'{name}' is a {element.tag}, a kind that OpenSim does not know",
                file=path,
                field=name,
                remedy="Replace it by a CustomJoint, or load a model without the plug-in",
            )
    members = (element for objects in _find_idle_sets(root).values() for element in objects)
    return [(element.get("name") or element.tag, element.tag) for element in members if _is_unknown(element)]


def _is_unknown(element: ElementTree.Element) -> bool:
    return import_opensim().OpenSimObject.getDefaultInstanceOfType(element.tag) is None


def _find_idle_sets(root: ElementTree.Element) -> dict[str, ElementTree.Element]:
    """The lists of members of the sets that motion does not need, and the model's own list."""
    model = root if root.tag == "Model" else root.find("Model")
    places = {"components": "components", **{kind: f"{kind}/objects" for kind in _WITHOUT_KINEMATICS}}
    found = {kind: model.find(place) for kind, place in places.items() if model is not None}
    return {kind: members for kind, members in found.items() if members is not None}


def _find_aside(sets: Mapping[str, ElementTree.Element]) -> dict[str, list[ElementTree.Element]]:
    return {
        kind: [e for e in objects if kind in _NAMING_OTHERS or _is_unknown(e)]
        for kind, objects in sets.items()
    }


def put_back(text: str, path: Path) -> str:
    """The text of a model made from a file, with what was set aside of it as it stands there."""
    if not list_unknown(path):
        return text
    aside = _find_aside(_find_idle_sets(ElementTree.fromstring(path.read_bytes())))
    for kind, elements in aside.items():
        lines = "".join(ElementTree.tostring(element, encoding="unicode") for element in elements)
        own = "components" if kind == "components" else "objects"
        before = r"<Model\b[^>]*>(?:\s|<!--[^>]*-->)*" if kind == own else rf"<{kind}\b(?:(?!</{kind}>).)*?"
        place = re.search(rf"{before}<{own}\s*(/?)>", text, flags=re.DOTALL)
        if not lines:
            continue
        if place is None:
            inner = lines if kind == own else f"<objects>{lines}</objects>"
            text = text.replace("</Model>", f"<{kind}>{inner}</{kind}></Model>", 1)
        elif place[1]:  # an empty list
            text = f"{text[: place.start(1)]}>{lines}</{own}{text[place.end(1) :]}"
        else:
            text = text[: place.end()] + lines + text[place.end() :]
    return text


def list_items(collection: Any) -> list[Any]:
    """The members of an OpenSim set."""
    return [collection.get(k) for k in range(collection.getSize())]


def list_numbers(vector: Any) -> list[float]:
    """A SimTK vector as a list."""
    return [vector.get(k) for k in range(vector.size())]


def list_rows(rotation: Any) -> list[list[float]]:
    """A SimTK rotation as the rows of its matrix, (3, 3)."""
    return [[rotation.get(i, j) for j in range(3)] for i in range(3)]


def place_in_body(frame: Any, at: Any) -> tuple[str, list[float]]:
    """The body that a frame is fixed in, and a point of the frame in that body, (3,), m."""
    place = frame.findTransformInBaseFrame()
    return frame.findBaseFrame().getName(), list_numbers(place.shiftFrameStationToBase(at))


def place_frame(frame: Any) -> tuple[list[list[float]], list[float]]:
    """A frame's rotation and origin in its body, m."""
    place = frame.findTransformInBaseFrame()
    return list_rows(place.R()), list_numbers(place.p())
