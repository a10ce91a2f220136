"""Joint centres by construction: hips predicted from the pelvis markers, knees and ankles on a chord.

All regressions are given in the ISB pelvis frame (``pelvis_frame``) with its origin half-way between the
ASIS: x forward, y up, z to the right; the left hip mirrors z. No correction is made for the skin over the
bone, nor for the marker's radius but by the regressions that ask for it.

The conventional marker set has only lateral markers at knee and ankle. A joint's centre is taken to lie in
the plane of the proximal joint's centre, the lateral marker and a marker on the segment's side (often on a
wand), where the lines to the proximal centre and to the lateral marker meet at a right angle (Kadaba et al.
1990, J Orthop Res 8:383; Davis et al. 1991, Hum Mov Sci 10:575). The lateral marker is half of the joint's
width and the marker's own radius away from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians, sin
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scaling_service.core.errors import InputError
from scaling_service.model.anatomy.frames import pelvis_frame

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PelvisSize:
    """What the regressions predict from, each (n_frames,) or a number, m."""

    width: Array  # distance between the ASIS
    depth: Array  # distance from the midpoint of the ASIS to that of the PSIS
    leg_length: Array | None = None
    """Distance from the ASIS to the medial malleolus of the same side, or None if not known."""
    mean_leg_length: Array | None = None  # of both sides; that of the same side where only one is known
    marker_radius: float = 0.0  # from a marker's centre to the skin


class HipRegression(Protocol):
    """A published prediction of the right hip centre."""

    @property
    def source(self) -> str:
        """Where it was published."""
        ...

    @property
    def needs_leg_length(self) -> bool:
        """Whether :attr:`PelvisSize.leg_length` must be known."""
        ...

    def __call__(self, size: PelvisSize) -> tuple[Array, Array, Array]:
        """The right hip centre x, y, z in the pelvis frame, m."""
        ...


@dataclass(frozen=True, slots=True)
class LinearRegression:
    """A prediction whose every component is linear in width, depth and leg length.

    ``x``, ``y`` and ``z`` hold the coefficients of width, depth, leg length (no unit), and a constant (m).
    """

    source: str
    x: tuple[float, float, float, float]
    y: tuple[float, float, float, float]
    z: tuple[float, float, float, float]

    @property
    def needs_leg_length(self) -> bool:
        """Whether any component uses the leg length."""
        return any(row[2] != 0.0 for row in (self.x, self.y, self.z))

    def __call__(self, size: PelvisSize) -> tuple[Array, Array, Array]:
        """The right hip centre x, y, z in the pelvis frame, m; ValueError without a leg length it needs."""
        x, y, z = (self._component(row, size) for row in (self.x, self.y, self.z))
        return x, y, z

    def _component(self, row: tuple[float, float, float, float], size: PelvisSize) -> Array:
        width, depth, leg, constant = row
        value = np.asarray(width * size.width + depth * size.depth + constant)
        if leg == 0.0:
            return value
        if size.leg_length is None:
            raise ValueError("this regression needs the leg length")
        return np.asarray(value + leg * size.leg_length)


@dataclass(frozen=True, slots=True)
class DavisRegression:
    """The hip centre of the conventional gait model, from leg length, pelvis width and marker radius.

    Davis et al. 1991 (Hum Mov Sci 10:575) found it at C = 0.115 L - 15.3 mm from the ASIS, at the angles
    ``theta`` (to the middle) and ``beta`` (downward), the ASIS standing 0.1288 L - 48.56 mm before the hip.
    """

    source: str
    theta: float
    beta: float
    """``theta``, ``beta``: rad."""

    @property
    def needs_leg_length(self) -> bool:
        """Always."""
        return True

    def __call__(self, size: PelvisSize) -> tuple[Array, Array, Array]:
        """The right hip centre x, y, z in the pelvis frame, m; ValueError without a leg length."""
        if size.leg_length is None:
            raise ValueError("this regression needs the leg length")
        mean = size.leg_length if size.mean_leg_length is None else size.mean_leg_length
        reach = 0.115 * mean - 0.0153
        ahead = 0.1288 * size.leg_length - 0.04856 + size.marker_radius
        x = reach * cos(self.theta) * sin(self.beta) - ahead * cos(self.beta)
        y = -reach * cos(self.theta) * cos(self.beta) - ahead * sin(self.beta)
        return np.asarray(x), np.asarray(y), np.asarray(size.width / 2.0 - reach * sin(self.theta))


HIP_REGRESSIONS: dict[str, HipRegression] = {
    "harrington2007_multi": LinearRegression(
        "Harrington 2007, J Biomech 40:595, several predictors; leave-one-out error 5.2, 3.6, 3.2 mm",
        x=(0.0, -0.24, 0.0, -0.0099),
        y=(-0.16, 0.0, -0.04, -0.0071),
        z=(0.16, 0.28, 0.0, 0.0079),
    ),
    "harrington2007_single": LinearRegression(
        "Harrington 2007, J Biomech 40:595, one predictor per component",
        x=(0.0, -0.24, 0.0, -0.0099),
        y=(-0.30, 0.0, 0.0, -0.0109),
        z=(0.33, 0.0, 0.0, 0.0073),
    ),
    "bell1990": LinearRegression(
        "Bell 1990, J Biomech 23:617, adults; mean error 19 mm",
        x=(-0.19, 0.0, 0.0, 0.0),
        y=(-0.30, 0.0, 0.0, 0.0),
        z=(0.36, 0.0, 0.0, 0.0),
    ),
    "hara2016": LinearRegression(
        "Hara 2016, Sci Rep 6:37707, leg length only; leave-one-out error 5.2, 4.4, 3.8 mm",
        x=(0.0, 0.0, -0.063, 0.011),
        y=(0.0, 0.0, -0.078, -0.009),
        z=(0.0, 0.0, 0.086, 0.008),
    ),
    "davis1991": DavisRegression("Davis 1991, Hum Mov Sci 10:575", radians(28.4), radians(18.0)),
    "plug_in_gait": DavisRegression("Davis 1991 with the rounded angles of Vicon Plug-in Gait", 0.5, 0.314),
}
"""Linear ones: coefficients of width, depth, leg length, and the constant in m."""


@dataclass(frozen=True, slots=True, eq=False)
class HipCentres:
    """Both hip centres, each (n_frames, 3), m: in the pelvis frame, and in ground."""

    right: Array
    left: Array
    right_ground: Array
    left_ground: Array


def hip_centres(
    rasis: ArrayLike,
    lasis: ArrayLike,
    rpsis: ArrayLike,
    lpsis: ArrayLike,
    *,
    regression: str = "harrington2007",
    leg_length_r: ArrayLike | None = None,
    leg_length_l: ArrayLike | None = None,
    width: ArrayLike | None = None,
    marker_radius: float = 0.0,
) -> HipCentres:
    """Predict both hip centres from the four pelvis markers.

    ``rasis``, ``lasis``, ``rpsis``, ``lpsis`` (n_frames, 3), m: NaN where missing. Where only the sacrum was
        marked, give it as both PSIS.
    ``regression``: a key of ``HIP_REGRESSIONS``, or ``harrington2007``, which is ``harrington2007_single``:
        the form with several predictors weighs pelvic depth and leg length, which skin and tape tell worst.
        (Puchaud 2019 does not say which was used.)
    ``leg_length_r``, ``leg_length_l`` float or (n_frames,), m: ASIS to medial malleolus. If only one is known
        it serves both sides.
    ``width`` float or (n_frames,), m: distance between the ASIS where it was measured on the person (under
        fat the markers stand elsewhere); by default that of the markers.
    ``marker_radius`` m: used by ``davis1991`` and ``plug_in_gait``.
    NaN in frames where one of the four markers is missing.
    Raises InputError: an unknown regression, or one that needs a leg length that is not given.
    """
    markers = [np.atleast_2d(np.asarray(m, dtype=float)) for m in (rasis, lasis, rpsis, lpsis)]
    front, back = (markers[0] + markers[1]) / 2.0, (markers[2] + markers[3]) / 2.0
    depth = np.linalg.norm(front - back, axis=1)
    apart = (
        np.linalg.norm(markers[0] - markers[1], axis=1) if width is None else np.asarray(width, dtype=float)
    )
    frame = pelvis_frame(*markers)
    legs = [np.asarray(leg, dtype=float) for leg in (leg_length_r, leg_length_l) if leg is not None]
    chosen = _choose(regression, bool(legs))
    mean = np.asarray(sum(legs) / len(legs)) if legs else None
    local = []
    for leg, side in ((leg_length_r, 1.0), (leg_length_l, -1.0)):
        own = np.asarray(leg, dtype=float) if leg is not None else (legs[0] if legs else None)
        x, y, z = chosen(PelvisSize(apart, depth, own, mean, marker_radius))
        centre = np.column_stack(np.broadcast_arrays(x, y, side * z, depth)[:3])
        local.append(np.where(np.isfinite(frame.origin), centre, np.nan))
    right, left = local
    return HipCentres(right, left, frame.to_ground(right), frame.to_ground(left))


def _choose(name: str, leg_length_known: bool) -> HipRegression:
    if name == "harrington2007":
        name = "harrington2007_single"
    if name not in HIP_REGRESSIONS:
        raise InputError(
            f"there is no hip centre regression '{name}'",
            field="hip_regression",
            remedy=f"Use harrington2007 or one of {', '.join(HIP_REGRESSIONS)}",
        )
    chosen = HIP_REGRESSIONS[name]
    if chosen.needs_leg_length and not leg_length_known:
        raise InputError(
            f"the hip centre regression '{name}' needs the leg length",
            field="hip_regression",
            remedy="Mark the medial malleolus in the static trial, or use harrington2007_single",
        )
    return chosen


_MIN_OUT_OF_LINE = 1e-3  # m; chosen: a plane marker nearer to the line than this tells no plane


def chord_centre(proximal: ArrayLike, lateral: ArrayLike, plane: ArrayLike, distance: ArrayLike) -> Array:
    """The joint centre at a right angle between the proximal centre and the lateral marker.

    It lies in the plane of the three points, and the line from the proximal centre to the lateral marker
    separates it from the plane marker.

    ``proximal``, ``lateral``, ``plane`` ((n_frames, 3), m): proximal joint centre (hip for the knee, knee for
    the ankle), lateral marker of the joint, and the marker on the segment between them (thigh or shank wand).
    ``distance`` (float or (n_frames,), m): from the centre to the lateral marker: half the joint's width and
    the marker's radius. Returns (n_frames, 3), m: NaN where a point is missing, the proximal centre is nearer
    to the lateral marker than ``distance``, or the plane marker is within a millimetre of the line.

    Examples
    --------
    >>> chord_centre([[0, 0.4, 0]], [[0, 0, 0.05]], [[0, 0.2, 0.09]], 0.05).round(6) + 0.0
    array([[0., 0., 0.]])
    """
    top, side, wand = (
        np.atleast_2d(np.asarray(points, dtype=float)) for points in (proximal, lateral, plane)
    )
    apart = np.broadcast_to(np.asarray(distance, dtype=float), side.shape[:1])[:, None]
    upward, towards = top - side, wand - side
    length = np.linalg.norm(upward, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        along = upward / length
        across = np.sum(towards * along, axis=1, keepdims=True) * along - towards
        out_of_line = np.linalg.norm(across, axis=1, keepdims=True)
        cosine = apart / length
        known = (apart > 0.0) & (cosine < 1.0) & (out_of_line > _MIN_OUT_OF_LINE)
        sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
        centre = side + apart * (cosine * along + sine * across / out_of_line)
    return np.asarray(np.where(known, centre, np.nan))
