"""A virtual person with two things hidden, searched once for all tests of this process."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from scaling_service.capabilities.discovery.options import DiscoverSettings
from scaling_service.capabilities.discovery.result import DiscoverResults
from scaling_service.capabilities.discovery.run import run
from scaling_service.capabilities.subject.loading import Loaded
from scaling_service.model.subject import Session
from scaling_service.virtual.example import RECORDED, make_hidden_session

SHORT = replace(RECORDED, functional_s=3.0, gait_trials=1, rate_hz=50.0)
"""Three movements at half the rate: searched in a few seconds."""


def session(seed: int = 2) -> Session:
    """Both knees fit, one walk is held out."""
    whole, _, _ = make_hidden_session(seed, SHORT)
    return replace(whole, calibration=tuple(t for t in whole.calibration if t.name.startswith("knee")))


@cache
def found() -> DiscoverResults:
    """What the search makes of it, from the person's own model."""
    return run(Loaded(session=session()), DiscoverSettings(start="none"))
