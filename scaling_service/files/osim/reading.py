"""From an .osim file to a body model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from scaling_service.core.errors import FileUnreadable, ModelRefused
from scaling_service.files.osim.process import ask
from scaling_service.files.osim.setups import parse_xml
from scaling_service.files.osim.shapes import NotPolynomial, substitute
from scaling_service.model.body import (
    GROUND,
    BodyModel,
    Coordinate,
    Coupler,
    Joint,
    Law,
    Marker,
    Segment,
    Shape,
    Term,
    Vector,
)
from scaling_service.numerics.multibody.rigid import vector_from_rotation

Json = Mapping[str, Any]


def read_osim(path: Path, marker_set: Path | None = None) -> BodyModel:
    """Read an OpenSim model of any version that OpenSim itself can upgrade.

    ``path``: the ``.osim`` file.
    ``marker_set``: an OpenSim MarkerSet file. Its markers are added; those of the same name are replaced.
    One segment per body, in topological order. A segment's chain is: the parent's joint frame (constant
        translations that scale with the parent, constant rotation), the joint's translations, its rotations,
        and the child's joint frame inverted. Coordinates that an enforced CoordinateCouplerConstraint makes
        dependent are replaced in the laws and listed as couplers only. A coordinate is of kind ``rotation``
        only where OpenSim calls it rotational: only those are converted to degrees in OpenSim's motion files.
        Markers that OpenSim keeps fixed in its marker placement are ``anatomical``.
    Raises DependencyMissing: if the opensim library is not installed.
    Raises FileUnreadable: if a file is absent or OpenSim cannot read it.
    Raises ModelRefused: if a component cannot be represented; ``field`` names it.

    A marker in an offset frame is expressed in the body; when such a frame is turned against the body, a
    later non-uniform scaling differs from OpenSim's, which scales along the offset frame.
    """
    return _read(_version(path), _version(marker_set) if marker_set is not None else None)


class _Version(NamedTuple):
    """A file as it is now: a changed one is another key of the cache."""

    path: Path
    mtime_ns: int
    size: int


def _version(path: Path) -> _Version:
    try:
        status = path.stat()
    except OSError as error:
        raise FileUnreadable(
            f"cannot be opened ({error.strerror})", file=path, remedy="Check the path"
        ) from error
    return _Version(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=16)  # chosen: more models than one subject ever uses
def _read(model: _Version, marker_set: _Version | None) -> BodyModel:
    try:
        answer = ask(
            {
                "operation": "read",
                "file": str(model.path.resolve()),
                "marker_set": str(marker_set.path.resolve()) if marker_set is not None else None,
            }
        )
    except FileUnreadable:
        # Of a file that is no XML, or holds something else, OpenSim names a line of its own source code.
        root = parse_xml(model.path)
        if root.tag != "Model" and root.find("Model") is None:
            raise _no_model(model.path) from None
        if marker_set is not None:
            parse_xml(marker_set.path)
        raise
    if not answer["bodies"]:
        raise _no_model(model.path)
    return model_from(answer, source=str(model.path))


def _no_model(path: Path) -> FileUnreadable:
    return FileUnreadable("holds no OpenSim model", file=path, remedy="Give an .osim file")


def model_from(description: Json, *, source: str) -> BodyModel:
    """A body model from what the worker says of an OpenSim model.

    Raises ModelRefused if the joints form a loop, leave a body loose, or a coupler cannot be substituted.
    """
    follows = _resolved(description["couplers"])
    segments = [_substituted(segment, follows) for segment in _segments(description)]
    return BodyModel(
        name=description["name"],
        segments=tuple(segments),
        coordinates=tuple(_coordinate(c) for c in description["coordinates"] if c["name"] not in follows),
        markers=tuple(_marker(m) for m in description["markers"]),
        couplers=tuple(
            Coupler(dependent, independent, law) for dependent, (independent, law) in follows.items()
        ),
        source=source,
    )


def law_from(terms: Sequence[Json]) -> Law:
    """A law from the worker's terms."""
    return Law(
        tuple(
            Term(float(t["gain"]), coordinate=t.get("coordinate"), shape=_shape(t.get("shape")))
            for t in terms
        )
    )


def _shape(shape: Json | None) -> Shape | None:
    if shape is None:
        return None
    return Shape(tuple(shape["breaks"]), tuple(tuple(piece) for piece in shape["coefficients"]))


def _coordinate(item: Json) -> Coordinate:
    return Coordinate(
        name=item["name"],
        kind="rotation" if item["motion"] == "rotation" else "translation",
        default=item["default"],
        lower=item["lower"],
        upper=item["upper"],
        clamped=item["clamped"],
        locked=item["locked"],
    )


def _marker(item: Json) -> Marker:
    x, y, z = item["position"]
    return Marker.at(item["name"], item["body"], (x, y, z), anatomical=item["fixed"])


def _segments(description: Json) -> list[Segment]:
    """Segments in topological order: each joint is taken once the body on one side is reached."""
    bodies = {body["name"]: body for body in description["bodies"]}
    waiting = list(description["joints"])
    reached = {GROUND}
    segments: list[Segment] = []
    while waiting:
        joint = next((j for j in waiting if _ends(j) & reached), None)
        if joint is None:
            raise _loose(waiting[0]["child"]["body"], waiting[0]["name"])
        waiting.remove(joint)
        reversed_ = joint["parent"]["body"] not in reached
        parent, child = (joint["parent"]["body"], joint["child"]["body"])[:: -1 if reversed_ else 1]
        if child in reached:
            raise ModelRefused(
                f"joint '{joint['name']}' closes a loop",
                field=joint["name"],
                remedy="The model must be a tree: remove one of the loop's joints",
            )
        reached.add(child)
        segments.append(_segment(joint, parent, bodies[child], reversed_))
    for name in bodies:
        if name not in reached:
            raise _loose(name, name)
    return segments


