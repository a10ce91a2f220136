"""From a recording as read to one that can be computed with: axes and unit, smoothing, gaps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scaling_service.core.arrays import Array, Mask
from scaling_service.core.errors import InputError
from scaling_service.core.names import say_name
from scaling_service.model.trial import Repair, Trial, repair_each
from scaling_service.numerics.least_squares.problem import find_seen
from scaling_service.numerics.multibody import rigid
from scaling_service.numerics.signals import filters
from scaling_service.recording import orientation
from scaling_service.recording.settings import LEAST_RATE, LONGEST_SPLINE_S, ProcessingSettings

ORDER = 4
"""Effective order, 2 forwards and 2 backwards (chosen: the custom of gait laboratories, Winter 2009)."""

MIN_COMMON_FRAMES = 10
"""Frames in which a marker and three others are seen together (chosen: 0.1 s at 100 Hz, so that one bad frame
does not make the shape)."""

_MOST_COMMON = 2000  # chosen: frames, equally spaced; noise of 1 mm leaves 0.02 mm in their mean shape
_SHAPE_ROUNDS = 10  # chosen: the mean shape settles by a factor above ten per round
_SHAPE_SETTLED_M = 1e-6  # chosen: a hundredth of a camera system's noise


def process(
    trial: Trial,
    axes: orientation.Orientation,
    clusters: Mapping[str, tuple[str, ...]],
    settings: ProcessingSettings | None = None,
) -> Trial:
    """Turn, scale, smooth and fill a recording.

    ``trial``: as read. ``axes``: the session's; see ``decide``. ``clusters``: segment to the labels that
    sit on it. Returns X forward, Y up, Z right, m; NaN only where nothing is known. Everything done is
    in ``repairs``. Raises TrialUnusable if no marker is seen at all, or the unit cannot be told. Raises
    InputError if the cutoff does not suit the frame rate.
    """
    return clean(orientation.apply(axes, trial), clusters, settings or ProcessingSettings())


def clean(trial: Trial, clusters: Mapping[str, tuple[str, ...]], settings: ProcessingSettings) -> Trial:
    """Smooth and fill a recording that is turned and in m already; see :func:`process`."""
    cutoff_hz = settings.cutoff_hz
    if settings.smoothing == "automatic" and trial.rate_hz < LEAST_RATE * cutoff_hz:
        slow = f"{trial.rate_hz:.4g} frames per second are too few for a low pass of {cutoff_hz:g} Hz"
        told = Repair("not_smoothed", trial.name, f"not smoothed: {slow}", frames=trial.n_frames)
        trial = trial.with_markers(trial.markers, told)
    elif settings.smoothing != "none":
        trial = smooth(trial, cutoff_hz)
    return fill(trial, clusters if settings.solidify else {}, longest_spline_s=settings.longest_spline_s)


def smooth(trial: Trial, cutoff_hz: float) -> Trial:
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
    result = filters.filter_butterworth(
        trial.markers, rate_hz=trial.rate_hz, cutoff_hz=cutoff_hz, order=ORDER
    )
    detail = f"smoothed: zero-phase Butterworth, order {ORDER}, half power at {cutoff_hz:g} Hz"
    brief = "seen too briefly between gaps to be filtered; left as measured"
    short = repair_each(np.any(result.unfiltered, axis=-1), trial.labels, "not_smoothed", brief)
    return trial.with_markers(
        result.values,
        Repair("smoothing", trial.name, detail, frames=trial.n_frames),
        *short,
    )


def fill(
    trial: Trial, clusters: Mapping[str, tuple[str, ...]], *, longest_spline_s: float = LONGEST_SPLINE_S
) -> Trial:
    """Fill what can be filled and note it; what remains stays NaN.

    ``clusters``: segment to the labels that sit on it; absent labels are passed over. ``longest_spline_s``:
    gaps up to this long, with frames seen on both sides, are interpolated by a C2 spline.
    Returns one Repair per marker and kind:
    ``gap_spline``, ``gap_solidification``, ``gap_left``.

    Puchaud et al. 2019, sec. 2.1. Solidification after Soderkvist & Wedin 1993: the mean shape of the
    segment's markers is carried onto the others that are seen; the small mismatch where the marker
    disappears and comes back is spread linearly over the gap, so that no step is left. In gaps of 0.2 s cut
    out of real walking, squats and hip movements this lowers the error by 1.5 to 6 times; at 1.5 s it does
    not matter.
    """
    longest = int(np.floor(longest_spline_s * trial.rate_hz + 1e-6))
    markers, splined = filters.fill_short_gaps(trial.markers, longest=longest)
    shown = find_seen(markers)
    filled, left, solidified = markers.copy(), ~shown, list[Repair]()
    for segment, labels in clusters.items():
        for part in _solidify(markers, shown, trial.labels, segment, labels):
            # A marker listed for two segments is filled by the first that can.
            new = part.frames & left[:, part.column]
            if new.any():
                filled[new, part.column] = part.positions[new]
                left[new, part.column] = False
                where, frames = trial.labels[part.column], int(new.sum())
                solidified.append(Repair("gap_solidification", where, part.detail, frames=frames))
    spline = f"gaps of at most {longest} frames interpolated by a C2 spline"
    return trial.with_markers(
        filled,
        *repair_each(splined, trial.labels, "gap_spline", spline),
        *solidified,
        *repair_each(left, trial.labels, "gap_left", "not seen and not filled"),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Solid:
    """Positions of one marker in the frames where the rest of its segment gives them."""

    column: int
    frames: Mask  # (n_frames,)
    positions: Array  # (n_frames, 3), m
    detail: str


def _solidify(
    markers: Array, seen: Mask, all_labels: tuple[str, ...], segment: str, labels: tuple[str, ...]
) -> list[_Solid]:
    columns = [all_labels.index(label) for label in dict.fromkeys(labels) if label in all_labels]
    cloud, shown = markers[:, columns], seen[:, columns]
    parts = []
    for k, column in enumerate(columns):
        others = shown.sum(axis=1) - shown[:, k]
        wanted = ~shown[:, k] & (others >= rigid.MIN_POINTS)
        common = shown[:, k] & (others >= rigid.MIN_POINTS)
        if wanted.any() and common.sum() >= MIN_COMMON_FRAMES:
            part = _carry(cloud, k, wanted, common)
            if part is not None:
                frames, positions, rms = part
                detail = (
                    f"from the other markers of the {say_name(segment)}, which keep their shape to "
                    f"{1e3 * rms:.1f} mm"
                )
                parts.append(_Solid(column, frames, positions, detail))
    return parts


def _carry(cloud: Array, k: int, wanted: Mask, common: Mask) -> tuple[Mask, Array, float] | None:
    """Marker k where it is wanted: frames, positions and how well the rest keeps its shape (RMS, m)."""
    known = np.flatnonzero(common)
    known = known[np.unique(np.linspace(0, len(known) - 1, min(len(known), _MOST_COMMON)).astype(np.intp))]
    shape = average_shape(cloud[known])
    rest = shape.copy()
    rest[k] = np.nan
    beside = wanted.copy()
    beside[1:] |= wanted[:-1]
    beside[:-1] |= wanted[1:]
    rows = np.flatnonzero(beside)  # the gaps and their borders
    predicted = np.full((len(cloud), 3), np.nan)
    predicted[rows] = _place_shape(shape, rest, cloud[rows])[:, k]
    possible = wanted & np.isfinite(predicted).all(axis=-1)
    if not possible.any():
        return None
    misfit = cloud[known] - _place_shape(shape, rest, cloud[known])
    misfit[:, k] = np.nan
    squares = (misfit**2).sum(axis=-1)
    rms = float(np.sqrt(squares[np.isfinite(squares)].mean())) if np.isfinite(squares).any() else float("nan")
    # Correction inside each wanted run, linear between the mismatch at its two borders. `mismatch` (n_frames,
    # 3), m: measured minus carried, NaN where either is missing. `wanted`: (n_frames,) bool.
    mismatch = cloud[:, k] - predicted
    correction = np.zeros_like(mismatch)
    n = len(mismatch)
    for start, stop in filters.find_runs(possible).tolist():
        before = mismatch[start - 1] if start > 0 else np.full(3, np.nan)
        after = mismatch[stop] if stop < n else np.full(3, np.nan)
        if not np.isfinite(before).all():
            before = after
        if not np.isfinite(after).all():
            after = before
        if np.isfinite(before).all():
            share = np.arange(1, stop - start + 1)[:, None] / (stop - start + 1)
            correction[start:stop] = (1 - share) * before + share * after
    predicted = predicted + correction
    return possible, predicted, rms


def _place_shape(shape: Array, rest: Array, cloud: Array) -> Array:
    """The shape (m, 3) where the rest of it lies best on each frame of a cloud (n, m, 3)."""
    rotation, shift = rigid.fit_rigid(rest, cloud)
    fitted: Array = np.einsum("fij,mj->fmi", rotation, shape) + shift[:, None]
    return fitted


def average_shape(cloud: Array) -> Array:
    """Mean shape of a cluster over frames in which not every marker is seen.

    ``cloud`` (n_frames, m, 3), m: NaN where not seen; at least three markers in every frame. Returns in the
    axes of the frame with most markers; NaN for a marker never seen with three others.

    Generalised Procrustes: every frame is fitted to the shape so far, the shape is the mean of the fitted
    frames, until it settles.
    """
    shown = find_seen(cloud)
    shape: Array = cloud[int(np.argmax(shown.sum(axis=1)))]
    for _ in range(_SHAPE_ROUNDS):
        rotation, shift = rigid.fit_rigid(shape, cloud)
        local = np.einsum("fji,fmj->fmi", rotation, cloud - shift[:, None])
        counted = np.isfinite(local).all(-1, keepdims=True)
        count = counted.sum(axis=0)
        mean = np.where(count > 0, np.where(counted, local, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)
        both = np.isfinite(mean) & np.isfinite(shape)
        change = np.abs(mean - shape)[both].max(initial=0.0)
        settled = change < _SHAPE_SETTLED_M and np.isfinite(mean).sum() == np.isfinite(shape).sum()
        # A marker that no fitted frame shows keeps what is known of it.
        shape = np.where(np.isfinite(mean), mean, shape)
        if settled:
            break
    return shape
