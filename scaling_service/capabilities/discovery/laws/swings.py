"""What swings, with its frequency and damping as unknown numbers beside its size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scaling_service.capabilities.discovery.laws.additions import Sized
from scaling_service.capabilities.discovery.laws.loads import Between, Wobbling
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column
from scaling_service.capabilities.discovery.search.catalogue import kinds
from scaling_service.numerics.multibody.laws import Array

FREQUENCIES_HZ, DAMPINGS = (1.0, 30.0), (0.01, 0.9)
SHAPES = ("frequency_hz", "damping")

_APART = 0.05  # of both numbers, for differences; chosen: far below what they are known to


def shaped(effect: Sized, scene: Scene) -> Candidate:
    """An effect's candidate, for a swing with the two numbers that shape it as further columns."""
    if effect.candidate.swing is None or not effect.size.any():
        return effect.candidate
    slopes = (_slope(effect, effect.candidate.swing, k, scene) for k in range(len(SHAPES)))
    return replace(effect.candidate, columns=(*effect.candidate.columns, *slopes))


def stepped(effect: Sized, scene: Scene, step: Array) -> Sized:
    """An effect after a step of all columns of :func:`shaped`."""
    count = len(effect.size)
    moved = replace(effect, size=effect.size + step[:count])
    if len(step) == count or effect.candidate.swing is None:
        return moved
    frequency, damping = np.array(effect.candidate.swing) + step[count:]
    place = (float(np.clip(frequency, *FREQUENCIES_HZ)), float(np.clip(damping, *DAMPINGS)))
    return replace(moved, candidate=swung(effect.candidate, scene, *place))


def swung(candidate: Candidate, scene: Scene, frequency_hz: float, damping: float) -> Candidate:
    """A swing at another frequency and damping."""
    swinging = kinds()[candidate.kind].swinging
    assert swinging is not None
    return replace(swinging(candidate, scene, frequency_hz, damping), trials=candidate.trials)


def _slope(effect: Sized, swing: tuple[float, float], k: int, scene: Scene) -> Column:
    """How the effect changes with its frequency (k = 0) or damping (k = 1)."""
    step = _APART * swing[k]
    ends = []
    for sign in (1.0, -1.0):
        moved = list(swing)
        moved[k] += sign * step
        ends.append(swung(effect.candidate, scene, moved[0], moved[1]).columns[0])
    high, low = ends
    factor = float(effect.size[0]) / (2.0 * step)
    load = None
    if isinstance(high.load, Wobbling) and isinstance(low.load, Wobbling):
        load = Between(high.load, low.load, factor)
    up = tuple(replace(part, gain=factor * part.gain) for part in high.parts)
    down = tuple(replace(part, gain=-factor * part.gain) for part in low.parts)
    return Column(SHAPES[k], 1.0, (*up, *down), load=load)
