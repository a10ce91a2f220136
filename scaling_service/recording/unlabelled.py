"""Trajectories that nobody has labelled, and the markers whose gaps they fill."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from scaling_service.model.trial import Array, Trial, is_unlabelled
from scaling_service.numerics.least_squares.masks import Mask, seen

NEAR_M = 0.03
"""Chosen: a trajectory that goes on within this distance where a marker is lost is the marker's own."""

OVERLAP = 0.1  # chosen: share of its frames in which a trajectory may be seen beside the marker that it fills


@dataclass(frozen=True, slots=True)
class Unlabelled:
    """One trajectory without a label."""

    label: str  # as the file has it
    frames: int  # in which it is seen
    fills: str | None = None  # the marker in whose gaps it lies
    filled: int = 0  # frames of those gaps that it shows


def find_unlabelled(trial: Trial) -> Iterator[Unlabelled]:
    """The trajectories without a label, each with the marker that it seems to be.

    ``trial``: in m.
    """
    shown = seen(trial.markers)
    named = [k for k, label in enumerate(trial.labels) if not is_unlabelled(label)]
    for k, label in enumerate(trial.labels):
        if k in named or not shown[:, k].any():
            continue
        best = min(
            (_distance_in_gaps(trial.markers, shown, k, other) for other in named),
            default=(float("inf"), 0, 0),
        )
        frames = int(shown[:, k].sum())
        if best[0] <= NEAR_M:
            yield Unlabelled(label, frames, trial.labels[best[1]], best[2])
        else:
            yield Unlabelled(label, frames)


def _distance_in_gaps(markers: Array, shown: Mask, column: int, other: int) -> tuple[float, int, int]:
    """How far a trajectory, prolonged by a frame, misses another where that is lost or found again, m.

    Returns ``distance``: median over those frames; infinite where the two are seen side by side or never
    take turns. ``frames``: in which the trajectory is seen and the other is not.
    """
    here, there = shown[:, column], shown[:, other]
    if (here & there).sum() > OVERLAP * here.sum():
        return float("inf"), other, 0
    missed = []
    for step in (1, -1):  # the other is lost, then found again
        own, its = markers[::step, column], markers[::step, other]
        first = np.flatnonzero(there[::step][:-2] & here[::step][1:-1] & here[::step][2:]) + 1
        missed.append(np.linalg.norm(2.0 * own[first] - own[first + 1] - its[first - 1], axis=1))
    distances = np.concatenate(missed)
    if not len(distances):
        return float("inf"), other, 0
    return float(np.median(distances)), other, int((here & ~there).sum())
