"""Skin that swings on its segment, and recordings freed of that."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from scaling_service.capabilities.discovery.laws.candidates import Estimate, Swinging
from scaling_service.capabilities.discovery.observations.oscillator import compute_pull, simulate_oscillator
from scaling_service.capabilities.discovery.observations.tracked import MotionFit
from scaling_service.model.trial import Trial


def still_skin(trial: Trial, near: MotionFit, effects: Iterable[Estimate]) -> Trial:
    """A recording less the swing of its skin, as the motion of another tracking has it."""
    markers = trial.markers
    for effect in effects:
        change = effect.candidate.change
        if isinstance(change, Swinging) and effect.candidate.holds_in(trial.name):
            shown = [m for m in change.markers if m in near.markers]
            pull = compute_pull(near.places[:, [near.markers.index(m) for m in shown]], near.step)
            moved, _ = simulate_oscillator(pull, near.step, change.frequency_hz, change.damping)
            markers = markers.copy()
            markers[:, [trial.index(m) for m in shown]] -= moved
    return trial if markers is trial.markers else replace(trial, markers=markers)
