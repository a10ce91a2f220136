"""What following recordings gives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.motion.document import KinematicErrorDocument, TrackedTrialDocument
from scaling_service.capabilities.motion.poses import SegmentPoses
from scaling_service.capabilities.motion.uncertainty import CoordinateSd
from scaling_service.capabilities.scaling.comparison.kinematic_error import KinematicError
from scaling_service.model.body import BodyModel
from scaling_service.model.results import Motion

_MM = 1e3


@dataclass(frozen=True, slots=True, eq=False)
class TrackedTrial:
    """One trial as a model follows it.

    Parameters
    ----------
    motion : Motion
    uncertainty : CoordinateSd
    error : KinematicError
    poses : SegmentPoses, optional
        Where they were asked for.
    """

    motion: Motion
    uncertainty: CoordinateSd
    error: KinematicError
    poses: SegmentPoses | None = None


@dataclass(frozen=True, slots=True, eq=False)
class MotionResult:
    """A model, and trial by trial how it follows them."""

    model: BodyModel
    trials: Mapping[str, TrackedTrial]


def trial_document(tracked: TrackedTrial, model: BodyModel) -> TrackedTrialDocument:
    """One trial's part of ``ik.json``."""
    motion, spread = tracked.motion, tracked.uncertainty
    free = [not c.locked for c in model.coordinates]
    lost = [n for n, is_free in zip(motion.coordinates, free, strict=True) if is_free]
    lost = [name for name in lost if name not in motion.estimated]
    return TrackedTrialDocument(
        kinematic_error_mm=KinematicErrorDocument(
            mean=_mm(tracked.error.mean),
            rms=_mm(tracked.error.rms),
            max=_mm(tracked.error.max),
            per_marker={name: _mm(value) for name, value in tracked.error.per_marker.items()},
        ),
        not_determined=lost,
        frames_not_determined=_counts(motion.coordinates, np.isnan(motion.q).sum(axis=0).tolist()),
        frames_at_range_end=_counts(motion.coordinates, spread.at_range_end.sum(axis=0).tolist()),
        marker_noise_mm={
            name: _mm(sd)
            for name, sd in zip(motion.markers, spread.noise.tolist(), strict=True)
            if np.isfinite(sd)
        },
        frames=len(motion.times),
    )


def _counts(names: Sequence[str], counts: Sequence[int]) -> dict[str, int]:
    return {name: count for name, count in zip(names, counts, strict=True) if count}


def _mm(metres: float) -> float:
    return round(_MM * metres, 4)
