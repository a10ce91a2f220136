"""Skin that swings, brought to rest.

What drives the skin is the motion, and the motion is known once the skin is at rest: where a few markers give
a pose, it follows them. The two are made to agree by Anderson's mixing (1965, J ACM 12:547), for the plain
round trip grows near the resonance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from scaling_service.discovery.additions import Sized
from scaling_service.discovery.profiles import Swing
from scaling_service.discovery.watched import Watched
from scaling_service.discovery.wobbles import Skin
from scaling_service.kernels.laws import Array
from scaling_service.models.trial import Trial

_ROUNDS = 12
_SETTLED = 0.05  # of a marker's floor, RMS; chosen: far below what shows
_DAMPED, _DEPTH = 0.5, 6  # chosen: the usual ones

Follow = Callable[[Trial, Watched], Watched]


def swinging_markers(trial: Trial, effects: Sequence[Sized]) -> list[int]:
    """Columns of the trial's markers that skin moves in some effect."""
    names = {
        part.profile.marker
        for effect in effects
        if effect.candidate.holds_in(trial.name)
        for column in effect.candidate.columns
        for part in column.parts
        if isinstance(part.profile, Swing)
    }
    return sorted(trial.index(name) for name in names)


def rested(trial: Trial, item: Watched, effects: Sequence[Sized], follow: Follow) -> Watched:
    """A recording followed with its skin at rest.

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
    on = swinging_markers(trial, effects)
    moved = _swung(trial, item, effects)[:, on]
    floor = float(np.median(item.floor))
    tried: list[tuple[Array, Array]] = []
    best, least = item, np.inf
    for _ in range(_ROUNDS):
        markers = trial.markers.copy()
        markers[:, on] -= moved
        item = follow(replace(trial, markers=markers), item)
        left = _swung(trial, item, effects)[:, on] - moved
        rms = float(np.sqrt(np.mean(left**2)))
        if rms < least:
            best, least = item, rms
        if rms < _SETTLED * floor:
            break
        tried.append((moved, left))
        moved = _mixed(tried[-_DEPTH:])
    return best


def _mixed(tried: Sequence[tuple[Array, Array]]) -> Array:
    """The next displacements from those tried and what each left."""
    moved, left = tried[-1]
    if len(tried) > 1:
        steps = np.stack([(b[0] - a[0]).ravel() for a, b in pairwise(tried)], axis=1)
        falls = np.stack([(b[1] - a[1]).ravel() for a, b in pairwise(tried)], axis=1)
        share = np.linalg.lstsq(falls, left.ravel(), rcond=None)[0]
        moved = moved - (steps @ share).reshape(moved.shape)
        left = left - (falls @ share).reshape(left.shape)
    return np.asarray(moved + _DAMPED * left)


def _swung(trial: Trial, item: Watched, effects: Sequence[Sized]) -> Array:
    """How far skin moves every marker of a trial, (n, n_markers, 3), m, ground."""
    skin, found = Skin(item), np.zeros_like(trial.markers)
    for effect in effects:
        if effect.candidate.holds_in(trial.name):
            for column, size in effect.columns:
                for swing in {p.profile for p in column.parts if isinstance(p.profile, Swing)}:
                    if swing.axis == 0 and swing.marker in item.markers:
                        moved = skin.swing(swing.frequency_hz, swing.damping)
                        at = item.markers.index(swing.marker)
                        found[:, trial.index(swing.marker)] += size * moved[:, at]
    return found
