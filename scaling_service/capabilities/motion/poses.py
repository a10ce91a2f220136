"""Where every segment is: origins and body-fixed X-Y-Z angles, as OpenSim's BodyKinematics names them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scaling_service.files.sto import Table
from scaling_service.model.body import BodyModel, Marker
from scaling_service.model.compile import compile_model, default_coordinates, parameter_values
from scaling_service.model.results import Motion
from scaling_service.numerics.multibody.laws import NONE, Array
from scaling_service.numerics.multibody.tree import Tree, forward

_BLOCK = 4096  # frames: 30 MB of frames of a whole body


@dataclass(frozen=True, slots=True, eq=False)
class SegmentPoses:
    """Every segment over a trial."""

    segments: tuple[str, ...]
    # Both (n_frames, n_segments, 3); NaN where a coordinate that carries the segment is not determined.
    origins: Array  # m, in ground
    angles: Array  # rad, turns about the segment's own X, then Y, then Z, from ground's axes to its own


def segment_poses(model: BodyModel, motion: Motion) -> SegmentPoses:
    """Poses of all segments of the model that was tracked, those without markers too."""
    names = model.segment_names
    marked = model.with_markers(tuple(Marker.at(name, name, (0.0, 0.0, 0.0)) for name in names))
    tree, p = compile_model(marked), parameter_values(model)
    unknown = np.isnan(motion.q)
    q = np.where(unknown, default_coordinates(model, 1), motion.q)
    origins, angles = np.empty((2, len(q), len(names), 3))
    for start in range(0, len(q), _BLOCK):
        rows = slice(start, start + _BLOCK)
        poses = forward(tree, np.ascontiguousarray(q[rows].T), p)
        origins[rows] = np.moveaxis(poses.origins, -1, 0)
        angles[rows] = np.moveaxis(_angles(poses.axes), -1, 0)
    lost = (unknown.astype(float) @ _carrying(tree).T) > 0.0
    origins[lost] = angles[lost] = np.nan
    return SegmentPoses(names, origins, angles)


def _angles(axes: Array) -> Array:
    """Body-fixed X-Y-Z angles (k, 3, n) of axes (k, 3, 3, n): ``axes[k, j]`` is the j-th axis in ground."""
    about_y = np.arctan2(axes[:, 2, 0], np.hypot(axes[:, 0, 0], axes[:, 1, 0]))
    about_x = np.arctan2(-axes[:, 2, 1], axes[:, 2, 2])
    about_z = np.arctan2(-axes[:, 1, 0], axes[:, 0, 0])
    return np.stack([about_x, about_y, about_z], axis=1)


def _carrying(tree: Tree) -> Array:
    """One where a coordinate moves a link or what carries it, (n_links, n_coordinates)."""
    carrying = np.zeros((len(tree.links), tree.n_coordinates))
    for k, link in enumerate(tree.links):
        if link.parent != NONE:
            carrying[k] = carrying[link.parent]
        carrying[k, [v for v in tree.variables[k] if v < tree.n_coordinates]] = 1.0
    return carrying


def poses_table(name: str, times: Array, poses: SegmentPoses) -> Table:
    """Columns as OpenSim's BodyKinematics has them: origin in ground (m), body-fixed X-Y-Z angles (deg)."""
    values = np.concatenate([poses.origins, np.degrees(poses.angles)], axis=2)
    columns = [
        f"{segment}_{part}" for segment in poses.segments for part in ("X", "Y", "Z", "Ox", "Oy", "Oz")
    ]
    return Table(
        name,
        ("time", *columns),
        np.concatenate([times[:, None], values.reshape(len(times), -1)], axis=1),
        in_degrees=True,
    )
