"""Where the landmarks that inertial tables count from lie on a built-in model of any size.

A model is read in its neutral posture, all coordinates zero: then all segments' axes are parallel (the
forearms turned by 90 degrees), and distances between joint centres are the segments' lengths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.core.errors import InputError
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import parameter_values
from scaling_service.model.inertia_tables import Sex, inertia_table
from scaling_service.model.massive import whole_tree
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import forward

CENTRES = {
    "HJC": "femur",
    "KJC": "tibia",
    "AJC": "calcn",
    "SJC": "humerus",
    "EJC": "ulna",
    "WJC": "hand",
    "LJC": "abdomen",
    "TJC": "torso",
    "CJC": "head",
}
"""Joint centre to the segment whose origin it is."""

MARKERS = {
    "AJC": ("AJC",),
    "MHC": ("MH2", "MH5"),
    "MTC": ("MT1", "MT5"),
    "HEEL": ("HEE",),
}
"""Landmark to the markers whose middle it is, without the side's letter."""

LUMBAR = {"M": (-0.335, -0.032), "F": (-0.340, 0.049)}
"""Lumbar centre from the middle of the ASIS, x and y over the ASIS width (Reed et al. 1999, as given by Dumas
and Wojtusch 2018)."""

AHEAD = {"VERT": (0.0, 1.0, 0.0), "TTIP": (1.0, 0.0, 0.0)}
"""Ends of spans that no model has: up from the cervical centre, forward from the heel or ankle."""

TRUNK = "deleva1996"
"""The table whose proportions place xiphion and omphalion between cervical centre and mid-hip."""


@dataclass(frozen=True, slots=True, eq=False)
class Neutral:
    """A model in its neutral posture.

    Parameters
    ----------
    model : BodyModel
    axes : ndarray, shape (n_segments, 3, 3)
        ``axes[k] @ v`` is a segment's vector in ground.
    origins : ndarray, shape (n_segments, 3), m
    markers : ndarray, shape (n_markers, 3), m
    """

    model: BodyModel
    axes: Array
    origins: Array
    markers: Array

    @classmethod
    def of(cls, model: BodyModel) -> Neutral:
        """Pose the model."""
        q, p = np.zeros((len(model.coordinates), 1)), parameter_values(model)
        poses = forward(whole_tree(model), q, p)
        number = {name: k for k, name in enumerate(model.segment_names)}
        axes = poses.axes[..., 0].transpose(0, 2, 1)
        origins = poses.origins[..., 0]
        local = np.array([m.nominal for m in model.markers]).reshape(-1, 3)
        on = [number[m.segment] for m in model.markers]
        markers = np.einsum("mai,mi->ma", axes[on], local) + origins[on]
        return cls(model, axes, origins, markers)

    def origin(self, segment: str) -> Array | None:
        """A segment's origin in ground, None if the model has no such segment."""
        names = self.model.segment_names
        return self.origins[names.index(segment)] if segment in names else None

    def marker(self, name: str) -> Array | None:
        """A marker in ground, None if the model has no such marker."""
        names = self.model.marker_names
        return self.markers[names.index(name)] if name in names else None

    def local(self, segment: str, point: Array) -> Array:
        """A point of the ground in a segment's frame, m."""
        k = self.model.segment_names.index(segment)
        local: Array = self.axes[k].T @ (point - self.origins[k])
        return local


def landmark(neutral: Neutral, name: str, side: str, sex: Sex) -> Array | None:
    """A landmark in ground, m; None where the model does not show it.

    Parameters
    ----------
    name : str
        As tables call it: ``HJC``, ``MTC``, ``XYPH`` …
    side : 'r', 'l' or ''
    """
    if name in CENTRES:
        for segment in (f"{CENTRES[name]}_{side}", CENTRES[name]):
            found = neutral.origin(segment)
            if found is not None:
                return found
    if name == "LJC":
        return _lumbar(neutral, sex)
    if name in MARKERS:
        return _middle([neutral.marker(f"{side.upper()}{marker}") for marker in MARKERS[name]])
    if name in ("MIDH", "HJCS"):
        return _middle([neutral.origin(f"femur_{s}") for s in "rl"])
    if name in ("XYPH", "OMPH"):
        return _on_trunk(neutral, name, sex)
    return None


def _middle(points: Sequence[Array | None]) -> Array | None:
    """Mean of some points, None where one is missing."""
    known = [p for p in points if p is not None]
    return np.asarray(np.mean(known, axis=0)) if len(known) == len(points) else None


def _lumbar(neutral: Neutral, sex: Sex) -> Array | None:
    right, left = neutral.marker("RASIS"), neutral.marker("LASIS")
    if right is None or left is None:
        return None
    width = float(np.linalg.norm(right - left))
    x, y = LUMBAR[sex]
    return np.asarray(0.5 * (right + left) + width * np.array([x, y, 0.0]))


def _on_trunk(neutral: Neutral, name: str, sex: Sex) -> Array | None:
    """Xiphion or omphalion on the line from the cervical centre to the mid-hip, by the table's lengths."""
    top, bottom = landmark(neutral, "CJC", "", sex), landmark(neutral, "MIDH", "", sex)
    if top is None or bottom is None:
        return None
    table = inertia_table(TRUNK)
    lengths = [table.row(part, sex).length_m or 0.0 for part in ("thorax", "abdomen", "pelvis")]
    share = sum(lengths[: 1 if name == "XYPH" else 2]) / sum(lengths)
    return np.asarray(top + share * (bottom - top))


def needed(neutral: Neutral, name: str, side: str, sex: Sex, segment: str) -> Array:
    """A landmark that must be known.

    Raises
    ------
    InputError
        The model does not show it.
    """
    found = landmark(neutral, name, side, sex)
    if found is None:
        raise InputError(
            f"model '{neutral.model.name}' does not show the landmark {name} of segment '{segment}'",
            field="inertia",
            remedy="Use another inertial table, or a model with feet and trunk",
        )
    return found
