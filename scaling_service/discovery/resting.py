"""Skin that swings, brought to rest.

What drives the skin is the motion, and the motion is known once the skin is at rest: where a few markers
give a pose, it follows them. The two are made to agree by Newton's method: how the pose follows the markers
is known frame by frame, how the skin follows the pose is one filter over all frames, and the step that
satisfies both is found by GMRES (Saad & Schultz 1986, SIAM J Sci Stat Comput 7:856). A plain round trip
would grow near the resonance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse.linalg import LinearOperator, gmres

from scaling_service.discovery.additions import Sized
from scaling_service.discovery.evidence import Generators, span
from scaling_service.discovery.oscillator import oscillate, pulled
from scaling_service.discovery.profiles import Swing
from scaling_service.discovery.watched import Watched
from scaling_service.discovery.wobbles import Skin
from scaling_service.kernels.laws import Array
from scaling_service.models.trial import Trial

_ROUNDS = 12
_SETTLED = 0.05  # of a marker's floor, RMS; chosen: far below what shows
_CLOSE, _MOST = 0.1, 40  # share of what is left that a step may leave, and turns spent on it; chosen

Follow = Callable[[Trial, Watched], Watched]


def swinging_markers(trial: Trial, effects: Sequence[Sized]) -> tuple[str, ...]:
    """The trial's markers that skin moves in some effect."""
    names = {swing.marker for swing, _ in _swings(trial, effects)}
    return tuple(sorted(names, key=trial.index))


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
    springs = _Springs.of(trial, item, effects)
    on = [trial.index(name) for name in springs.markers]
    moved = springs.under(item)
    floor = float(np.median(item.floor))
    best, least = item, np.inf
    for _ in range(_ROUNDS):
        markers = trial.markers.copy()
        markers[:, on] -= moved
        item = follow(replace(trial, markers=markers), item)
        left = springs.under(item) - moved
        rms = float(np.sqrt(np.mean(left**2)))
        if rms < least:
            best, least = item, rms
        if rms < _SETTLED * floor:
            break
        moved = moved + _step(springs, item, left)
    return best


@dataclass(frozen=True, slots=True, eq=False)
class _Springs:
    """What holds the swinging markers of one trial.

    Parameters
    ----------
    markers : tuple of str
    step : float
        Time from frame to frame, s.
    held : tuple
        Which of the markers, its share, frequency (Hz) and damping ratio.
    """

    markers: tuple[str, ...]
    step: float
    held: tuple[tuple[int, float, float, float], ...]

    @classmethod
    def of(cls, trial: Trial, item: Watched, effects: Sequence[Sized]) -> _Springs:
        """Of the markers that are followed."""
        markers = tuple(name for name in swinging_markers(trial, effects) if name in item.markers)
        held = tuple(
            (markers.index(swing.marker), size, swing.frequency_hz, swing.damping)
            for swing, size in _swings(trial, effects)
            if swing.marker in markers
        )
        return cls(markers, Skin(item).step, held)

    def moved(self, places: Array) -> Array:
        """How far skin moves over bone that is at some places, both (n, n_markers, 3), m, ground."""
        pull, found = pulled(places, self.step), np.zeros_like(places)
        for k, share, frequency, damping in self.held:
            found[:, k] += share * oscillate(pull[:, k], self.step, frequency, damping)[0]
        return found

    def under(self, item: Watched) -> Array:
        """How far a motion moves the skin, (n, n_markers, 3), m, ground."""
        return self.moved(Skin(item).places[:, self.numbers(item)])

    def numbers(self, item: Watched) -> list[int]:
        """Which of a recording's markers they are."""
        return [item.markers.index(name) for name in self.markers]


def _step(springs: _Springs, item: Watched, left: Array) -> Array:
    """How much further the skin moves, (n, n_markers, 3), for what a round has left."""
    follows = _follows(item, springs.numbers(item))

    def left_of(moved: Array) -> Array:
        carried = follows @ moved.reshape(len(left), -1, 1)
        return moved + springs.moved(carried.reshape(left.shape)).ravel()

    whole = LinearOperator((left.size, left.size), left_of, dtype=float)
    found, _ = gmres(whole, left.ravel(), rtol=_CLOSE, restart=_MOST, maxiter=1)
    return np.asarray(found.reshape(left.shape))


def _follows(item: Watched, markers: Sequence[int]) -> Array:
    """How the model's markers follow the measured ones, the others held, (n, 3 n_markers, 3 n_markers)."""
    _, pose, _ = Generators.of(item, ()).at(item, slice(None))
    rows = (3 * np.array(markers)[:, None] + np.arange(3)).ravel()
    basis, floor = span(pose)[:, rows], np.repeat(item.floor[list(markers)], 3)
    return np.asarray(floor[:, None] * (basis @ basis.transpose(0, 2, 1)) / floor)
