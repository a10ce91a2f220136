"""From a recording as read to one that can be computed with: axes and unit, smoothing, gaps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from scaling_service.model.trial import Trial
from scaling_service.recording import gaps, orientation, smoothing


@dataclass(frozen=True, slots=True)
class ProcessingSettings:
    """What is done to a recording; the defaults are those of Puchaud et al. 2019, sec. 2.1.

    Parameters
    ----------
    smoothing : 'moving_average', 'butterworth' or 'none'
    cutoff_hz : float
        Of the Butterworth filter (chosen: 6 Hz, the custom for walking, Winter 2009, sec. 3.4.3).
    longest_spline_s : float
        Gaps up to this long are interpolated by a spline.
    solidify : bool
        Whether longer gaps are filled from the other markers of the segment.
    """

    smoothing: Literal["moving_average", "butterworth", "none"] = "moving_average"
    cutoff_hz: float = 6.0
    longest_spline_s: float = gaps.LONGEST_SPLINE_S
    solidify: bool = True


def process(
    trial: Trial,
    axes: orientation.Orientation,
    clusters: Mapping[str, tuple[str, ...]],
    settings: ProcessingSettings | None = None,
) -> Trial:
    """Turn, scale, smooth and fill a recording.

    ``trial``: as read. ``axes``: the session's; see ``decide``. ``clusters``: segment to the labels that
    sit on it. Returns X forward, Y up, Z right, m; NaN only where nothing could be told. Everything done is
    in ``repairs``. Raises TrialUnusable if no marker is seen at all, or the unit cannot be told. Raises
    InputError if the cutoff does not suit the frame rate.
    """
    chosen = settings or ProcessingSettings()
    turned = orientation.apply(axes, trial)
    if chosen.smoothing == "moving_average":
        turned = smoothing.smooth_by_average(turned)
    elif chosen.smoothing == "butterworth":
        turned = smoothing.smooth_by_cutoff(turned, chosen.cutoff_hz)
    return gaps.fill(turned, clusters if chosen.solidify else {}, longest_spline_s=chosen.longest_spline_s)
