"""What is drawn of a model: its knees' axes, and surfaces of its segments as glTF."""

from __future__ import annotations

from collections import abc
from typing import TYPE_CHECKING, Literal

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.model import body, poses
from scaling_service.model.anatomy import lengths
from scaling_service.model.results import Calibration
from scaling_service.model.trial import Bone

if TYPE_CHECKING:  # imported by each that makes a surface: it takes a third of a second
    import trimesh

Shape = Literal["image", "simple", "none"]

_AXIS_HALF_M = 0.07
"""Chosen: a knee axis is drawn a little wider than a knee."""

THICKNESS, THINNEST_M, THICKEST_M = 0.07, 0.012, 0.035
"""Chosen: radius of a simple shape over its length, about a long bone's, and its bounds."""

NEAR_AN_END = 0.25
"""Chosen: share of a segment's length within which a joint belongs to one of its ends."""


def find_knee_axes(model: body.BodyModel) -> dict[str, tuple[body.Vector, body.Vector]]:
    """Thigh to both ends of its knee's axis in its frame, m, with the knee straight; hinges only."""
    found = {}
    for side in ("r", "l", ""):
        thigh, shank = (lengths.find_segment(model, role, side) for role in ("femur", "tibia"))
        if thigh is not None and shank is not None and model.segment(shank).parent == thigh:
            axis = _find_first_axis(model, model.segment(shank))
            if axis is not None:
                centre, direction = axis
                ends = (centre - _AXIS_HALF_M * direction, centre + _AXIS_HALF_M * direction)
                found[thigh] = (body.to_vector(ends[0]), body.to_vector(ends[1]))
    return found


def _find_first_axis(model: body.BodyModel, segment: body.Segment) -> tuple[Array, Array] | None:
    """Where, and along which direction, the first driven turn of a joint acts in the parent's frame."""
    values = poses.list_model_values(model)
    for k, joint in enumerate(segment.joints):
        if joint.kind == "rotation" and joint.law.coordinates:
            rotation, origin = poses.follow(segment.joints[:k], values)
            return origin, rotation @ np.asarray(joint.axis)
    return None


def build_surfaces(
    model: body.BodyModel, bones: abc.Mapping[str, Bone]
) -> tuple[dict[str, trimesh.Trimesh], dict[str, Shape]]:
    """A surface of every segment that has a size, in the segment's frame.

    ``bones``: segment to its bone in the segment's frame, m, with few faces.
    Returns ``surfaces``: segment to surface, m; ``shapes``: every segment to where its surface is from.
    """
    import trimesh

    found: dict[str, trimesh.Trimesh] = {}
    shapes: dict[str, Shape] = {}
    for name in model.segment_names:
        if name in bones:
            bone = bones[name]
            found[name], shapes[name] = trimesh.Trimesh(bone.vertices, bone.faces, process=False), "image"
        elif (simple := make_simple_shape(_list_points(model, name))) is not None:
            found[name], shapes[name] = simple, "simple"
        else:
            shapes[name] = "none"
    return found, shapes


def to_glb(meshes: abc.Mapping[str, trimesh.Trimesh]) -> bytes:
    """Surfaces as binary glTF, each a node of its segment's name that stands where its frame stands."""
    import trimesh
    from trimesh.exchange.gltf import export_glb

    scene = trimesh.Scene()
    for name, mesh in meshes.items():
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    content: bytes = export_glb(scene, include_normals=True)  # type: ignore[no-untyped-call]
    return content


def _list_points(model: body.BodyModel, segment: str) -> Array:
    """Joints and markers of a segment in its frame; of a long one the ends alone, which show its axis."""
    frames = poses.pose_neutral_frames(model)
    R, origin = frames[segment]
    children = [(frames[child.name][1] - origin) @ R for child in model.children(segment)]
    centres = [np.array(at) for where, at in lengths.find_joint_centres(model).values() if where == segment]
    joints = np.stack([np.zeros(3), *children, *centres])
    ends = find_ends(joints)
    if ends is not None:
        return ends
    values = poses.list_model_values(model)
    markers = [
        poses.evaluate_marker(m, values) for m in model.markers if m.segment == segment and m.weight > 0.0
    ]
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


def make_simple_shape(points: Array) -> trimesh.Trimesh | None:
    """A smooth shape around points, (n, 3), m; None where they have no extent.

    Two points give a rod with round ends, more give their hull, as if wrapped around balls.
    """
    import trimesh

    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    if len(points) < 2 or extent < THINNEST_M:
        return None
    radius = min(max(THICKNESS * extent, THINNEST_M), THICKEST_M)
    ball = trimesh.creation.icosphere(subdivisions=2, radius=radius).vertices
    cloud = (points[:, None] + ball[None]).reshape(-1, 3)
    hull: trimesh.Trimesh = trimesh.convex.convex_hull(cloud)
    return hull


def place_bones(calibration: Calibration, bones: abc.Mapping[str, Bone]) -> dict[str, Bone]:
    """Each imaged bone in its segment's frame, m; bones without a pose in the image are left out."""
    return {
        name: Bone(pose.to_local(bones[name].vertices), bones[name].faces)
        for name, pose in calibration.image_poses.items()
        if name in bones
    }


def coarsen(bone: Bone, most_faces: int) -> Bone:
    """A surface of fewer triangles, by collapsing edges where it hardly changes (VTK's quadric decimation).

    Thin plates such as the wing of a pelvis keep both of their sides. For pictures, not for measuring.

    ``most_faces``: about the number left; a surface that has no more stays as it is.

    Examples
    --------
    >>> import numpy as np
    >>> flat = Bone(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    >>> coarsen(flat, 4000).faces.shape
    (1, 3)
    """
    count = len(bone.faces)
    if count <= most_faces:
        return bone
    import pyvista  # only here: it takes half a second and 80 MB, which who shows no bones should not pay
    import trimesh

    # STL files repeat each corner in every triangle; only shared edges can be collapsed.
    merged = trimesh.Trimesh(bone.vertices, bone.faces)
    merged.update_faces(merged.nondegenerate_faces())
    surface = pyvista.PolyData.from_regular_faces(merged.vertices, np.asarray(merged.faces, dtype=int))
    reduced = surface.decimate(1.0 - most_faces / count)
    return Bone(np.asarray(reduced.points, dtype=np.float64), np.asarray(reduced.regular_faces))
