"""From a recording as read to one that can be computed with: axes and unit, smoothing, gaps."""

from __future__ import annotations

from collections.abc import Mapping

from scaling_service.model.trial import Trial
from scaling_service.recording import gaps, orientation, smoothing
from scaling_service.recording.settings import ProcessingSettings


def process(
    trial: Trial,
    axes: orientation.Orientation,
    clusters: Mapping[str, tuple[str, ...]],
    settings: ProcessingSettings | None = None,
) -> Trial:
    """Turn, scale, smooth and fill a recording.

    Parameters
    ----------
    trial : Trial
        As read.
    axes : Orientation
        The session's; see ``decide``.
    clusters : mapping
        Segment to the labels that sit on it.
    settings : ProcessingSettings, optional

    Returns
    -------
    Trial
        X forward, Y up, Z right, m; NaN only where nothing could be told. Everything done is in ``repairs``.

    Raises
    ------
    TrialUnusable
        If no marker is seen at all, or the unit cannot be told.
    InputError
        If the cutoff does not suit the frame rate.
    """
    chosen = settings or ProcessingSettings()
    turned = orientation.apply(axes, trial)
    if chosen.smoothing == "moving_average":
        turned = smoothing.smooth_by_average(turned)
    elif chosen.smoothing == "butterworth":
        turned = smoothing.smooth_by_cutoff(turned, chosen.cutoff_hz)
    return gaps.fill(turned, clusters if chosen.solidify else {}, longest_spline_s=chosen.longest_spline_s)
