"""What cannot be true of a body: the unit that a recording states, and positions far from all others."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from scaling_service.core.errors import TrialUnusable
from scaling_service.model.trial import Array, Repair, Trial, repair_each
from scaling_service.numerics.least_squares.masks import seen

_AnyTrial = TypeVar("_AnyTrial", bound=Trial)

PLAUSIBLE_EXTENT_M = (0.2, 5.0)
"""Largest extent of a body's markers (chosen: a child's shank, and arms stretched overhead, with reserve)."""

UNIT_MIXUPS = (1e-3, 1e3)
"""m that are mm, and mm that are m: the mix-ups that occur; their plausible ranges do not overlap."""


def unit_factor(trial: Trial) -> tuple[float, tuple[Repair, ...]]:
    """The factor that makes the size of the body plausible, 1 where the stated unit can be true.

    Raises TrialUnusable if no marker is seen at all, or neither the stated unit nor mm taken for m or m for
    mm gives a body.
    """
    low, high = extremes(trial.markers)
    largest = (high - low).max(axis=1)
    if not np.isfinite(largest).any():
        raise TrialUnusable(
            f"no marker is seen in any frame of trial '{trial.name}'",
            file=trial.name,
            remedy="Check the recording",
        )
    extent = float(np.median(largest[np.isfinite(largest)]))
    least, most = PLAUSIBLE_EXTENT_M
    if least <= extent <= most:
        return 1.0, ()
    for factor in UNIT_MIXUPS:
        if least <= extent * factor <= most:
            stated, true = ("m", "mm") if factor < 1 else ("mm", "m")
            detail = (
                f"the body would measure {extent:.3g} m; positions said to be in {stated} are in {true}, "
                f"so they were multiplied by {factor:g}"
            )
            return factor, (Repair("unit", trial.name, detail, trial.n_frames),)
    if extent == 0 or len(trial.labels) < 2:
        return 1.0, ()
    raise TrialUnusable(
        f"the markers of trial '{trial.name}' extend over {extent:.3g} m, which is no body in m or mm",
        file=trial.name,
        field="Units",
        remedy="Correct the unit that the recording states, or its positions",
    )


def extremes(positions: Array) -> tuple[Array, Array]:
    """Smallest and largest coordinate among the markers of each frame, (n_frames, 3); NaN if none is seen."""
    known = np.isfinite(positions)
    low = np.where(known, positions, np.inf).min(axis=1, initial=np.inf)
    high = np.where(known, positions, -np.inf).max(axis=1, initial=-np.inf)
    none = ~known.any(axis=1)
    return np.where(none, np.nan, low), np.where(none, np.nan, high)


FARTHEST = 20.0
"""Distance from the middle of a frame's markers, over the typical one, beyond which a marker is no part of a
body (chosen: real recordings of whole bodies and of legs reach 2 to 5)."""

FEWEST = 4  # markers of a frame that tell where its middle is (chosen: of three, two may be the strays)


def remove_strays(trial: _AnyTrial) -> _AnyTrial:
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
    repairs = repair_each(flags, trial.labels, "stray", detail)
    markers = np.where(flags[..., None], np.nan, trial.markers)
    return replace(trial, markers=markers, repairs=(*trial.repairs, *repairs))


def _median(positions: Array) -> Array:
    """Median over the markers (n, m, 3) that are known, (n, 1, 3); numpy's own takes ten times as long."""
    ordered = np.sort(positions, axis=1)  # NaN last
    count = np.isfinite(positions[..., 0]).sum(axis=1)[:, None, None]
    low, high = (np.take_along_axis(ordered, half, axis=1) for half in ((count - 1) // 2, count // 2))
    middle: Array = 0.5 * (low + high)
    return middle
