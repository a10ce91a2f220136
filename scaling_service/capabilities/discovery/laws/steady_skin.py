"""Skin that oscillates on the bone, while the pose follows the skin: brought to its steady state.

What drives the skin is the motion, and the motion is known once the skin is at rest: where a few markers
give a pose, it follows them. The two are made to agree by Newton's method: how the pose follows the markers
is known frame by frame, and how the skin follows the pose is one filter over all frames. A plain round trip
would grow near the resonance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import block_array, bsr_array, csc_array, csr_array, dia_array, diags_array, eye_array, kron
from scipy.sparse.linalg import LinearOperator, SuperLU, gmres, splu

from scaling_service.capabilities.discovery.laws.candidates import Column, Estimate
from scaling_service.capabilities.discovery.laws.profiles import Oscillation
from scaling_service.capabilities.discovery.laws.spots import Generators
from scaling_service.capabilities.discovery.observations.oscillator import (
    compute_pull,
    make_oscillator_taps,
    make_pull_taps,
    simulate_oscillator,
)
from scaling_service.capabilities.discovery.observations.tracked import FEW_DRAWS, TrackedTrial, span
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.laws import Array

_TURNS = 40  # chosen: of GMRES; oscillations that need more are beyond what the pose can follow
_ROUNDS = 12
_SETTLED = 0.05  # of a marker's floor, RMS; chosen: far below what shows
_WORTH = 0.7  # of what was left before; chosen: markers that show nothing of the bone leave no more to gain
_CLOSE = 0.1  # share of what is left that a step may leave (chosen)

Track = Callable[[Trial, TrackedTrial], TrackedTrial]


def find_oscillating_markers(trial: Trial, effects: Sequence[Estimate]) -> tuple[str, ...]:
    """The trial's markers that skin moves in some effect."""
    names = {profile.marker for profile, _ in _list_oscillations(trial, effects)}
    return tuple(label for label in trial.labels if label in names)


def _list_oscillations(trial: Trial, effects: Sequence[Estimate]) -> list[tuple[Oscillation, float]]:
    present = (effect for effect in effects if effect.candidate.holds_in(trial.name))
    return collect_oscillations(column for effect in present for column in effect.columns)


def collect_oscillations(columns: Iterable[tuple[Column, float]]) -> list[tuple[Oscillation, float]]:
    """Each marker's oscillation once, and its share, of columns with their sizes."""
    return [
        (profile, size)
        for column, size in columns
        for profile in {p.profile for p in column.parts if isinstance(p.profile, Oscillation)}
        if profile.axis == 0
    ]


def track_steady(trial: Trial, item: TrackedTrial, effects: Sequence[Estimate], track: Track) -> TrackedTrial:
    """A recording tracked with its skin at rest, or as nearly as its markers allow.

    Where all markers of a segment oscillate with a share of one, quick motions of the bone do not show: a
    part of them stays open, and the round that left least is given. ``item``: the trial tracked as well as is
    known; ``track``: tracks a trial from a start.
    """
    springs = Springs.of(item, _list_oscillations(trial, effects))
    if not springs.markers:
        return track(trial, item)
    on = [trial.index(name) for name in springs.markers]
    moved, carried = _displace_skin(item, springs), Carried.by(item, springs)
    floor = float(np.median(item.floor))
    best, least = item, np.inf
    for _ in range(_ROUNDS):
        markers = trial.markers.copy()
        markers[:, on] -= moved
        item = track(replace(trial, markers=markers), item)
        left = _displace_skin(item, springs) - moved
        rms = float(np.sqrt(np.mean(left**2)))
        gained = rms < _WORTH * least
        if rms < least:
            best, least = item, rms
        if rms < _SETTLED * floor or not gained:
            break
        moved = moved + carried.whole(left, _CLOSE)
    return best


def _displace_skin(item: TrackedTrial, springs: Springs) -> Array:
    """How far a motion moves the skin, (n, n_markers, 3), m, ground."""
    return springs.move(item.places[:, springs.numbers(item)])


def make_steady_replicates(
    item: TrackedTrial, held: Sequence[tuple[Oscillation, float]]
) -> list[TrackedTrial]:
    """Replicates of a recording's noise in which the skin is at rest, too: noise drives it as the bone does.

    ``held``: what oscillates, and its share.
    """
    springs = Springs.of(item, held)
    if not springs.markers:
        return list(item.noise_replicates[:FEW_DRAWS])
    carried, numbers = Carried.by(item, springs), springs.numbers(item)
    found, before = [], item.places[:, numbers]
    for other in item.noise_replicates[:FEW_DRAWS]:
        skin = carried.whole(springs.move(other.places[:, numbers] - before), _CLOSE)
        moved = np.zeros((1, *item.residuals.shape))
        moved[0][:, numbers] = -skin / item.floor[numbers, None]
        back = item.give_way(moved.reshape(1, len(item.q), -1))[0]
        found.append(replace(other, q=other.q + back))
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Springs:
    """What holds the oscillating markers of one trial."""

    markers: tuple[str, ...]
    step: float  # time from frame to frame, s
    # which of the markers, its share, frequency (Hz) and damping ratio
    held: tuple[tuple[int, float, float, float], ...]

    @classmethod
    def of(cls, item: TrackedTrial, oscillations: Sequence[tuple[Oscillation, float]]) -> Springs:
        """Of the markers that are tracked."""
        tracked = [(profile, share) for profile, share in oscillations if profile.marker in item.markers]
        markers = tuple(m for m in item.markers if m in {profile.marker for profile, _ in tracked})
        held = tuple((markers.index(p.marker), share, p.frequency_hz, p.damping) for p, share in tracked)
        return cls(markers, item.step, held)

    def move(self, places: Array) -> Array:
        """How far skin moves over bone that is at some places, both (n, n_markers, 3), m, ground."""
        pull, found = compute_pull(places, self.step), np.zeros_like(places)
        for k, share, frequency, damping in self.held:
            found[:, k] += share * simulate_oscillator(pull[:, k], self.step, frequency, damping)[0]
        return found

    def numbers(self, item: TrackedTrial) -> list[int]:
        """Which of a recording's markers they are."""
        return [item.markers.index(name) for name in self.markers]


