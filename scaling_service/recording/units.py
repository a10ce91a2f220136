"""Whether the unit that a recording states can be true of a body."""

from __future__ import annotations

import numpy as np

from scaling_service.core.errors import TrialUnusable
from scaling_service.model.trial import Array, Repair, Trial

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


def given_unit(scale: float, trial: Trial) -> tuple[Repair, ...]:
    """What to note of a factor that the user gave."""
    if scale == 1.0:
        return ()
    return (
        Repair(
            "unit", trial.name, f"positions were multiplied by the given factor {scale:g}", trial.n_frames
        ),
    )


def extremes(positions: Array) -> tuple[Array, Array]:
    """Smallest and largest coordinate among the markers of each frame, (n_frames, 3); NaN if none is seen."""
    seen = np.isfinite(positions)
    low = np.where(seen, positions, np.inf).min(axis=1, initial=np.inf)
    high = np.where(seen, positions, -np.inf).max(axis=1, initial=-np.inf)
    none = ~seen.any(axis=1)
    return np.where(none, np.nan, low), np.where(none, np.nan, high)
