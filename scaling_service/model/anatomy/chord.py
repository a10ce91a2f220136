"""The chord construction of the conventional gait model.

The conventional marker set has only lateral markers at knee and ankle. A joint's centre is taken to lie in
the plane of the proximal joint's centre, the lateral marker and a marker on the segment's side (often on a
wand), where the lines to the proximal centre and to the lateral marker meet at a right angle (Kadaba et al.
1990, J Orthop Res 8:383; Davis et al. 1991, Hum Mov Sci 10:575). The lateral marker is half of the joint's
width and the marker's own radius away from it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_MIN_OUT_OF_LINE = (
    1e-3  # m; chosen: a plane marker nearer to the line than markers are measured tells no plane
)


def chord_centre(proximal: ArrayLike, lateral: ArrayLike, plane: ArrayLike, distance: ArrayLike) -> Array:
    """The joint centre at a right angle between the proximal centre and the lateral marker.

    It lies in the plane of the three points, and the line from the proximal centre to the lateral marker
    separates it from the plane marker.

    Parameters
    ----------
    proximal, lateral, plane : (n_frames, 3), m
        Proximal joint centre (hip for the knee, knee for the ankle), lateral marker of the joint, and the
        marker on the segment between them (thigh or shank wand).
    distance : float or (n_frames,), m
        From the centre to the lateral marker: half the joint's width and the marker's radius.

    Returns
    -------
    (n_frames, 3), m
        NaN where a point is missing, the proximal centre is nearer to the lateral marker than ``distance``,
        or the plane marker is within a millimetre of the line.

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