@dataclass(frozen=True, eq=False)
class Carried:
    """How a motion that follows oscillating markers carries them further."""

    springs: Springs
    # (n, 3 n_markers, 3 n_markers): how the bone under the markers follows them, the other markers held
    follows: Array

    @classmethod
    def by(cls, item: TrackedTrial, springs: Springs) -> Carried:
        """A motion as it was tracked."""
        _, pose, _ = Generators.of(item, ()).at(item, slice(None))
        numbers = np.array(springs.numbers(item), dtype=np.intp)
        rows = (3 * numbers[:, None] + np.arange(3)).ravel()
        basis, floor = span(pose)[:, :, rows], np.repeat(item.floor[numbers], 3)
        return cls(springs, np.asarray(floor[:, None] * (basis.transpose(0, 2, 1) @ basis) / floor))

    def whole(self, moved: Array, close: float) -> Array:
        """How far the skin goes that is moved by something, and then by the motion that gives way to it.

        By GMRES (Saad & Schultz 1986, SIAM J Sci Stat Comput 7:856). ``moved``: (n, n_markers, 3), m, ground;
        ``close``: share of it that may be left.
        """

        def move(whole: Array) -> Array:
            given_way = (self.follows @ whole.reshape(len(moved), -1, 1)).reshape(moved.shape)
            return whole + self.springs.move(given_way).ravel()

        square = (moved.size, moved.size)
        system = LinearOperator(square, move, dtype=float)
        nearly = LinearOperator(square, self._endless, dtype=float)
        found, _ = gmres(system, moved.ravel(), rtol=close, restart=_TURNS, maxiter=1, M=nearly)
        return np.asarray(found.reshape(moved.shape))

    def _endless(self, moved: Array) -> Array:
        """The same with filters that know no ends: sparse equations, frame after frame."""
        places, factors = self._factors
        right = np.zeros((len(self.follows), 2, self.follows.shape[1]))
        right[:, 0] = (places @ moved).reshape(right[:, 0].shape)
        found: Array = factors.solve(right.ravel()).reshape(right.shape)
        return found[:, 0].ravel()

    @cached_property
    def _factors(self) -> tuple[csr_array, SuperLU]:
        """Taps of the skin's places, and factors of the equations of places and pulls (n, 2, 3 n_markers)."""
        n, width, _ = self.follows.shape
        bone = bsr_array((self.follows, np.arange(n), np.arange(n + 1)))
        taps = make_pull_taps(self.springs.step)
        of_place, of_pull = (kron(_make_centred_taps(each, n), eye_array(width)) for each in taps)
        places, pulls = self._hold(n)
        order = np.arange(2 * n * width).reshape(2, n, width).transpose(1, 0, 2).ravel()
        whole = csr_array(block_array([[places, pulls], [-of_place @ bone, of_pull]]))[order][:, order]
        return places, splu(csc_array(whole), permc_spec="NATURAL")

    def _hold(self, n: int) -> tuple[csr_array, csr_array]:
        """Taps of the skin's places and of the pulls on it; a marker's largest share stands for all."""
        largest = {k: held for k, *held in sorted(self.springs.held, key=lambda held: abs(held[1]))}
        places, pulls = [], []
        for k, (share, frequency, damping) in largest.items():
            of_pull, of_place = make_oscillator_taps(self.springs.step, frequency, damping)
            own = np.repeat(np.arange(len(self.springs.markers)) == k, 3).astype(float)
            places.append(kron(_make_backward_taps(of_place, n), diags_array(own)))
            pulls.append(kron(_make_backward_taps(share * of_pull, n), diags_array(own)))
        return csr_array(sum(places[1:], places[0])), csr_array(sum(pulls[1:], pulls[0]))


def _make_centred_taps(taps: Array, n: int) -> dia_array:
    """Taps about each frame, (n, n)."""
    middle = len(taps) // 2
    return diags_array(list(taps), offsets=list(range(-middle, middle + 1)), shape=(n, n))


def _make_backward_taps(taps: Array, n: int) -> dia_array:
    """Taps of each frame and those before it, (n, n)."""
    return diags_array(list(taps), offsets=[-k for k in range(len(taps))], shape=(n, n))
