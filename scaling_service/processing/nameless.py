"""Trajectories that nobody has labelled, and the markers whose gaps they fill."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from scaling_service.kernels.masks import Mask, seen
from scaling_service.models.trial import Array, Trial

_NAMELESS = re.compile(
    r"^(\*\d*|u_?\d+|\?+\d*|uname\w*|unnamed\w*|unlabell?ed\w*|unidentified\w*)$", re.IGNORECASE
)
"""How systems write a trajectory that has no label: ``*110`` (Vicon, C3D), ``U_3``, ``Unlabeled12``."""

NEAR_M = 0.03
"""Chosen: a trajectory that is this close to where a straight line bridges the gap of a marker is its own."""

OVERLAP = 0.1
"""Chosen: share of its frames in which a trajectory may be seen beside the marker that it fills."""


@dataclass(frozen=True, slots=True)
class Nameless:
    """One trajectory without a label.

    Parameters
    ----------
    label : str
        As the file has it.
    frames : int
        In which it is seen.
    fills : str, optional
        The marker in whose gaps it lies.
    filled : int
        Frames of those gaps that it shows.
    """

    label: str
    frames: int
    fills: str | None = None
    filled: int = 0


def is_nameless(label: str) -> bool:
    """Whether a label is what a system writes where nobody gave one.

    Examples
    --------
    >>> [is_nameless(label) for label in ("*110", "S01:U_3", "Unlabeled 4", "RUPA")]
    [True, True, True, False]
    """
    return bool(_NAMELESS.match(label.rsplit(":", 1)[-1].replace(" ", "")))


def nameless(trial: Trial) -> Iterator[Nameless]:
    """The trajectories without a label, each with the marker that it seems to be.

    Parameters
    ----------
    trial : Trial
        In m.
    """
    shown = seen(trial.markers)
    named = [k for k, label in enumerate(trial.labels) if not is_nameless(label)]
    for k, label in enumerate(trial.labels):
        if k in named or not shown[:, k].any():
            continue
        best = min(
            (_distance_in_gaps(trial.markers, shown, k, other) for other in named),
            default=(float("inf"), 0, 0),
        )
        frames = int(shown[:, k].sum())
        if best[0] <= NEAR_M:
            yield Nameless(label, frames, trial.labels[best[1]], best[2])
        else:
            yield Nameless(label, frames)


def _distance_in_gaps(markers: Array, shown: Mask, column: int, other: int) -> tuple[float, int, int]:
    """How far a trajectory is from a line through another's gaps, m; that one's column; frames filled."""
    here, there = shown[:, column], shown[:, other]
    rows = np.flatnonzero(here & ~there)
    if not len(rows) or not there.any() or (here & there).sum() > OVERLAP * here.sum():
        return float("inf"), other, 0
    known = np.flatnonzero(there)
    line = np.stack([np.interp(rows, known, markers[known, other, axis]) for axis in range(3)], axis=1)
    return float(np.median(np.linalg.norm(markers[rows, column] - line, axis=1))), other, len(rows)
