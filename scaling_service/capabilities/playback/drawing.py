"""Pictures of moving models: what is drawn of a model, where it stands, surfaces of its segments as glTF."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Literal

import numpy as np
import trimesh
from trimesh.exchange.gltf import export_glb

from scaling_service.model.anatomy.lengths import find_joint_centres, find_segment
from scaling_service.model.body import BodyModel, Marker, Segment, Vector, to_vector
from scaling_service.model.compile import compile_model, list_parameter_values
from scaling_service.model.poses import evaluate_marker, follow, list_model_values, pose_neutral_frames
from scaling_service.model.results import Array, Calibration
from scaling_service.model.trial import Bone
from scaling_service.numerics.multibody.tree import pose_markers
from scaling_service.report.methods import spell_name
from scaling_service.report.scene import Body, Pair, Scene

_AXIS_HALF_M = 0.07
"""Chosen: a knee axis is drawn a little wider than a knee."""

MOST_FACES = 20_000
"""Of a bone: fine enough to fill a screen, and two legs of them turn smoothly."""

THICKNESS, THINNEST_M, THICKEST_M = 0.07, 0.012, 0.035
"""Chosen: radius of a simple shape over its length, about a long bone's, and its bounds."""

NEAR_AN_END = 0.25
"""Chosen: share of a segment's length within which a joint belongs to one of its ends."""


class Drawing:
    """Points of a model that are drawn, and how they hang together."""

    def __init__(self, model: BodyModel) -> None:
        self._model = model
        self._points: list[Marker] = []
        self.markers: dict[str, int] = {}
        centres = find_joint_centres(model)
        self.centres = {name: self._add(segment, at) for name, (segment, at) in centres.items()}
        origins = {s.name: self._add(s.name, (0.0, 0.0, 0.0)) for s in model.segments}
        carried = {segment for segment, _ in centres.values()} | {m.segment for m in model.markers}
        drawn = _find_drawn(model, carried)
        self.sticks: list[Pair] = [
            (origins[s.parent], origins[s.name])
            for s in model.segments
            if s.parent in drawn and s.name in drawn
        ]
        self.sticks += [
            (origins[segment], self.centres[name])
            for name, (segment, _) in centres.items()
            if not any(child.name in drawn for child in model.children(segment))
        ]
        if {"hip_r", "hip_l"} <= set(centres):
            self.sticks.append((self.centres["hip_r"], self.centres["hip_l"]))
        self.axes: list[Pair] = [
            (self._add(segment, ends[0]), self._add(segment, ends[1]))
            for segment, ends in find_knee_axes(model).items()
        ]

    def _add(self, segment: str, at: Vector) -> int:
        self._points.append(Marker.at(f"point {len(self._points)}", segment, at))
        return len(self._points) - 1

    def add_marker(self, name: str) -> None:
        """One of the model's own markers."""
        self.markers[name] = len(self._points)
        self._points.append(replace(self._model.marker(name), name=f"point {len(self._points)}"))

    def positions(self, q: Array) -> Array:
        """(n_frames, n_points, 3), m."""
        return place_points(self._model, tuple(self._points), q)


def draw_body(
    name: str,
    colour: str,
    model: BodyModel,
    q: Array,
    markers: Sequence[str],
    labels: Sequence[str],
    bones: Mapping[str, Array] = MappingProxyType({}),
    *,
    shown: bool = True,
) -> Body:
    """A model as drawn over frames q, (n_frames, n_coordinates).

    ``markers``, ``labels``: the model's markers to draw, and those that were measured.
    ``bones``: surface to where it is, (n_frames, 12); see :class:`Body`.
    """
    drawing = Drawing(model)
    for marker in markers:
        drawing.add_marker(marker)
    return Body(
        name=name,
        colour=colour,
        points=drawing.positions(q),
        centres=[(k, spell_name(centre)) for centre, k in drawing.centres.items()],
        sticks=drawing.sticks,
        axes=drawing.axes,
        markers=[(k, marker, labels.index(marker)) for marker, k in drawing.markers.items()],
        bones=bones,
        shown=shown,
    )


def _find_drawn(model: BodyModel, carried: set[str]) -> set[str]:
    """Segments that carry a marker or a joint centre, or lead to one that does."""
    found: set[str] = set()
    for segment in reversed(model.segments):
        if segment.name in carried or any(child.name in found for child in model.children(segment.name)):
            found.add(segment.name)
    return found


def find_knee_axes(model: BodyModel) -> dict[str, tuple[Vector, Vector]]:
    """Thigh to both ends of its knee's axis in its frame, m, with the knee straight; hinges only."""
    found = {}
    for side in ("r", "l", ""):
        thigh, shank = (find_segment(model, role, side) for role in ("femur", "tibia"))
        if thigh is not None and shank is not None and model.segment(shank).parent == thigh:
            axis = _find_first_axis(model, model.segment(shank))
            if axis is not None:
                centre, direction = axis
                ends = (centre - _AXIS_HALF_M * direction, centre + _AXIS_HALF_M * direction)
                found[thigh] = (to_vector(ends[0]), to_vector(ends[1]))
    return found


def _find_first_axis(model: BodyModel, segment: Segment) -> tuple[Array, Array] | None:
    """Where, and along which direction, the first driven turn of a joint acts in the parent's frame."""
    values = list_model_values(model)
    for k, joint in enumerate(segment.joints):
        if joint.kind == "rotation" and joint.law.coordinates:
            rotation, origin = follow(segment.joints[:k], values)
            return origin, rotation @ np.asarray(joint.axis)
    return None


