"""Positions so far from all other markers that they cannot be on the body: taken as not seen, and noted."""

from __future__ import annotations

import numpy as np

from scaling_service.model.trial import Array, Repair, Trial
from scaling_service.numerics.least_squares.masks import seen

FARTHEST = 20.0
"""Distance from the middle of a frame's markers, over the typical one, beyond which a marker is no part of a
body (chosen: real recordings of whole bodies and of legs reach 2 to 5)."""

FEWEST = 4
"""Markers of a frame that tell where its middle is (chosen: of three, two may be the strays)."""


def without_strays(trial: Trial) -> Trial:
    """Mark positions that no body can reach as not seen.

    A single one outweighs all other markers in a least-squares fit.

    ``trial``: in any axes and unit. Returns one Repair, ``stray``, for each marker concerned; the same
    trial where there is none.
    """
    shown = seen(trial.markers)
    rows = np.flatnonzero(shown.sum(axis=1) >= FEWEST)
    if not len(rows):
        return trial
    known = np.where(shown[rows, :, None], trial.markers[rows], np.nan)
    distance = np.linalg.norm(known - _median(known), axis=2)
    flags = np.zeros_like(shown)
    flags[rows] = distance > FARTHEST * np.median(distance[shown[rows]])
    if not flags.any():
        return trial
    detail = f"over {FARTHEST:g} times farther from the other markers than usual, taken as not seen"
    repairs = [
        Repair("stray", label, detail, n)
        for label, n in zip(trial.labels, flags.sum(axis=0).tolist(), strict=True)
        if n
    ]
    return trial.with_markers(np.where(flags[..., None], np.nan, trial.markers), *repairs)


def _median(positions: Array) -> Array:
    """Median over the markers (n, m, 3) that are known, (n, 1, 3); numpy's own takes ten times as long."""
    ordered = np.sort(positions, axis=1)  # NaN last
    count = np.isfinite(positions[..., 0]).sum(axis=1)[:, None, None]
    low, high = (np.take_along_axis(ordered, half, axis=1) for half in ((count - 1) // 2, count // 2))
    middle: Array = 0.5 * (low + high)
    return middle
