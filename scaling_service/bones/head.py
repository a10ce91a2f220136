"""The head of a femur: the best covered ball that a neck sets off from the shaft."""

from __future__ import annotations

import numpy as np

from scaling_service.bones.spheres import SphereOnBone, spheres
from scaling_service.bones.surface import Surface

HEAD_RADII_M = (0.015, 0.032)
"""Heads of adults are 42.5 (2.2) to 48 (2.5) mm wide; wider by 4 SD, and down to a child's."""

HEAD_COVERED = 0.42
"""Least covered share of the head: heads reach 0.49-0.85, the other end 0.22-0.38 (field experience)."""

HEAD_RMS = 0.08
"""Largest rms as a share of the radius: chosen, nearly four times that of rough MRI (0.022)."""

SET_OFF_M = 0.008
"""Least distance between head and shaft: chosen, whole femurs have 25-50 mm, a head cut off with its
trochanter 11."""

STRADDLING = 0.45
"""Least ratio of two condyles' distances from the line of the shaft: chosen below the 0.6-0.8 of four femurs;
a trochanter sits on the shaft, a head 24-38 mm beside it."""


def find_head(surface: Surface, refused: dict[str, str]) -> SphereOnBone | None:
    """The best covered sphere near an end of the bone, or None and the reason."""
    ends = surface.smooth[:, 0].min(), surface.smooth[:, 0].max()
    found = [
        ball
        for ball in spheres(surface, HEAD_RADII_M)
        if min(abs(ball.centre[0] - ends[0]), abs(ball.centre[0] - ends[1])) < 2.5 * ball.radius
    ]
    if not found:
        refused["hip_centre"] = "no part of either end is a ball of a femoral head's size"
        return None
    best = found[0]
    if best.covered < HEAD_COVERED:
        refused["hip_centre"] = (
            f"the best ball covers {best.covered:.2f} of its sphere; a head covers {HEAD_COVERED} or more"
        )
        return None
    if best.rms > HEAD_RMS * best.radius:
        refused["hip_centre"] = f"the head is off its sphere by {1e3 * best.rms:.1f} mm rms"
        return None
    if any(_twins(surface, best, other) for other in found[1:]):
        refused["hip_centre"] = "there are two balls alike side by side, as condyles"
        return None
    offset = _set_off(surface, best)
    if offset < SET_OFF_M:
        refused["hip_centre"] = (
            f"the ball stands {1e3 * offset:.0f} mm beside the shaft; a neck sets a head off by 30-50 mm"
        )
        return None
    return best


def _twins(surface: Surface, a: SphereOnBone, b: SphereOnBone) -> bool:
    """Whether two balls are alike, as far apart as condyles, and stand on both sides of the shaft.

    A round greater trochanter can be as well covered as a head, but it sits on the shaft.
    """
    apart = float(np.linalg.norm(a.centre - b.centre))
    offsets = _set_off(surface, a), _set_off(surface, b)
    return (
        min(a.covered, b.covered) > 0.75 * max(a.covered, b.covered)
        and max(a.radius, b.radius) < 1.25 * min(a.radius, b.radius)
        and 0.03 < apart < 0.07
        and min(offsets) > STRADDLING * max(offsets)
    )


def _set_off(surface: Surface, head: SphereOnBone) -> float:
    """Distance of the head's centre from the line of the shaft, m."""
    far = np.abs(surface.smooth[:, 0] - head.centre[0])
    shaft = (far > 0.35 * far.max()) & (far < 0.75 * far.max())
    if int(shaft.sum()) < 20:
        return 0.0
    middle = surface.areas[shaft] @ surface.smooth[shaft] / surface.areas[shaft].sum()
    return float(np.linalg.norm((head.centre - middle)[1:]))
