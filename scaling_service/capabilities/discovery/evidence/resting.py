"""Skin that swings, brought to rest.

What drives the skin is the motion, and the motion is known once the skin is at rest: where a few markers
give a pose, it follows them. The two are made to agree by Newton's method: how the pose follows the markers
is known frame by frame, and how the skin follows the pose is one filter over all frames. A plain round trip
would grow near the resonance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from scaling_service.capabilities.discovery.evidence.watched import Watched
from scaling_service.capabilities.discovery.laws.additions import Sized
from scaling_service.capabilities.discovery.laws.profiles import Swing
from scaling_service.capabilities.discovery.laws.springs import Carried, Springs
from scaling_service.capabilities.discovery.laws.wobbles import Skin
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.laws import Array

_ROUNDS = 12
_SETTLED = 0.05  # of a marker's floor, RMS; chosen: far below what shows
_WORTH = 0.7  # of what was left before; chosen: markers that show nothing of the bone leave no more to gain
_CLOSE = 0.1  # share of what is left that a step may leave (chosen)

Follow = Callable[[Trial, Watched], Watched]


def swinging_markers(trial: Trial, effects: Sequence[Sized]) -> tuple[str, ...]:
    """The trial's markers that skin moves in some effect."""
    names = {swing.marker for swing, _ in _swings(trial, effects)}
    return tuple(label for label in trial.labels if label in names)


def _swings(trial: Trial, effects: Sequence[Sized]) -> list[tuple[Swing, float]]:
    """Each marker's swing once, and its share."""
    return [
        (swing, size)
        for effect in effects
        if effect.candidate.holds_in(trial.name)
        for column, size in effect.columns
        for swing in {p.profile for p in column.parts if isinstance(p.profile, Swing)}
        if swing.axis == 0
    ]


def rested(trial: Trial, item: Watched, effects: Sequence[Sized], follow: Follow) -> Watched:
    """A recording followed with its skin at rest, or as nearly as its markers allow.

    Where all markers of a segment swing with a share of one, quick motions of the bone do not show: a part of
    them stays open, and the round that left least is given.

    Parameters
    ----------
    trial : Trial
        As measured.
    item : Watched
        The same, followed as well as is known.
    effects : sequence of Sized
    follow : callable
        Follows a trial, from a start.
    """
    springs = _springs(trial, item, effects)
    if not springs.markers:
        return follow(trial, item)
    on = [trial.index(name) for name in springs.markers]
    moved, carried = _under(item, springs), Carried.by(item, springs)
    floor = float(np.median(item.floor))
    best, least = item, np.inf
    for _ in range(_ROUNDS):
        markers = trial.markers.copy()
        markers[:, on] -= moved
        item = follow(replace(trial, markers=markers), item)
        left = _under(item, springs) - moved
        rms = float(np.sqrt(np.mean(left**2)))
        gained = rms < _WORTH * least
        if rms < least:
            best, least = item, rms
        if rms < _SETTLED * floor or not gained:
            break
        moved = moved + carried.whole(left, _CLOSE)
    return best


def _springs(trial: Trial, item: Watched, effects: Sequence[Sized]) -> Springs:
    """Of the markers that are followed."""
    markers = tuple(name for name in swinging_markers(trial, effects) if name in item.markers)
    held = tuple(
        (markers.index(swing.marker), size, swing.frequency_hz, swing.damping)
        for swing, size in _swings(trial, effects)
        if swing.marker in markers
    )
    return Springs(markers, Skin(item).step, held)


def _under(item: Watched, springs: Springs) -> Array:
    """How far a motion moves the skin, (n, n_markers, 3), m, ground."""
    return springs.moved(Skin(item).places[:, springs.numbers(item)])
