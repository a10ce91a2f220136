"""What is done to a recording."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field

from scaling_service.core.options import LARGEST, Options

DYNAMICS_CUTOFF_HZ = 5.0
"""Of the filter that motion and forces pass before their rates are taken: Muller et al. 2017, sec. 2.1."""

LONGEST_SPLINE_S = 0.15
"""Puchaud et al. 2019, sec. 2.1: spline up to 15 frames at 100 Hz, solidification beyond."""


class ProcessingSettings(Options):
    """What is done to a recording; the defaults are those of Puchaud et al. 2019, sec. 2.1.

    Examples
    --------
    >>> import scaling_service as ss
    >>> ss.ProcessingSettings.smoothed(8.0).smoothing
    'butterworth'
    """

    smoothing: Literal["moving_average", "butterworth", "none"] = Field(
        default="moving_average", description="A moving average (the paper's), a Butterworth filter, or none."
    )
    cutoff_hz: float = Field(
        default=6.0,
        ge=0.0,
        le=LARGEST,
        description="Of the Butterworth filter (chosen: the custom for walking, Winter 2009, sec. 3.4.3).",
    )
    longest_spline_s: float = Field(
        default=LONGEST_SPLINE_S,
        ge=0.0,
        le=LARGEST,
        description="Gaps up to this long are interpolated by a spline.",
    )
    solidify: bool = Field(
        default=True, description="Whether longer gaps are filled from the other markers of the segment."
    )

    @classmethod
    def smoothed(cls, cutoff_hz: float | None) -> Self:
        """As scaling does unless a cutoff is given: by a Butterworth filter then, at 0 not at all."""
        if cutoff_hz is None:
            return cls()
        return cls(smoothing="butterworth", cutoff_hz=cutoff_hz) if cutoff_hz else cls(smoothing="none")
