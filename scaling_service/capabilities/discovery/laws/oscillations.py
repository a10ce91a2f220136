"""What oscillates, with its frequency and damping as unknown numbers beside its size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column, Estimate
from scaling_service.capabilities.discovery.laws.loads import Between, Wobbling
from scaling_service.numerics.multibody.laws import Array

FREQUENCIES_HZ, DAMPINGS = (1.0, 30.0), (0.01, 0.9)
SHAPES = ("frequency_hz", "damping")
TRIED = tuple((f, z) for f in (3.0, 4.5, 6.5, 9.0, 13.0, 18.0) for z in (0.1, 0.3))
"""Frequencies (Hz) and damping ratios tried first; the best is tuned (chosen: from the slow sway of heavy
tissue to the quick one of a marker on thin skin, lightly and well damped)."""

_APART = 0.05  # of both numbers, for differences; chosen: far below what they are known to


def with_shape_columns(effect: Estimate) -> Candidate:
    """An effect's candidate, for an oscillation with the two numbers that shape it as further columns."""
    pair = effect.candidate.oscillation
    if pair is None or not effect.size.any():
        return effect.candidate
    slopes = (_slope(effect, pair, k) for k in range(len(SHAPES)))
    return replace(effect.candidate, columns=(*effect.candidate.columns, *slopes))


def stepped(effect: Estimate, step: Array) -> Estimate:
    """An effect after a step of all columns of :func:`with_shape_columns`."""
    count = len(effect.size)
    moved = replace(effect, size=effect.size + step[:count])
    if len(step) == count or effect.candidate.oscillation is None:
        return moved
    frequency, damping = np.array(effect.candidate.oscillation) + step[count:]
    place = (float(np.clip(frequency, *FREQUENCIES_HZ)), float(np.clip(damping, *DAMPINGS)))
    return replace(moved, candidate=effect.candidate.at(*place))


def _slope(effect: Estimate, pair: tuple[float, float], k: int) -> Column:
    """How the effect changes with its frequency (k = 0) or damping (k = 1)."""
    step = _APART * pair[k]
    ends = []
    for sign in (1.0, -1.0):
        moved = list(pair)
        moved[k] += sign * step
        ends.append(effect.candidate.columns[0].at(moved[0], moved[1]))
    high, low = ends
    factor = float(effect.size[0]) / (2.0 * step)
    load = None
    if isinstance(high.load, Wobbling) and isinstance(low.load, Wobbling):
        load = Between(high.load, low.load, factor)
    up = tuple(replace(part, gain=factor * part.gain) for part in high.parts)
    down = tuple(replace(part, gain=-factor * part.gain) for part in low.parts)
    return Column(SHAPES[k], 1.0, (*up, *down), load=load)
