"""Positions so far from all other markers that they cannot be on the body: taken as not seen, and noted."""

from __future__ import annotations

import numpy as np

from scaling_service.kernels.masks import seen
from scaling_service.models.trial import Repair, Trial

FARTHEST = 20.0
"""Distance from the middle of a frame's markers, over the typical one, beyond which a marker is no part of a
body (chosen: real recordings of whole bodies and of legs reach 2 to 5)."""

FEWEST = 4
"""Markers of a frame that tell where its middle is (chosen: of three, two may be the strays)."""


def without_strays(trial: Trial) -> Trial:
    """Mark positions that no body can reach as not seen.

    A single one outweighs all other markers in a least-squares fit.

    Parameters
    ----------
    trial : Trial
        In any axes and unit.

    Returns
    -------
    Trial
        One Repair, ``stray``, for each marker concerned; the same trial where there is none.
    """
    shown = seen(trial.markers)
    rows = np.flatnonzero(shown.sum(axis=1) >= FEWEST)
    if not len(rows):
        return trial
    middle = np.nanmedian(trial.markers[rows], axis=1, keepdims=True)
    distance = np.linalg.norm(trial.markers[rows] - middle, axis=2)
    flags = np.zeros_like(shown)
    with np.errstate(invalid="ignore"):
        flags[rows] = distance > FARTHEST * np.nanmedian(distance)
    if not flags.any():
        return trial
    detail = f"over {FARTHEST:g} times farther from the other markers than usual, taken as not seen"
    repairs = [
        Repair("stray", label, detail, n)
        for label, n in zip(trial.labels, flags.sum(axis=0).tolist(), strict=True)
        if n
    ]
    return trial.with_markers(np.where(flags[..., None], np.nan, trial.markers), *repairs)
