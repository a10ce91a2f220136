"""Frequency and damping of what swings, and how well they are known."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from scaling_service.capabilities.discovery.evidence.fitting import Account, scene_of
from scaling_service.capabilities.discovery.evidence.forces import gather_forces
from scaling_service.capabilities.discovery.evidence.score import gather
from scaling_service.capabilities.discovery.laws.additions import Sized
from scaling_service.capabilities.discovery.laws.swings import SHAPES, shaped
from scaling_service.capabilities.discovery.search.judging import fit_each


def swing_details(effect: Sized, after: Account) -> Mapping[str, float]:
    """At which frequency and damping it swings."""
    swing = effect.candidate.swing
    assert swing is not None
    return dict(zip(SHAPES, swing, strict=True))


def swing_spreads(effect: Sized, after: Account, stretch_s: float) -> Mapping[str, float]:
    """Standard deviations of frequency and damping, its size being estimated with them."""
    whole = shaped(effect, scene_of(after))
    others = [s.candidate for s in after.everything if s.candidate.columns]
    others = [c for c in others if c.of_forces == whole.of_forces and c.name != whole.name]
    if whole.of_forces:
        evidence = gather_forces(after.weighed, others, [whole], stretch_s, together=False)
    else:
        evidence = gather(after.watched, others, [whole], stretch_s, together=False)
    covariance = fit_each(evidence, [whole])[0].spread
    if len(covariance) < len(whole.columns):
        return {}
    sd = np.sqrt(np.diag(covariance))[-len(SHAPES) :].tolist()
    return {name: value for name, value in zip(SHAPES, sd, strict=True) if value > 0.0}
