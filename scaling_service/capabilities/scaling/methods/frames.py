"""The frames of the calibration trials that an optimisation uses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.errors import TrialUnusable
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares.masks import seen

_FEWEST_BLOCKS = 4  # chosen: of fewer trials, stretches of equal length stand for independent parts


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationFrames:
    """Frames of several trials as one recording, and the block (trial, or part of it) of each frame."""

    trial: Trial
    blocks: NDArray[np.intp]


def calibration_frames(trials: Sequence[Trial], markers: Sequence[str], count: int) -> CalibrationFrames:
    """Frames equally spaced in time over all calibration trials (Puchaud 2019, section 2.2.4).

    Frames that show none of the markers are passed over.

    Raises
    ------
    TrialUnusable
        There is no frame to calibrate on.
    """
    measured = np.concatenate(
        [np.zeros((0, len(markers), 3)), *(t.selected(markers).markers for t in trials)]
    )
    usable = np.flatnonzero(seen(measured).any(axis=1))
    if not len(usable):
        raise TrialUnusable(
            "no calibration trial shows a marker of the model",
            field="trials.calibration",
            remedy="Give at least one functional movement under `trials: calibration:`",
        )
    chosen = usable[np.unique(np.linspace(0, len(usable) - 1, min(count, len(usable))).round().astype(int))]
    clock = np.arange(len(chosen), dtype=float)  # several trials: their order is all they share
    recording = Trial("calibration", clock, tuple(markers), measured[chosen], 1.0)
    return CalibrationFrames(recording, _blocks(trials)[chosen])


def _blocks(trials: Sequence[Trial]) -> NDArray[np.intp]:
    parts = -(-_FEWEST_BLOCKS // len(trials))
    labels = [k * parts + (np.arange(t.n_frames) * parts) // t.n_frames for k, t in enumerate(trials)]
    return np.concatenate(labels).astype(np.intp)
