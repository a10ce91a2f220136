"""OpenSim's scale set-ups: what to scale by, and what weighs how much in the static fit."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from scipy.spatial.transform import Rotation

from scaling_service.core.arrays import Array
from scaling_service.core.errors import FileUnreadable
from scaling_service.documents.subject import HEIGHT_RANGE_M
from scaling_service.files.tables import read_bytes
from scaling_service.model import subject

_DECLARATION = re.compile(r"^[^<]*<\?xml[^>]*\?>")
_SEPARATORS = re.compile(r"[\[\](),;]")
"""What scripts write about and between the numbers of a vector, which OpenSim takes for blanks."""

_AXES = "XYZ"
_STEPS = ("measurements", "manualScale")


def parse_xml(path: Path) -> Element:
    """The root element of an XML file.

    Raises FileUnreadable if the file is absent, empty, not well-formed, or declares a document type or
    entities, which OpenSim's files never do and which can be abused to read other files or fill the memory.
    """
    content = read_bytes(path, "an OpenSim file")
    # UTF-16 spreads the characters with zero bytes; without them the keywords cannot hide.
    plain = content.replace(b"\x00", b"").upper()
    if b"<!DOCTYPE" in plain or b"<!ENTITY" in plain:
        raise FileUnreadable(
            "declares a document type or entities, which is refused",
            file=path,
            remedy="Remove the DOCTYPE and ENTITY declarations",
        )
    try:
        return ElementTree.fromstring(content)
    except ElementTree.ParseError as error:
        first = error
    try:  # a Latin-1 letter in a file that says UTF-8, which OpenSim reads
        return ElementTree.fromstring(_DECLARATION.sub("", content.decode("latin-1"), count=1).lstrip())
    except ElementTree.ParseError:
        raise FileUnreadable(
            f"is not well-formed XML ({first})", file=path, remedy="Export or save it again from OpenSim"
        ) from first


def read_body_frames(path: Path) -> dict[str, tuple[str, Array]]:
    """Offset frames on the bodies of an OpenSim model: name to the body, and the frame's axes there, (3, 3).

    Columns are the axes. OpenSim's ``orientation`` are body-fixed X-Y-Z angles, rad. Frames on frames, and
    those whose numbers cannot be read, are left out. Raises FileUnreadable as :func:`parse_xml` does.
    """
    found = {}
    for body in parse_xml(path).iter("Body"):
        for frame in body.iter("PhysicalOffsetFrame"):
            parent = (frame.findtext("socket_parent") or "..").strip().rpartition("/")[2]
            name, angles = (
                frame.get("name"),
                _SEPARATORS.sub(" ", frame.findtext("orientation") or "0 0 0").split(),
            )
            try:
                turn = Rotation.from_euler("XYZ", [float(angle) for angle in angles]).as_matrix()
            except ValueError:
                continue
            if name and parent in ("..", body.get("name")):
                found[name] = str(body.get("name")), turn
    return found


def read_scale_setup(path: Path) -> subject.ScaleSetup:
    """Read an OpenSim scale tool set-up of any version.

    ``path``: the set-up file. Sets kept in files of their own (``file="…"``) are read beside it. The model
    and marker files that it names are ignored: the subject file names its own. Returns only what is
    applied: measurements, manual scales and tasks switched off are left out, and ``placement`` is None
    where the marker placer does not apply or moves no marker. ``placement.fixed`` is empty: which markers
    stay is in the model, not in this file. Raises FileUnreadable if the file is no scale set-up, or an
    entry of it cannot be used; ``field`` names the entry.
    """
    root = parse_xml(path)
    tool = root if root.tag == "ScaleTool" else root.find("ScaleTool")
    if tool is None:
        raise FileUnreadable("holds no ScaleTool", file=path, remedy="Give an OpenSim ScaleTool set-up file")
    scaler = tool.find("ModelScaler")
    mass, height_m = _number(path, tool, "mass", 0.0), 1e-3 * _number(path, tool, "height", -1.0)
    applied = scaler is not None and _is_applied(scaler)
    setup = scaler if scaler is not None and applied else None
    order = () if setup is None else tuple(_read_text(setup, "scaling_order").split())
    for word in order:
        if setup is not None and word not in _STEPS:
            steps = ", ".join(_STEPS)
            raise _explain_bad(path, setup, f"<scaling_order> holds '{word}', which is not one of {steps}")
    manual: dict[str, tuple[float, float, float]] = {}
    for item in _list_members(path, setup, "ScaleSet") if "manualScale" in order else ():
        if _is_applied(item):
            sizes = _read_numbers(path, item, "scales")
            if len(sizes) != 3 or not all(size > 0 for size in sizes):
                raise _explain_bad(path, item, "<scales> must be three positive numbers")
            manual[_read_text(item, "segment")] = (sizes[0], sizes[1], sizes[2])
    placer = tool.find("MarkerPlacer")
    if placer is None or not _is_applied(placer) or not _read_flag(placer, "move_model_markers", True):
        placement: subject.MarkerPlacement | None = None
    else:
        tasks = placer.find("IKTaskSet")
        markers, weights, values = (
            _read_tasks(path, _in_own_file(path, tasks)) if tasks is not None else ({}, {}, {})
        )
        placement = subject.MarkerPlacement(
            marker_weights=markers,
            coordinate_weights=weights,
            coordinate_values=values,
            time_range=_read_time_range(path, placer),
        )
    return subject.ScaleSetup(
        measurements=tuple(_read_measurements(path, setup)) if "measurements" in order else (),
        manual=manual,
        order=order,
        time_range=_read_time_range(path, setup),
        preserve_mass_distribution=setup is not None
        and _read_flag(setup, "preserve_mass_distribution", False),
        mass_kg=mass if applied and mass > 0 else None,
        placement=placement,
        height_m=height_m if HEIGHT_RANGE_M[0] < height_m < HEIGHT_RANGE_M[1] else None,
    )


def _read_text(element: Element, tag: str) -> str:
    return (element.findtext(tag) or "").strip()


def _read_flag(element: Element, tag: str, default: bool) -> bool:
    text = _read_text(element, tag).lower()
    return text in {"true", "1"} if text else default


def _is_applied(element: Element) -> bool:
    return _read_flag(element, "apply", True)


def _explain_bad(path: Path, where: Element, problem: str) -> FileUnreadable:
    name = where.get("name") or where.tag
    return FileUnreadable(problem, file=path, field=name, remedy="Correct this entry of the set-up")


def _read_numbers(path: Path, element: Element, tag: str) -> list[float]:
    text = _read_text(element, tag)
    try:
        return [float(word) for word in _SEPARATORS.sub(" ", text).split()]
    except ValueError as error:
        raise _explain_bad(path, element, f"<{tag}> is not numbers: '{text}'") from error


def _number(path: Path, element: Element, tag: str, default: float) -> float:
    found = _read_numbers(path, element, tag)
    if len(found) > 1:
        raise _explain_bad(path, element, f"<{tag}> must be one number")
    return found[0] if found else default


def _read_time_range(path: Path, element: Element | None) -> tuple[float, float] | None:
    """The frames to use; OpenSim writes ``-1 -1`` for all of them."""
    if element is None:
        return None
    found = _read_numbers(path, element, "time_range")
    if len(found) != 2 or found[1] < found[0] or found[1] < 0:
        return None
    return found[0], found[1]


def _in_own_file(path: Path, element: Element) -> Element:
    """A set, or the set in the file that it refers to."""
    name = element.get("file")
    if not name:
        return element
    other = path.parent / name
    found = next((e for e in parse_xml(other).iter() if e.tag == element.tag), None)
    if found is None:
        raise FileUnreadable(f"holds no {element.tag}", file=other, remedy=f"It is named in {path.name}")
    return found


def _list_members(path: Path, parent: Element | None, tag: str) -> Iterable[Element]:
    """The objects of a set within an element."""
    holder = parent.find(tag) if parent is not None else None
    if holder is None:
        return ()
    return _list_objects(_in_own_file(path, holder))


def _list_objects(holder: Element) -> Iterable[Element]:
    objects = holder.find("objects")
    return objects if objects is not None else ()


def _read_measurements(path: Path, scaler: Element | None) -> Iterable[subject.Measurement]:
    for item in _list_members(path, scaler, "MeasurementSet"):
        if not _is_applied(item):
            continue
        pairs: list[tuple[str, str]] = []
        for pair in _list_members(path, item, "MarkerPairSet"):
            words = _read_text(pair, "markers").split()
            if len(words) != 2:
                raise _explain_bad(path, pair, f"<markers> must name two markers, not '{' '.join(words)}'")
            pairs.append((words[0], words[1]))
        axes = {}
        for scale in _list_members(path, item, "BodyScaleSet"):
            letters = _read_text(scale, "axes").upper().replace(" ", "")
            if not letters or set(letters) - set(_AXES):
                said = _read_text(scale, "axes")
                raise _explain_bad(path, scale, f"<axes> must be among X, Y, Z, not '{said}'")
            axes[scale.get("name", "")] = "".join(axis for axis in _AXES if axis in letters)
        if pairs and axes:
            yield subject.Measurement(item.get("name", ""), tuple(pairs), axes)


def _read_tasks(path: Path, tasks: Element) -> tuple[dict[str, float], dict[str, float], Mapping[str, float]]:
    """Marker weights, coordinate weights and the values of coordinates given by hand."""
    markers: dict[str, float] = {}
    coordinates: dict[str, float] = {}
    values: dict[str, float] = {}
    for item in _list_objects(tasks):
        weight = _number(path, item, "weight", 1.0)
        name = item.get("name", "")
        if not _is_applied(item) or weight <= 0:
            continue
        if item.tag == "IKMarkerTask":
            markers[name] = weight
        elif item.tag == "IKCoordinateTask":
            coordinates[name] = weight
            kind = _read_text(item, "value_type") or "default_value"
            if kind == "manual_value":
                values[name] = _number(path, item, "value", 0.0)
            elif kind != "default_value":
                raise FileUnreadable(
                    f"the task takes its value by '{kind}', which is not supported",
                    file=path,
                    field=name,
                    remedy="Use default_value or manual_value, or switch the task off",
                )
    return markers, coordinates, values
