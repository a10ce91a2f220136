"""A joint that moves in a way that the model locks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.laws.additions import Sized, freedom_name
from scaling_service.capabilities.discovery.laws.freedoms import course_error, course_rms, freedoms
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, FreeMotion
from scaling_service.capabilities.discovery.search.option import Option

KIND = "missing_dof"
MEANING = "the joint moves in a way that the model locks"

_NOTES = {"before": "extra turn", "after": "extra turn about own axes", "start": "extra shift"}


def options(now: Account, scene: Scene, stretch_s: float) -> Iterator[Option]:
    """Every joint that turns, with its best directions of turning and of shifting."""
    for free in freedoms(scene, now.watched, stretch_s):
        joint = now.model.segment(free.motion.segment).joint_name
        candidate = Candidate(KIND, (joint,), (), note=_NOTES[free.motion.at], change=free.motion)
        yield Option(candidate, free.fitted, free.gains, free.unseen)


def details(effect: Sized, after: Account) -> Mapping[str, float]:
    """How much it moves, and along which axis."""
    motion = effect.candidate.change
    assert isinstance(motion, FreeMotion)
    rms = course_rms(after.watched, freedom_name(effect.candidate))
    return {**_sized(motion, rms), **dict(zip(("axis_x", "axis_y", "axis_z"), motion.axis, strict=True))}


def spreads(effect: Sized, after: Account, stretch_s: float) -> Mapping[str, float]:
    """How well its RMS is known."""
    motion = effect.candidate.change
    assert isinstance(motion, FreeMotion)
    sd = course_error(after.watched, freedom_name(effect.candidate), stretch_s)
    return _sized(motion, sd) if np.isfinite(sd) else {}


def _sized(motion: FreeMotion, size: float) -> Mapping[str, float]:
    """In the units of results."""
    return {"rms_deg": float(np.degrees(size))} if motion.kind == "rotation" else {"rms_mm": 1e3 * size}
