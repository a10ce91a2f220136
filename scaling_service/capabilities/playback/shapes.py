"""Surfaces of a body's segments as one binary glTF: the person's bones, else simple shapes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Literal

import numpy as np
import trimesh
from trimesh.exchange.gltf import export_glb

from scaling_service.model.anatomy.lengths import joint_centres
from scaling_service.model.body import BodyModel
from scaling_service.model.poses import marker_position, model_values, neutral_frames
from scaling_service.model.results import Array, Calibration
from scaling_service.model.trial import Bone

MOST_FACES = 20_000
"""Of a bone: fine enough to fill a screen, and two legs of them turn smoothly."""

THICKNESS, THINNEST_M, THICKEST_M = 0.07, 0.012, 0.035
"""Chosen: radius of a simple shape over its length, about a long bone's, and its bounds."""

NEAR_AN_END = 0.25
"""Chosen: share of a segment's length within which a joint belongs to one of its ends."""

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
        elif (simple := simple_shape(_points(model, name))) is not None:
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


def _points(model: BodyModel, segment: str) -> Array:
    """Joints and markers of a segment in its frame; of a long one the ends alone, which show its axis."""
    joints = np.stack([np.zeros(3), *_joints(model, segment)])
    ends = find_ends(joints)
    if ends is not None:
        return ends
    values = model_values(model)
    markers = [marker_position(m, values) for m in model.markers if m.segment == segment and m.weight > 0.0]
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


def _joints(model: BodyModel, segment: str) -> Iterator[Array]:
    frames = neutral_frames(model)
    R, origin = frames[segment]
    for child in model.children(segment):
        yield (frames[child.name][1] - origin) @ R
    yield from (np.array(at) for where, at in joint_centres(model).values() if where == segment)


def simple_shape(points: Array) -> trimesh.Trimesh | None:
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
