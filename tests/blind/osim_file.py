"""A body as an OpenSim 4 file, written as text so that no OpenSim is needed to make the bank."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as Xml

from tests.blind.body import GROUND, Body, Move, Segment, Vector

_AXES: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_RANGE = {"turn": "-3.14159265 3.14159265", "slide": "-100 100"}


def write_osim(path: Path, body: Body) -> None:
    """Write the body.

    Parameters
    ----------
    path : Path
    body : Body
        Each joint slides first and then turns, by coordinates only: what an OpenSim CustomJoint is.
    """
    document = Xml.Element("OpenSimDocument", Version="40000")
    model = Xml.SubElement(document, "Model", name=body.name)
    _text(model, "gravity", body.gravity)
    bodies = _set(model, "BodySet", "bodyset")
    joints = _set(model, "JointSet", "jointset")
    markers = _set(model, "MarkerSet", "markerset")
    for segment in body.segments:
        _body(bodies, segment)
        _joint(joints, segment)
    for marker in body.markers:
        item = Xml.SubElement(markers, "Marker", name=marker.name)
        Xml.SubElement(item, "socket_parent_frame").text = f"/bodyset/{marker.segment}"
        _text(item, "location", marker.at)
        Xml.SubElement(item, "fixed").text = "true"
    Xml.indent(document)
    Xml.ElementTree(document).write(path, encoding="utf-8", xml_declaration=True)


def _set(model: Xml.Element, kind: str, name: str) -> Xml.Element:
    return Xml.SubElement(Xml.SubElement(model, kind, name=name), "objects")


def _text(parent: Xml.Element, tag: str, values: tuple[float, ...]) -> None:
    Xml.SubElement(parent, tag).text = " ".join(f"{v:.12g}" for v in values)


def _body(bodies: Xml.Element, segment: Segment) -> None:
    item = Xml.SubElement(bodies, "Body", name=segment.name)
    Xml.SubElement(item, "mass").text = f"{segment.mass:.12g}"
    _text(item, "mass_center", segment.com)
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = segment.inertia
    _text(item, "inertia", (xx, yy, zz, xy, xz, yz))


def _joint(joints: Xml.Element, segment: Segment) -> None:
    item = Xml.SubElement(joints, "CustomJoint", name=segment.joint)
    Xml.SubElement(item, "socket_parent_frame").text = "parent_offset"
    Xml.SubElement(item, "socket_child_frame").text = "child_offset"
    coordinates = Xml.SubElement(item, "coordinates")
    for move in segment.moves:
        coordinate = Xml.SubElement(coordinates, "Coordinate", name=_own(move))
        Xml.SubElement(coordinate, "range").text = _RANGE[move.kind]
    frames = Xml.SubElement(item, "frames")
    parent = "/ground" if segment.parent == GROUND else f"/bodyset/{segment.parent}"
    for name, socket, place in (
        ("parent_offset", parent, segment.centre),
        ("child_offset", f"/bodyset/{segment.name}", (0.0, 0.0, 0.0)),
    ):
        frame = Xml.SubElement(frames, "PhysicalOffsetFrame", name=name)
        Xml.SubElement(frame, "socket_parent").text = socket
        _text(frame, "translation", place)
    transform = Xml.SubElement(item, "SpatialTransform")
    kinds = [move.kind for move in segment.moves]
    if kinds != sorted(kinds):
        raise ValueError(f"joint '{segment.joint}' turns before it slides")
    for kind, name in (("turn", "rotation"), ("slide", "translation")):
        moves = [move for move in segment.moves if move.kind == kind]
        _axes(transform, name, moves)


def _axes(transform: Xml.Element, name: str, moves: list[Move]) -> None:
    idle = [axis for axis in _AXES if all(abs(_dot(axis, m.axis)) < 0.5 for m in moves)]
    for k in range(3):
        item = Xml.SubElement(transform, "TransformAxis", name=f"{name}{k + 1}")
        move = moves[k] if k < len(moves) else None
        Xml.SubElement(item, "coordinates").text = _own(move) if move else ""
        _text(item, "axis", move.axis if move else idle[k - len(moves)])
        if move:
            function = Xml.SubElement(item, "LinearFunction", name="function")
            Xml.SubElement(function, "coefficients").text = "1 0"
        else:
            function = Xml.SubElement(item, "Constant", name="function")
            Xml.SubElement(function, "value").text = "0"


def _dot(a: Vector, b: Vector) -> float:
    return sum(x * y for x, y in zip(a, b, strict=True))


def _own(move: Move) -> str:
    """The coordinate of a move that is nothing but its own coordinate."""
    if move.constant or len(move.gains) != 1 or move.gains[0][1] != 1.0:
        raise ValueError("only a joint's own coordinates can be written to the given model")
    return move.gains[0][0]
