"""``ik.json``: how a model follows recordings."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from scaling_service.documents.base import Known, Part, Rounded
from scaling_service.documents.results import Provenance


class KinematicErrorDocument(Part):
    """Distances between measured and model markers over one trial, mm; null where it has no marker."""

    mean: Known = Field(description="Over frames and markers.")
    rms: Known
    max: Known
    per_marker: dict[str, Rounded] = Field(description="Marker to mean distance.")


class CoordinateSummary(Part):
    """A coordinate over one trial, in its unit."""

    mean: Rounded
    mean_sd: Known = Field(
        description="Standard deviation of the mean, hardly less than a frame's: a misplaced marker is off "
        "in all. Null where the model's own deviations are not known."
    )
    range: Rounded = Field(description="The largest less the least value, what skin adds to it included.")


class TrackedTrialDocument(Part):
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
    marker_noise_mm: dict[str, Rounded] = Field(
        description="Standard deviation of one coordinate of each marker about the model, from this trial's "
        "residuals; the standard deviations of the coordinates come from it and from the motion of skin."
    )
    rotation_error_deg: dict[str, Rounded] = Field(
        default={},
        description="Measured rotation to the RMS angle between it and the model's, mounting included.",
    )
    frames: int
    summary: dict[str, CoordinateSummary] = Field(
        default={}, description="Of coordinates that are determined in any frame; locked ones apart."
    )


class MotionDocument(Provenance):
    """``ik.json``."""

    subject: str = Field(default="", description="Empty where recordings were given without a subject.")
    model: str = Field(description="The model used: a built-in name or a file.")
    locked: list[str] = Field(description="Coordinates that the model locks; their standard deviation is 0.")
    units: dict[str, Literal["deg", "m"]] = Field(
        default={}, description="Coordinate to the unit of its column in `_ik.mot` and `_ik_sd.mot`."
    )
    ranges: dict[str, tuple[float, float]] = Field(
        default={}, description="Coordinates that the model keeps within a range to its ends, in their unit."
    )
    axes: str = Field(description="Which laboratory axes were taken for up and forward.")
    trials: dict[str, TrackedTrialDocument]
    warnings: list[str]
    files: list[str] = Field(description="What was written beside this document.")
    wall_s: float
