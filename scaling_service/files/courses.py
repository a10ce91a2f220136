"""Courses of tendons: sites, and bends over surfaces between them."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from scaling_service.core.arrays import Array
from scaling_service.model import body, muscles
from scaling_service.model.poses import pose_segments


@dataclass(frozen=True, slots=True)
class Site:
    """A point that a tendon passes."""

    name: str
    segment: str
    at: body.Vector  # (3,), m


@dataclass(frozen=True, slots=True)
class Bend:
    """A cylinder or sphere that a tendon bends over, on the side of a site if there is one."""

    surface: muscles.WrapSurface
    side: Site | None = None


@dataclass(frozen=True, slots=True)
class Tendon:
    """A muscle's course: sites, and bends each between two of them."""

    muscle: muscles.Muscle
    course: tuple[Site | Bend, ...]
    changed: tuple[str, ...]  # what differs from the muscle's path, in plain words


@dataclass(frozen=True, slots=True)
class Tendons:
    """All muscles' courses, and segments without mass for sites that move in theirs."""

    tendons: tuple[Tendon, ...]
    movers: tuple[body.Segment, ...]
    untouched: tuple[str, ...]  # muscle and surface it does not touch in any pose: the surface is left out


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """The model in the poses that contacts were looked at in."""

    model: body.BodyModel
    q: Array  # (n_poses, n_coordinates)
    origins: abc.Mapping[str, Array]  # segment to (n_poses, 3), m
    turns: abc.Mapping[str, Rotation]

    def to_ground(self, segment: str, at: abc.Sequence[float] | Array) -> Array:
        """Points, (3,) or (n_poses, 3), of a segment in ground, (n_poses, 3)."""
        return np.asarray(self.origins[segment] + self.turns[segment].apply(np.asarray(at)))

    def to_segment(self, segment: str, points: Array) -> Array:
        """Points in ground, (n_poses, 3), in a segment."""
        return np.asarray(self.turns[segment].inv().apply(points - self.origins[segment]))


def pose_model(model: body.BodyModel, q: Array) -> Poses:
    """A model in some poses, (n_poses, n_coordinates), rad or m."""
    placed, names = pose_segments(model, q), model.segment_names
    return Poses(
        model,
        q,
        {name: placed[:, k, :3] for k, name in enumerate(names)},
        {name: Rotation.from_quat(placed[:, k, 3:]) for k, name in enumerate(names)},
    )


def gather_touches(
    contacts: abc.Sequence[abc.Sequence[muscles.Contact]], number: int, names: abc.Collection[str | None]
) -> Array:
    """Where a path first, midway and last touches a surface of some names after one of its points.

    ``contacts``: of one muscle, by pose. (3, n_poses, 3), m; NaN where it does not.
    """
    touches = np.full((3, len(contacts), 3), np.nan)
    for k, pose in enumerate(contacts):
        for contact in pose:
            if contact.after == number and contact.surface in names:
                touches[:, k] = contact.first, contact.middle, contact.last
    return touches


def find_nearest(point: Array, start: Array, stop: Array, *, beyond: bool = False) -> Array:
    """The place on each line from start to stop, (n, 3) each, that is nearest to a point, (3,) or (n, 3).

    ``beyond``: on the line beyond its ends, too.
    """
    along = stop - start
    share = np.sum((point - start) * along, axis=1) / np.sum(along * along, axis=1)
    return np.asarray(start + (share if beyond else np.clip(share, 0.0, 1.0))[:, None] * along)
