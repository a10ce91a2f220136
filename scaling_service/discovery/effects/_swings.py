"""Frequency and damping of what swings."""

from __future__ import annotations

from collections.abc import Mapping

from scaling_service.discovery.additions import Sized
from scaling_service.discovery.fitting import Account


def swing_details(effect: Sized, after: Account) -> Mapping[str, float]:
    """At which frequency and damping it swings."""
    swing = effect.candidate.swing
    assert swing is not None
    return dict(zip(("frequency_hz", "damping"), swing, strict=True))
