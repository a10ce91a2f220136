"""Smoothing and interpolation of sampled signals that have gaps.

Every function works inside the runs of seen frames: a value never crosses a gap, and a NaN stays NaN
unless filling it is the function's purpose. Frames come first; each further column has its own gaps.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from scaling_service.core.arrays import Array
from scaling_service.core.arrays import Mask as Mask

MIN_CONTEXT = 2
"""Seen frames needed directly before and after a gap (chosen: the least that shows a slope on each side)."""


def find_runs(flags: Mask) -> NDArray[np.intp]:
    """Start (inclusive) and stop (exclusive) of every run of True.

    ``flags``: (n_frames,) bool.
    Returns (n_runs, 2) int.

    Examples
    --------
    >>> import numpy as np
    >>> find_runs(np.array([True, True, False, True])).tolist()
    [[0, 2], [3, 4]]
    """
    edges = np.flatnonzero(
        np.diff(np.concatenate(([False], np.asarray(flags, bool), [False])).astype(np.int8))
    )
    return edges.reshape(-1, 2)


@dataclass(frozen=True, slots=True, eq=False)
class Filtered:
    """A filtered signal, and where it had to be left as it was."""

    values: Array  # (n_frames, ...)
    # (n_frames, ...) bool: true on the seen samples of runs that are too short to filter; ``values`` holds
    # them unchanged
    unfiltered: Mask


def convert_cutoff(cutoff_hz: float, rate_hz: float, order: int) -> float:
    """Cutoff of the one-pass Butterworth filter that gives ``cutoff_hz`` after two passes.

    ``cutoff_hz``: where the two passes together shall have half power (-3 dB).
    ``order``: of the single pass.

    Two passes give half power where one has ``1/sqrt(2)`` power, that is ``w**(2 order) = sqrt(2) - 1`` with
    w relative to the single cutoff (Winter 2009, Biomechanics and Motor Control of Human Movement, sec.
    3.4.4.2). Exact for the digital filter because w is the ratio of the tangents that the bilinear transform
    makes of the frequencies.
    """
    warped = np.tan(np.pi * cutoff_hz / rate_hz) / (np.sqrt(2.0) - 1.0) ** (0.5 / order)
    return float(np.arctan(warped) * rate_hz / np.pi)


def filter_butterworth(signal: ArrayLike, *, rate_hz: float, cutoff_hz: float, order: int = 4) -> Filtered:
    """Zero-phase low-pass Butterworth filter, forwards and backwards.

    ``signal`` (n_frames, ...): NaN where not seen; each run between NaNs is filtered by itself.
    ``rate_hz``, ``cutoff_hz``: the cutoff is where the result has half power (-3 dB), not where one pass has
        it.
    ``order``: the effective, even order: half of it runs forwards and half backwards.
    Runs too short for the filter's start-up are returned unchanged and marked.
    Raises ValueError: if the order is not even and positive or the cutoff is not below half the rate.
    """
    if order < 2 or order % 2:
        raise ValueError("a filter run in both directions has an even order")
    if not 0 < cutoff_hz < 0.5 * rate_hz:
        raise ValueError(
            f"the cutoff {cutoff_hz} Hz must lie between 0 and half the rate, {0.5 * rate_hz} Hz"
        )
    x = np.array(signal, dtype=float)
    columns = x.reshape(x.shape[0], -1)
    unfiltered = np.zeros(columns.shape, bool)
    for (start, stop), members in _group_runs(np.isfinite(columns)).items():
        run = filter_run(columns[start:stop, members].T, rate_hz=rate_hz, cutoff_hz=cutoff_hz, order=order)
        if run is None:
            unfiltered[start:stop, members] = True
        else:
            columns[start:stop, members] = run.T
    return Filtered(columns.reshape(x.shape), unfiltered.reshape(x.shape))


def filter_run(run: Array, *, rate_hz: float, cutoff_hz: float, order: int) -> Array | None:
    """Signals (m, n_frames) without gaps through the filter of :func:`filter_butterworth`.

    None where they are too short for its start-up.
    """
    sections = design_butterworth(order // 2, cutoff_hz, rate_hz)
    # scipy's own start-up length; at least one period of the cutoff so that the reflection has settled.
    startup, length = 3 * (2 * len(sections) + 1), run.shape[1]
    if length <= startup:
        return None
    padding = min(length - 1, max(startup, int(np.ceil(rate_hz / cutoff_hz))))
    return np.asarray(scipy.signal.sosfiltfilt(sections, run, padlen=padding))


@lru_cache(maxsize=64)
def design_butterworth(order: int, cutoff_hz: float, rate_hz: float) -> Array:
    """Second-order sections (n_sections, 6) of one of the two passes, each of an order."""
    single = convert_cutoff(cutoff_hz, rate_hz, order)
    return np.asarray(scipy.signal.butter(order, single, fs=rate_hz, output="sos"))


def _group_runs(flags: Mask) -> dict[tuple[int, int], list[int]]:
    """Every run of True in any column, with the columns that have exactly this run."""
    found: defaultdict[tuple[int, int], list[int]] = defaultdict(list)
    whole = flags.all(axis=0) & (len(flags) > 0)
    if whole.any():
        found[(0, len(flags))] = np.flatnonzero(whole).tolist()
    for column in np.flatnonzero(~whole).tolist():
        for start, stop in find_runs(flags[:, column]).tolist():
            found[(start, stop)].append(column)
    return found


def fill_short_gaps(signal: ArrayLike, *, longest: int) -> tuple[Array, Mask]:
    """Interpolate gaps of at most ``longest`` frames by a cubic spline with continuous second derivative.

    ``signal`` (n_frames, n_columns, k): a column is seen where all its k components are.
    ``longest``: frames. Gaps at either end of the recording, and gaps without two seen frames directly on
        both sides, are left.
    Returns ``values``: (n_frames, n_columns, k).
    ``filled``: (n_frames, n_columns) bool.

    Puchaud et al. 2019, sec. 2.1: C2 spline below 0.15 s. The spline runs through all seen samples of the
    column; the weight of a sample falls by 0.27 with each frame away from the gap.
    """
    x = np.array(signal, dtype=float)
    seen = np.isfinite(x).all(-1)
    filled = np.zeros(seen.shape, bool)
    for (start, stop), members in _group_runs(~seen).items():
        inside = start >= MIN_CONTEXT and stop <= len(x) - MIN_CONTEXT
        if inside and stop - start <= longest:
            anchored = seen[start - MIN_CONTEXT : start].all(0) & seen[stop : stop + MIN_CONTEXT].all(0)
            filled[start:stop, [m for m in members if anchored[m]]] = True
    frames = np.arange(len(x))
    for column in np.flatnonzero(filled.any(0)):
        known, wanted = seen[:, column], filled[:, column]
        x[wanted, column] = scipy.interpolate.CubicSpline(frames[known], x[known, column])(frames[wanted])
    return x, filled
