"""One view of a comparison of methods; the files are those of the whole comparison, and the view's table."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scaling_service.capabilities.scaling.comparison_request import (
    JointAnglesRequest,
    KinematicErrorRequest,
    SegmentLengthsRequest,
)
from scaling_service.capabilities.scaling.comparison_views import (
    joint_angle_view,
    kinematic_error_view,
    segment_length_view,
    write_view,
)
from scaling_service.capabilities.scaling.work import compared
from scaling_service.core.progress import Progress


def kinematic_error(request: KinematicErrorRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write the comparison, ``kinematic_error.json`` and ``.csv``; raises as the comparison does."""
    _, document = compared(request, inputs, outputs, progress)
    return write_view(outputs, "kinematic_error", kinematic_error_view(document))


def segment_lengths(request: SegmentLengthsRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write the comparison, ``segment_lengths.json`` and ``.csv``; raises as the comparison does."""
    _, document = compared(request, inputs, outputs, progress)
    return write_view(outputs, "segment_lengths", segment_length_view(document))


def joint_angles(request: JointAnglesRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write the comparison, ``joint_angles.json`` and ``.csv``; raises as the comparison does."""
    results, document = compared(request, inputs, outputs, progress)
    return write_view(outputs, "joint_angles", joint_angle_view(results, document))
