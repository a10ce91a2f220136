"""From a recording as read to one that can be computed with: axes and unit, smoothing, gaps."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from scaling_service.core.errors import InputError
from scaling_service.model.trial import Repair, Trial, repair_each
from scaling_service.numerics.signals.filters import butterworth, moving_average
from scaling_service.recording import gaps, orientation
from scaling_service.recording.settings import ProcessingSettings


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
        turned = smooth_by_average(turned)
    elif chosen.smoothing == "butterworth":
        turned = smooth_by_cutoff(turned, chosen.cutoff_hz)
    return gaps.fill(turned, clusters if chosen.solidify else {}, longest_spline_s=chosen.longest_spline_s)


WINDOW = 5  # frames; Puchaud et al. 2019, sec. 2.1
PASSES = 2  # in opposite directions; Puchaud et al. 2019, sec. 2.1

ORDER = 4
"""Effective order, 2 forwards and 2 backwards (chosen: the custom of gait laboratories, Winter 2009)."""


def smooth_by_average(trial: Trial) -> Trial:
    """Central moving average in several passes; missing where it was missing. One Repair, ``smoothing``."""
    detail = f"central moving average of {WINDOW} frames in {PASSES} passes"
    return trial.with_markers(
        moving_average(trial.markers, window=WINDOW, passes=PASSES),
        Repair("smoothing", trial.name, detail, trial.n_frames),
    )


def smooth_by_cutoff(trial: Trial, cutoff_hz: float) -> Trial:
    """Zero-phase low-pass Butterworth filter with half power at the cutoff.

    Missing where it was missing. One Repair,
    ``smoothing``, and one ``not_smoothed`` for each marker with runs too short to filter, which are left as
    measured. Raises InputError if the cutoff is not between 0 and half the frame rate.
    """
    if not 0 < cutoff_hz < 0.5 * trial.rate_hz:
        raise InputError(
            f"a cutoff of {cutoff_hz:g} Hz does not suit {trial.rate_hz:g} frames per second",
            file=trial.name,
            field="cutoff_hz",
            remedy=f"Choose one between 0 and {0.5 * trial.rate_hz:g} Hz",
        )
    result = butterworth(trial.markers, rate_hz=trial.rate_hz, cutoff_hz=cutoff_hz, order=ORDER)
    detail = f"zero-phase Butterworth, order {ORDER}, half power at {cutoff_hz:g} Hz"
    brief = "seen too briefly between gaps to be filtered; left as measured"
    short = repair_each(np.any(result.unfiltered, axis=-1), trial.labels, "not_smoothed", brief)
    return trial.with_markers(result.values, Repair("smoothing", trial.name, detail, trial.n_frames), *short)
