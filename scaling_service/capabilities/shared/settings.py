"""What can be chosen for every run: how recordings are processed and models calibrated."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from scaling_service.capabilities.shared.names import HIP_REGRESSION_NAMES
from scaling_service.core import options
from scaling_service.recording.settings import ProcessingSettings

_BEYOND = "Beyond the paper"

Bound = Annotated[float, Field(ge=0.0, le=options.LARGEST)]


class CalibrationSettings(options.Options):
    """Settings of the optimisation-based methods (Puchaud 2019, section 2.2.4), the paper's as defaults.

    Examples
    --------
    >>> import scaling_service as ss
    >>> ss.CalibrationSettings(n_frames=60, hip_regression="hara2016").n_frames
    60
    """

    strategy: Annotated[Literal["joint", "alternating"], options.Flag()] = Field(
        default="joint",
        description="Motion and parameters together (joint), or in turn as in Puchaud 2019 (alternating).",
    )
    n_frames: Annotated[int, options.Flag(name="--frames", metavar="N")] = Field(
        default=100,
        ge=1,
        le=options.LARGEST,
        description="Frames used to fit, equally spaced over the calibration trials.",
    )
    length_bound: Bound = Field(
        default=0.20, description="Scale factors stay within 1 ± this of their start."
    )
    axis_bound_x_deg: Bound = Field(default=20.0, description="Bound on the turn of a knee axis about x.")
    axis_bound_y_deg: Bound = Field(default=30.0, description="Bound on the turn of a knee axis about y.")
    marker_bound_m: Bound = Field(
        default=0.05, description="Bound on each shift of a marker's local coordinate."
    )
    length_sd: Bound = Field(
        default=0.05,
        description="Prior standard deviation of a size where the first guess has none of its own: what "
        "remains of a segment's length once stature is known (Puchaud 2019, table 2).",
    )
    axis_sd_deg: Bound = Field(
        default=5.0,
        description="Prior standard deviation of a knee axis' turns (Puchaud 2019: axes moved by less).",
    )
    marker_sd_m: Bound = Field(
        default=0.010,
        description="Prior standard deviation of a marker's coordinate (Puchaud 2019: shifts of MB_am were "
        "12.3 (9.8) mm, 9 mm along each axis).",
    )
    prior: bool = Field(
        default=True,
        description="Whether the prior around the first guess is used; the paper's loop has none, but stops "
        "early.",
    )
    loop_tolerance: Bound = Field(
        default=0.01,
        description="The alternating loop stops when the cumulative kinematic error changes by less than "
        "this share,",
    )
    max_loops: int = Field(
        default=200, ge=1, le=options.LARGEST, description="and at the latest after so many loops."
    )
    robust_m: Bound | None = Field(
        default=None,
        description="Scale of a Huber loss on marker distances; plain least squares if not given.",
    )
    sizes: Annotated[Literal["weighted", "measured"], options.Flag(panel=_BEYOND)] = Field(
        default="weighted",
        description="Weigh each segment's distances and what persons of this stature and mass are like by "
        "their errors, or take the mean of its distances alone, as the paper does.",
    )
    hip_regression: Annotated[str, options.Flag(metavar="NAME", panel=_BEYOND)] = Field(
        default="harrington2007",
        description=f"Which regression: harrington2007, {', '.join(HIP_REGRESSION_NAMES)}.",
    )
    hip_centre: Annotated[Literal["regression", "functional"], options.Flag(panel=_BEYOND)] = Field(
        default="regression",
        description="From the pelvis markers by regression, or where pelvis and thigh turn against each "
        "other in the calibration trials (three markers on each; SCoRE).",
    )
    knee_axis: Annotated[Literal["epicondyles", "functional"], options.Flag(panel=_BEYOND)] = Field(
        default="epicondyles",
        description="Along the epicondyles, or where thigh and shank turn against each other in the "
        "calibration trials (three markers on each; SARA).",
    )
    scaling: Annotated[Literal["uniform", "per-axis"], options.Flag(panel=_BEYOND)] = Field(
        default="uniform",
        description="One factor for each segment, or factors along its axes where markers determine them.",
    )
    knee: Annotated[Literal["hinge", "universal", "spherical"], options.Flag(panel=_BEYOND)] = Field(
        default="hinge",
        description="Flexion alone, with inward rotation (universal), or with varus and valgus as well "
        "(spherical).",
    )

    @property
    def uses_movements(self) -> bool:
        """Whether linear scaling looks at functional movements."""
        return self.hip_centre == "functional" or self.knee_axis == "functional"


PAPER = CalibrationSettings()
"""The settings of Puchaud 2019, with motion and parameters solved together."""


class Settings(options.Options):
    """How recordings are processed and models fitted.

    Examples
    --------
    >>> import scaling_service as ss
    >>> settings = ss.Settings(calibration=ss.CalibrationSettings(knee="spherical"), up="+z")
    >>> settings.calibration.knee, settings.up
    ('spherical', '+z')
    """

    calibration: CalibrationSettings = Field(
        default=CalibrationSettings(), description="How models are fitted."
    )
    processing: Annotated[
        ProcessingSettings,
        options.Flag(
            name="--smooth-hz",
            metavar="HZ",
            kind=float | None,
            least=0.0,
            read=ProcessingSettings.smoothed,
            help="Cutoff of the low pass for markers, 10 where the frame rate allows it; 0: none.",
        ),
    ] = Field(default=ProcessingSettings(), description="What is done to recordings.")
    up: Annotated[str | None, options.Flag(metavar="AXIS")] = Field(
        default=None,
        description="Laboratory axis that points up, such as +z; found unless given.",
    )
    forward: Annotated[str | None, options.Flag(metavar="AXIS")] = Field(
        default=None,
        description="Laboratory axis to turn to x, such as -x; unless given, the heading is kept, but where "
        "results are told along and across the way.",
    )
    seed: Annotated[int, options.Flag(metavar="N")] = Field(
        default=0, ge=0, le=options.LARGEST, description="Seed of everything random."
    )

    def resolved(self) -> dict[str, Any]:
        """All settings with their defaults, as plain values for a document; the seed stands apart."""
        return self.model_dump(exclude={"seed"})


UNSMOOTHED = Settings(processing=ProcessingSettings(smoothing="none"))
"""Markers are not smoothed: motion and forces then pass one filter, and the same one."""
