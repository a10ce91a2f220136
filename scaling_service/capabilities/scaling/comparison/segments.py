"""What a calibration made of the body: lengths, joint centres, knee axes, marker shifts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from scaling_service.model.anatomy.lengths import joint_centres, segment_lengths
from scaling_service.model.body import Vector
from scaling_service.model.results import Calibration


@dataclass(frozen=True, slots=True)
class Geometry:
    """The geometry of a scaled model, named.

    Parameters
    ----------
    lengths : mapping
        ``inter_hip``, ``femur_r``, ``shank_r`` … to m, at a straight pose.
    joint_centres : mapping
        ``hip_r`` … to (segment, position in its frame, m).
    knee_axes : mapping
        ``r`` or ``l`` to the turns of the knee axis about x and y of the thigh, rad.
    marker_shifts : mapping
        Marker to how far a fit moved it on its segment, m.
    """

    lengths: Mapping[str, float]
    joint_centres: Mapping[str, tuple[str, Vector]]
    knee_axes: Mapping[str, tuple[float, float]]
    marker_shifts: Mapping[str, float]


def geometry(calibration: Calibration) -> Geometry:
    """Lengths, joint centres, knee axes and marker shifts of a calibration's model."""
    return Geometry(
        segment_lengths(calibration.model),
        joint_centres(calibration.model),
        {_side(joint): tilt for joint, tilt in calibration.axis_tilts.items()},
        marker_shifts(calibration),
    )


def marker_shifts(calibration: Calibration) -> dict[str, float]:
    """How far a fit moved each marker on its segment, beyond following the segment's size, m.

    The length of the variation of its local coordinates (Puchaud 2019, section 3.1), zero where the
    method fits no marker.
    """
    shifts = {marker.name: 0.0 for marker in calibration.model.markers if marker.weight > 0.0}
    for parameter in calibration.parameters:
        if parameter.group == "marker":
            shifts[parameter.target] = math.hypot(shifts[parameter.target], parameter.value)
    return shifts


def _side(joint: str) -> str:
    """``r`` for ``knee_r`` or ``walker_knee_r``; the joint's own name where it says no side."""
    tail = joint.rpartition("_")[2].lower()
    return tail if tail in ("r", "l") else joint
