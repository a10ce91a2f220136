"""Bones of the person in the frames of the scaled model, for viewers and simulation programs.

``bones/<segment>.stl`` is a segment's bone in that segment's frame of the model, in **m**, as the image
shows it. ``bones.glb`` is the whole skeleton in the model's neutral standing pose, in ground, m, Y up (as
glTF asks); every bone is a node of its segment's name.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import trimesh
from trimesh.exchange.gltf import export_glb
from trimesh.exchange.stl import export_stl
from trimesh.visual import ColorVisuals

from scaling_service.model.poses import neutral_frames
from scaling_service.model.results import Array, Calibration
from scaling_service.model.trial import Bone

FOLDER = "bones"
SKELETON = "bones.glb"
COLOUR = (227, 218, 201, 255)  # bone, as X11 and most atlases draw it


def local_bones(calibration: Calibration, bones: Mapping[str, Bone]) -> dict[str, Bone]:
    """Each imaged bone in its segment's frame, m.

    Parameters
    ----------
    calibration : Calibration
        Its ``image_poses`` say where the segments lie in the image; bones without a pose are left out.
    bones : mapping
        Segment to its bone in the image's frame.
    """
    return {
        name: Bone(pose.to_local(bones[name].vertices), bones[name].faces)
        for name, pose in calibration.image_poses.items()
        if name in bones
    }


def write_bones(folder: Path, calibration: Calibration, bones: Mapping[str, Bone]) -> list[str]:
    """Write a method's bones beside its model.

    Parameters
    ----------
    folder : Path
        The method's folder.

    Returns
    -------
    list of str
        What was written, relative to ``folder``; empty where the method has no bones.
    """
    local = local_bones(calibration, bones)
    if not local:
        return []
    meshes = {name: _mesh(bone) for name, bone in local.items()}
    (folder / FOLDER).mkdir()
    written = []
    for name, mesh in meshes.items():
        path = folder / FOLDER / f"{name}.stl"
        path.write_bytes(export_stl(mesh))
        written.append(path.relative_to(folder).as_posix())
    (folder / SKELETON).write_bytes(_skeleton(calibration, meshes))
    return [*written, SKELETON]


def _mesh(bone: Bone) -> trimesh.Trimesh:
    """The surface with corners that fall together made one, as smooth shading asks."""
    mesh = trimesh.Trimesh(bone.vertices, bone.faces, process=False)
    mesh.merge_vertices()
    mesh.visual = ColorVisuals(mesh, face_colors=COLOUR)
    return mesh


def _skeleton(calibration: Calibration, meshes: Mapping[str, trimesh.Trimesh]) -> bytes:
    frames = neutral_frames(calibration.model)
    scene = trimesh.Scene()
    for name, mesh in meshes.items():
        scene.add_geometry(mesh, node_name=name, geom_name=name, transform=_transform(*frames[name]))
    content: bytes = export_glb(scene)  # type: ignore[no-untyped-call]
    return content


def _transform(rotation: Array, origin: Array) -> Array:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, origin
    return matrix