def place_points(model: BodyModel, points: tuple[Marker, ...], q: Array) -> Array:
    """Points of segments in ground, (n_frames, n_points, 3), m."""
    carrier = model.with_markers(points)
    return pose_markers(compile_model(carrier), q, list_parameter_values(carrier))


def follow_person(scene: Scene) -> Scene:
    """Seen from a point that goes along: the measured markers' centre stays above one place of the floor."""
    centre = _fill_gaps(
        np.array(
            [
                np.nanmean(frame, axis=0) if np.isfinite(frame).any() else [np.nan] * 3
                for frame in scene.measured
            ]
        )
    )
    shift = centre * [1.0, 0.0, 1.0]

    def move(bones: Mapping[str, Array]) -> dict[str, Array]:
        still = np.zeros((len(shift), 9))
        return {name: pose - np.concatenate([still, shift], axis=1) for name, pose in bones.items()}

    return replace(
        scene,
        measured=scene.measured - shift[:, None],
        bodies=[replace(b, points=b.points - shift[:, None], bones=move(b.bones)) for b in scene.bodies],
    )


def _fill_gaps(path: Array) -> Array:
    """Frames that show nothing take the nearest known values, linearly between."""
    known = np.isfinite(path).all(axis=1)
    rows = np.arange(len(path))
    return np.stack([np.interp(rows, rows[known], path[known, k]) for k in range(3)], axis=1)


Shape = Literal["image", "simple", "none"]


def build_surfaces(
    model: BodyModel, bones: Mapping[str, Bone]
) -> tuple[dict[str, trimesh.Trimesh], dict[str, Shape]]:
    """A surface of every segment that has a size, in the segment's frame.

    ``bones``: segment to its bone in the segment's frame, m, with few faces.
    Returns ``surfaces``: segment to surface, m; ``shapes``: every segment to where its surface is from.
    """
    found: dict[str, trimesh.Trimesh] = {}
    shapes: dict[str, Shape] = {}
    for name in model.segment_names:
        if name in bones:
            found[name], shapes[name] = _smooth(bones[name]), "image"
        elif (simple := make_simple_shape(_list_points(model, name))) is not None:
            found[name], shapes[name] = simple, "simple"
        else:
            shapes[name] = "none"
    return found, shapes


def to_glb(meshes: Mapping[str, trimesh.Trimesh]) -> bytes:
    """Surfaces as binary glTF, each a node of its segment's name that stands where its frame stands."""
    scene = trimesh.Scene()
    for name, mesh in meshes.items():
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    content: bytes = export_glb(scene, include_normals=True)  # type: ignore[no-untyped-call]
    return content


def _smooth(bone: Bone) -> trimesh.Trimesh:
    mesh = trimesh.Trimesh(bone.vertices, bone.faces, process=False)
    mesh.merge_vertices()
    return mesh


def _list_points(model: BodyModel, segment: str) -> Array:
    """Joints and markers of a segment in its frame; of a long one the ends alone, which show its axis."""
    joints = np.stack([np.zeros(3), *_list_joints(model, segment)])
    ends = find_ends(joints)
    if ends is not None:
        return ends
    values = list_model_values(model)
    markers = [evaluate_marker(m, values) for m in model.markers if m.segment == segment and m.weight > 0.0]
    return np.stack([*joints, *markers])


def find_ends(joints: Array) -> Array | None:
    """Both ends of a segment whose joints all lie near one of two, such as a thigh with its kneecap's.

    ``joints``: (n, 3), m.
    Returns (2, 3), m, or None where joints lie all around, as a pelvis's do, or there is only one place.
    """
    apart = np.linalg.norm(joints[:, None] - joints, axis=2)
    length = float(apart.max())
    if length < THINNEST_M:
        return None
    one, other = np.unravel_index(int(apart.argmax()), apart.shape)
    nearest = np.minimum(apart[one], apart[other])
    return joints[[one, other]] if nearest.max() < NEAR_AN_END * length else None


def _list_joints(model: BodyModel, segment: str) -> Iterator[Array]:
    frames = pose_neutral_frames(model)
    R, origin = frames[segment]
    for child in model.children(segment):
        yield (frames[child.name][1] - origin) @ R
    yield from (np.array(at) for where, at in find_joint_centres(model).values() if where == segment)


def make_simple_shape(points: Array) -> trimesh.Trimesh | None:
    """A smooth shape around points, (n, 3), m; None where they have no extent.

    Two points give a rod with round ends, more give their hull, as if wrapped around balls.
    """
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    if len(points) < 2 or extent < THINNEST_M:
        return None
    radius = min(max(THICKNESS * extent, THINNEST_M), THICKEST_M)
    ball = trimesh.creation.icosphere(subdivisions=2, radius=radius).vertices
    cloud = (points[:, None] + ball[None]).reshape(-1, 3)
    hull: trimesh.Trimesh = trimesh.convex.convex_hull(cloud)
    return hull


def place_bones(calibration: Calibration, bones: Mapping[str, Bone]) -> dict[str, Bone]:
    """Each imaged bone in its segment's frame, m; bones without a pose in the image are left out."""
    return {
        name: Bone(pose.to_local(bones[name].vertices), bones[name].faces)
        for name, pose in calibration.image_poses.items()
        if name in bones
    }
