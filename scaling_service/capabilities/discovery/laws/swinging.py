"""Where skin is that swings on its segment, and recordings freed of that."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from scaling_service.capabilities.discovery.laws.candidates import Estimate, Swinging
from scaling_service.capabilities.discovery.observations.oscillator import compute_pull, simulate_oscillator
from scaling_service.capabilities.discovery.observations.tracked import MotionFit
from scaling_service.core.arrays import Array
from scaling_service.model.trial import Trial


@dataclass(frozen=True, slots=True, eq=False)
class Pulled:
    """Some markers of a recording as their segments carry them."""

    markers: tuple[str, ...]
    pull: Array  # (n, m, 3), m/s2, ground: minus the acceleration
    axes: Array  # (m, 3, 3, n): of their segments, as rows
    step: float

    @classmethod
    def of(cls, item: MotionFit, markers: Sequence[str]) -> Pulled:
        """As a tracked motion has them."""
        at = [item.markers.index(m) for m in markers]
        axes = item.poses.axes[item.task.tree.marker_link][at]
        return cls(tuple(markers), compute_pull(item.places[:, at], item.step), axes, item.step)

    def swing(self, frequency_hz: float, damping: float) -> Array:
        """How far they swing about their places, (n, m, 3), m, in the axes of their segments."""
        moved, _ = simulate_oscillator(self.pull, self.step, frequency_hz, damping)
        return np.asarray(np.einsum("majn,nmj->nma", self.axes, moved))


def still_skin(trial: Trial, near: MotionFit, effects: Iterable[Estimate]) -> Trial:
    """A recording less the swing of its skin, as the motion of another tracking has it."""
    markers = trial.markers
    for effect in effects:
        change = effect.candidate.change
        if isinstance(change, Swinging) and effect.candidate.holds_in(trial.name):
            shown = [m for m in change.markers if m in near.markers]
            pulled = Pulled.of(near, shown)
            moved = pulled.swing(change.frequency_hz, change.damping)
            markers = markers.copy()
            markers[:, [trial.index(m) for m in shown]] -= np.einsum("majn,nma->nmj", pulled.axes, moved)
    return trial if markers is trial.markers else replace(trial, markers=markers)
