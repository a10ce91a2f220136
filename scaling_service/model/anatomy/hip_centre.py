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

import numpy as np
from numpy.typing import ArrayLike

from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError
from scaling_service.model.anatomy.frames import build_pelvis_frame

_Row = tuple[float, float, float, float]

_LINEAR: dict[str, tuple[_Row, _Row, _Row]] = {
    # Harrington 2007, J Biomech 40:595, several predictors; leave-one-out error 5.2, 3.6, 3.2 mm
    "harrington2007_multi": (
        (0.0, -0.24, 0.0, -0.0099),
        (-0.16, 0.0, -0.04, -0.0071),
        (0.16, 0.28, 0.0, 0.0079),
    ),
    # Harrington 2007, one predictor per component
    "harrington2007_single": (
        (0.0, -0.24, 0.0, -0.0099),
        (-0.30, 0.0, 0.0, -0.0109),
        (0.33, 0.0, 0.0, 0.0073),
    ),
    # Bell 1990, J Biomech 23:617, adults; mean error 19 mm
    "bell1990": ((-0.19, 0.0, 0.0, 0.0), (-0.30, 0.0, 0.0, 0.0), (0.36, 0.0, 0.0, 0.0)),
    # Hara 2016, Sci Rep 6:37707, leg length only; leave-one-out error 5.2, 4.4, 3.8 mm
    "hara2016": ((0.0, 0.0, -0.063, 0.011), (0.0, 0.0, -0.078, -0.009), (0.0, 0.0, 0.086, 0.008)),
}
"""The right hip's x, y, z: coefficients of pelvic width, depth, leg length (no unit), and a constant (m)."""

_DAVIS_ANGLES = {"davis1991": (radians(28.4), radians(18.0)), "plug_in_gait": (0.5, 0.314)}
"""Turns to the middle and downward, rad; those of Vicon Plug-in Gait are rounded."""

HIP_REGRESSIONS = (*_LINEAR, *_DAVIS_ANGLES)
"""Names of the published predictions."""

_MIN_OUT_OF_LINE = 1e-3  # m; chosen: a plane marker nearer to the line than this tells no plane


def _predict_davis(
    angles: tuple[float, float], width: Array, leg: Array, mean_leg: Array, marker_radius: float
) -> list[Array]:
    """The hip centre of the conventional gait model, from leg length, pelvis width and marker radius.

    Davis et al. 1991 (Hum Mov Sci 10:575) found it at C = 0.115 L - 15.3 mm from the ASIS, at two angles, the
    ASIS standing 0.1288 L - 48.56 mm before the hip.
    """
    theta, beta = angles
    reach = 0.115 * mean_leg - 0.0153
    ahead = 0.1288 * leg - 0.04856 + marker_radius
    x = reach * cos(theta) * sin(beta) - ahead * cos(beta)
    y = -reach * cos(theta) * cos(beta) - ahead * sin(beta)
    return [np.asarray(x), np.asarray(y), np.asarray(width / 2.0 - reach * sin(theta))]


@dataclass(frozen=True, slots=True, eq=False)
class HipCentres:
    """Both hip centres, each (n_frames, 3), m: in the pelvis frame, and in ground."""

    right: Array
    left: Array
    right_ground: Array
    left_ground: Array


def predict_hip_centres(
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
    frame = build_pelvis_frame(*markers)
    legs = [np.asarray(leg, dtype=float) for leg in (leg_length_r, leg_length_l) if leg is not None]
    name = _choose_regression(regression, bool(legs))
    mean = np.asarray(sum(legs) / len(legs)) if legs else np.array(np.nan)
    local = []
    for leg, side in ((leg_length_r, 1.0), (leg_length_l, -1.0)):
        own = np.asarray(leg, dtype=float) if leg is not None else (legs[0] if legs else mean)
        if name in _LINEAR:
            rows = _LINEAR[name]
            x, y, z = [np.asarray(w * apart + d * depth + c + (k * own if k else 0.0)) for w, d, k, c in rows]
        else:
            x, y, z = _predict_davis(_DAVIS_ANGLES[name], apart, own, mean, marker_radius)
        centre = np.column_stack(np.broadcast_arrays(x, y, side * z, depth)[:3])
        local.append(np.where(np.isfinite(frame.origin), centre, np.nan))
    right, left = local
    return HipCentres(right, left, frame.to_ground(right), frame.to_ground(left))


def _choose_regression(name: str, leg_length_known: bool) -> str:
    if name == "harrington2007":
        name = "harrington2007_single"
    if name not in HIP_REGRESSIONS:
        raise InputError(
            f"there is no hip centre regression '{name}'",
            field="hip_regression",
            remedy=f"Use harrington2007 or one of {', '.join(HIP_REGRESSIONS)}",
        )
    needs_leg_length = name in _DAVIS_ANGLES or any(row[2] for row in _LINEAR[name])
    if needs_leg_length and not leg_length_known:
        raise InputError(
            f"the hip centre regression '{name}' needs the leg length",
            field="hip_regression",
            remedy="Mark the medial malleolus in the static trial, or use harrington2007_single",
        )
    return name


def solve_chord_centre(
    proximal: ArrayLike, lateral: ArrayLike, plane: ArrayLike, distance: ArrayLike
) -> Array:
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
    >>> solve_chord_centre([[0, 0.4, 0]], [[0, 0, 0.05]], [[0, 0.2, 0.09]], 0.05).round(6) + 0.0
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
