"""What following recordings gives, and its document."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from scaling_service.capabilities.motion.kinematic_error import KinematicError
from scaling_service.capabilities.motion.poses import SegmentPoses
from scaling_service.capabilities.motion.uncertainty import CoordinateSd
from scaling_service.documents.results import Provenance
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


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class KinematicErrorDocument(_Part):
    """Distances between measured and model markers over one trial, mm."""

    mean: float = Field(description="Over frames and markers.")
    rms: float
    max: float
    per_marker: dict[str, float] = Field(description="Marker to mean distance.")


class TrackedTrialDocument(_Part):
    """How a model follows one trial."""

    kinematic_error_mm: KinematicErrorDocument
    not_determined: list[str] = Field(
        description="Coordinates that the markers determine in no frame: they stand at their default."
    )
    frames_not_determined: dict[str, int] = Field(
        description="Further coordinates to the number of frames that do not determine them: NaN there."
    )
    frames_at_range_end: dict[str, int] = Field(
        description="Coordinates to the number of frames in which they stand at the end of the model's "
        "range. It decides there, so their standard deviation is NaN."
    )
    marker_noise_mm: dict[str, float] = Field(
        description="Standard deviation of one coordinate of each marker about the model, from this trial's "
        "residuals; the standard deviations of the coordinates come from it."
    )
    frames: int


class MotionDocument(Provenance):
    """``ik.json``."""

    subject: str = Field(default="", description="Empty where recordings were given without a subject.")
    model: str = Field(description="The model used: a built-in name or a file.")
    locked: list[str] = Field(description="Coordinates that the model locks; their standard deviation is 0.")
    axes: str = Field(description="Which laboratory axes were taken for up and forward.")
    trials: dict[str, TrackedTrialDocument]
    warnings: list[str]
    files: list[str] = Field(description="What was written beside this document.")
    wall_s: float


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
