"""What is done to a recording."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field

from scaling_service.core import options

DYNAMICS_CUTOFF_HZ = 5.0
"""Of the filter that motion and forces pass before their rates are taken: Muller et al. 2017, sec. 2.1."""

LONGEST_SPLINE_S = 0.15
"""Puchaud et al. 2019, sec. 2.1: spline up to 15 frames at 100 Hz, solidification beyond."""


SMOOTHING_HZ = 10.0
"""Of the low pass for markers. Chosen between the 6 Hz of walking (Winter 2009, sec. 3.4.3), whose markers
hold nothing above, and the 12 to 15 Hz of running and landing (Sinclair et al. 2013, Uhlrich et al. 2023):
what moves is kept."""

LEAST_RATE = 4.0
"""Frame rate over cutoff from which markers are smoothed by themselves: below it, less than half of a
camera's white noise lies beyond the cutoff, and the filter costs more of the movement than it takes off."""


class ProcessingSettings(options.Options):
    """What is done to a recording; gaps are filled as Puchaud et al. 2019, sec. 2.1, fill them.

    Examples
    --------
    >>> import scaling_service as ss
    >>> ss.ProcessingSettings.smoothed(8.0).smoothing
    'butterworth'
    """

    smoothing: Literal["automatic", "butterworth", "none"] = Field(
        default="automatic",
        description="A zero-phase Butterworth low pass: where the frame rate is at least four times the "
        "cutoff (automatic), always, or never.",
    )
    cutoff_hz: float = Field(
        default=SMOOTHING_HZ,
        ge=0.0,
        le=options.LARGEST,
        description="Where the low pass has half power (chosen: between walking and running).",
    )
    longest_spline_s: float = Field(
        default=LONGEST_SPLINE_S,
        ge=0.0,
        le=options.LARGEST,
        description="Gaps up to this long are interpolated by a spline.",
    )
    solidify: bool = Field(
        default=True, description="Whether longer gaps are filled from the other markers of the segment."
    )

    @classmethod
    def smoothed(cls, cutoff_hz: float | None) -> Self:
        """By a Butterworth filter of this cutoff, at 0 not at all; where none is given as the rate allows."""
        if cutoff_hz is None:
            return cls()
        return cls(smoothing="butterworth", cutoff_hz=cutoff_hz) if cutoff_hz else cls(smoothing="none")
