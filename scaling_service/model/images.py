"""What images say of a person: joint centres, axes, landmarks on bone, markers on skin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from scaling_service.model.body import Vector

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Bone:
    """A bone's surface in the image's frame.

    Parameters
    ----------
    vertices : (n_vertices, 3), m
    faces : (n_faces, 3)
        Indices of each triangle's corners.
    """

    vertices: Array
    faces: NDArray[np.integer]


@dataclass(frozen=True, slots=True, eq=False)
class ImagePose:
    """Where a segment's frame lies in the image: ``point_image = rotation @ point_segment + origin``.

    Parameters
    ----------
    rotation : (3, 3)
    origin : (3,), m
    """

    rotation: Array
    origin: Array

    def to_local(self, points: Array) -> Array:
        """Points of the image, (n, 3) or (3,), in the segment's frame, m."""
        local: Array = (points - self.origin) @ self.rotation
        return local


@dataclass(frozen=True, slots=True)
class ImageEvidence:
    """Points of one image session, all in its frame, m.

    Parameters
    ----------
    centres : mapping
        ``hip_r``, ``knee_r``, ``ankle_r`` and the left ones, as far as imaged.
    axes : mapping
        ``knee_r``, ``knee_l``: direction of the flexion axis, either way round.
    landmarks : mapping
        Points on bone by the name of the marker that is put on them (``RASIS``, ``RLFE`` …).
    markers : mapping
        Skin markers seen in the image: model marker to (segment, position).
    source : str
        How they were found.
    bones : mapping
        Segment to the surface of its bone, as far as imaged.
    """

    centres: Mapping[str, Vector] = field(default_factory=dict)
    axes: Mapping[str, Vector] = field(default_factory=dict)
    landmarks: Mapping[str, Vector] = field(default_factory=dict)
    markers: Mapping[str, tuple[str, Vector]] = field(default_factory=dict)
    source: str = ""
    bones: Mapping[str, Bone] = field(default_factory=dict)

    def sides(self) -> tuple[str, ...]:
        """The legs of which hip, knee and ankle centre are known."""
        return tuple(
            s for s in "rl" if all(f"{joint}_{s}" in self.centres for joint in ("hip", "knee", "ankle"))
        )