def _ends(joint: Json) -> set[str]:
    return {joint["parent"]["body"], joint["child"]["body"]}


def _loose(body: str, component: str) -> ModelRefused:
    return ModelRefused(
        f"body '{body}' is not connected to ground by joints",
        field=component,
        remedy="Give it a joint (a FreeJoint to ground where it moves freely)",
    )


def _segment(joint: Json, parent: str, body: Json, reversed_: bool) -> Segment:
    x, y, z = body["com"]
    xx, yy, zz, xy, xz, yz = body["inertia"]
    return Segment(
        name=body["name"],
        parent=parent,
        joint_name=joint["name"],
        joints=joint_chain(joint, [law_from(axis["terms"]) for axis in joint["axes"]], reversed_=reversed_),
        mass=body["mass"],
        com=(x, y, z),
        inertia=(xx, yy, zz, xy, xz, yz),
    )


def _resolved(couplers: Sequence[Json]) -> dict[str, tuple[str, Law]]:
    """Each dependent coordinate's law in a coordinate that itself follows none."""
    direct = {c["dependent"]: (c["independent"], law_from(c["terms"]), c["name"]) for c in couplers}
    resolved: dict[str, tuple[str, Law]] = {}
    for dependent in direct:
        independent, law, name = direct[dependent]
        passed = {dependent}
        while independent in direct:
            if independent in passed:
                raise ModelRefused(
                    f"constraint '{name}' couples coordinates in a circle", field=name, remedy="Remove one"
                )
            passed.add(independent)
            following, inner, _ = direct[independent]
            law = _or_refused(law, independent, inner, name)
            independent = following
        resolved[dependent] = (independent, law)
    return resolved


def _substituted(segment: Segment, follows: Mapping[str, tuple[str, Law]]) -> Segment:
    joints = []
    for joint in segment.joints:
        law = joint.law
        for coordinate in {t.coordinate for t in law.terms} & set(follows):
            law = _or_refused(law, str(coordinate), follows[str(coordinate)][1], segment.joint_name)
        joints.append(replace(joint, law=law))
    return replace(segment, joints=tuple(joints))


def _or_refused(law: Law, coordinate: str, follows: Law, component: str) -> Law:
    try:
        return substitute(law, coordinate, follows)
    except NotPolynomial as error:
        raise ModelRefused(
            f"the coupled coordinate '{coordinate}' cannot be substituted in '{component}': {error}",
            field=component,
            remedy="Use functions of lower degree, such as piecewise linear ones, for the coupling",
        ) from error


_NO_TURN = 1e-15
"""rad; a smaller constant rotation is rounding (chosen: below the spacing of numbers near one)."""


def joint_chain(joint: Json, laws: Sequence[Law], *, reversed_: bool = False) -> tuple[Joint, ...]:
    """The chain from the parent body's frame to the child body's.

    ``joint``: ``parent`` and ``child`` frames (body and offsets, outwards) and the ``axes``: for each its
    kind, direction in the parent's joint frame and whether it scales with the parent. ``laws``: one per
    axis. ``reversed_``: whether the chain is to lead from the child body to the parent body.

    OpenSim's joints move by translations along axes fixed in the parent's joint frame, followed by
    body-fixed successive rotations (Simbody's function-based mobilizer).
    """
    parent = joint["parent"]["body"]
    moving = [_moving(axis, law, parent) for axis, law in zip(joint["axes"], laws, strict=True) if law.terms]
    chain = (
        *_offset_chain(joint["parent"]),
        *(j for j in moving if j.kind == "translation"),
        *(j for j in moving if j.kind == "rotation"),
        *inverse_chain(_offset_chain(joint["child"])),
    )
    return inverse_chain(chain) if reversed_ else chain


def inverse_chain(chain: Sequence[Joint]) -> tuple[Joint, ...]:
    """The chain that leads back."""
    return tuple(replace(joint, law=joint.law.scaled(-1.0)) for joint in reversed(chain))


def _moving(axis: Json, law: Law, parent: str) -> Joint:
    direction = np.array(axis["axis"], dtype=float)
    direction /= np.linalg.norm(direction)
    scales = parent if axis["scales"] and parent != GROUND else None
    if axis["kind"] == "rotation":
        return Joint("rotation", _vector(direction), law)
    return Joint("translation", _vector(direction), law, scales)


def _offset_chain(frame: Json) -> tuple[Joint, ...]:
    """From a body to a frame fixed in it, through all offsets between."""
    body = frame["body"]
    scales = None if body == GROUND else body
    chain: list[Joint] = []
    for offset in frame["offsets"]:
        for axis, value in zip(np.eye(3), offset["translation"], strict=True):
            if value:
                chain.append(Joint("translation", _vector(axis), Law.constant(value), scales))
        turn = vector_from_rotation(np.array(offset["rotation"]))
        angle = float(np.linalg.norm(turn))
        if angle > _NO_TURN:
            chain.append(Joint("rotation", _vector(turn / angle), Law.constant(angle)))
    return tuple(chain)


def _vector(values: np.ndarray[Any, np.dtype[np.float64]]) -> Vector:
    x, y, z = (float(v) for v in values)
    return (x, y, z)
