"""How the landmarks of people's pelves lie to one another: what tells the right pose from its rivals.

Lengths are taken in units of the sockets' distance, so that children count as adults do; the deviations hold
what that distance itself varies by (174 (10) mm between hip centres, Puchaud 2019).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import chdtri

from scaling_service.core.arrays import Array
from scaling_service.model.anatomy.frames import build_pelvis_frame
from scaling_service.model.anatomy.hip_centre import predict_hip_centres
from scaling_service.model.people import read_people

_APART_MM, _APART_SD = 174.0, 10.0  # between hip centres of adults, Puchaud 2019

_LENGTHS_MM = {
    # Augustine et al. 2018, Clin Anat 32:132: 135 adults, both sexes alike
    "width": (238.0, 20.1),
    "height": (92.7, 10.5),
    # Four published models and palpation (as in ``pelvis.py``)
    "rear": (87.0, 10.4),
    "depth": (150.0, 14.0),
}
"""Mean and standard deviation between both ASIS, from their middle to the pubis, between both PSIS, and
between the middles of both."""

_COVERED = (0.33, 0.05)
"""Share of its sphere that a socket covers: 0.31-0.36 on two persons; twice their range as the deviation."""

_DOF = len(_LENGTHS_MM) + 3
RARE = 1e-4  # chosen: a pelvis rarer than one of ten thousand is told
MOST_UNLIKE = float(chdtri(_DOF, RARE))
"""Of :func:`measure_unlikeness`, reached by one pelvis of ten thousand."""


def measure_unlikeness(points: Mapping[str, Array]) -> float:
    """Squared Mahalanobis distance of a pelvis's landmarks from people's, of seven numbers.

    ``points``: ``acetabulum``, ``asis``, ``psis`` and ``pubic_tubercle`` of both sides (``_r``, ``_l``),
    (3,), m, in any frame. Returns infinity where the spines span no frame. The seven are the four lengths
    above and where the hips lie in the frame of the spines, mean of both sides, beside Harrington 2007
    (``hip.sd_mm`` in ``people.yaml``).
    """
    middle = {name: 0.5 * (points[f"{name}_r"] + points[f"{name}_l"]) for name in ("asis", "psis")}
    pubis = 0.5 * (points["pubic_tubercle_r"] + points["pubic_tubercle_l"])
    apart = _measure(points["acetabulum_r"] - points["acetabulum_l"])
    lengths = {
        "width": _measure(points["asis_r"] - points["asis_l"]),
        "height": _measure(middle["asis"] - pubis),
        "rear": _measure(points["psis_r"] - points["psis_l"]),
        "depth": _measure(middle["asis"] - middle["psis"]),
    }
    offsets = _measure_hips(points)
    if offsets is None:
        return float("inf")
    total = float(((offsets / np.array(read_people().hip_sd)) ** 2).sum())
    for name, length in lengths.items():
        mean, sd = _LENGTHS_MM[name]
        ratio = mean / _APART_MM
        spread = ratio * np.hypot(sd / mean, _APART_SD / _APART_MM)
        total += float(((length / apart - ratio) / spread) ** 2)
    return total


def measure_sockets(*covered: float) -> float:
    """The same of the covered shares of hollow spheres as of sockets."""
    mean, sd = _COVERED
    return float(sum(((share - mean) / sd) ** 2 for share in covered))


def _measure_hips(points: Mapping[str, Array]) -> Array | None:
    """The sockets less where Harrington 2007 puts the hips, mean of both sides as of a right one, (3,), m."""
    spines = [points[name] for name in ("asis_r", "asis_l", "psis_r", "psis_l")]
    found = predict_hip_centres(*spines)
    if not np.isfinite(found.right).all():
        return None
    axes = build_pelvis_frame(*(spine[None] for spine in spines))
    right, left = (
        axes.rotation[0].T @ (points[f"acetabulum_{side}"] - axes.origin[0]) - predicted[0]
        for side, predicted in (("r", found.right), ("l", found.left))
    )
    return np.asarray(0.5 * (right + left * [1.0, 1.0, -1.0]))


def _measure(vector: Array) -> float:
    return float(np.linalg.norm(vector))
