"""Skin under a marker or a cluster that swings when its segment accelerates, as an oscillator."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.effects.catalogue import Effect
from scaling_service.capabilities.discovery.effects.oscillations import describe_shape
from scaling_service.capabilities.discovery.laws.candidates import (
    DAMPINGS,
    FREQUENCIES_HZ,
    TRIED,
    Candidate,
    Swinging,
    describe_oscillation,
)
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.laws.spots import MarkerSpot
from scaling_service.capabilities.discovery.observations.oscillator import compute_pull, simulate_oscillator
from scaling_service.capabilities.discovery.ordinary.columns import Base
from scaling_service.capabilities.discovery.ordinary.sums import White, place_in_segments, weigh_markers
from scaling_service.numerics.multibody.laws import Array

KIND = "skin_wobble"
_FEWEST_S = 0.5  # of a recording: shorter than this nothing comes to rest (chosen: two periods at 4 Hz)


def find_swinging_skin(
    scene: Scene, base: Base, whites: Sequence[tuple[White, Array]]
) -> Iterator[tuple[float, Candidate]]:
    """The likeliest swing of every marker and group of markers, with its log odds.

    ``whites``: of every recording, with residuals (n, 3 m) less everything ordinary that lasts, no marker
    taken for livelier than its part; how much each is, is learnt beside every candidate.
    """
    looks = [
        _Skin.of(w, left, base, w.look.item.markers)
        for w, left in whites
        if w.look.item.step * len(w.look.item.q) > _FEWEST_S
    ]
    groups = [g for segment in scene.bearing for g in scene.groups_on(segment.name)]
    if not looks or not groups:
        return
    weighed = np.array([_weigh(looks, groups, pair) for pair in TRIED])
    best = groups[int(np.argmax(weighed.max(axis=0)))]
    for group, each in zip(groups, weighed.T, strict=True):
        odds, pair = float(each.max()), TRIED[int(np.argmax(each))]
        if group == best and odds > 0.0:
            odds, pair = _tune([_Skin.of(s.white, s.left, base, group) for s in looks], group, pair)
        change = Swinging(group, *pair)
        candidate = Candidate(
            kind=KIND, where=group, columns=(), note=describe_oscillation(*pair), change=change
        )
        yield odds - math.log(len(groups) * len(TRIED)), candidate


def tune_swing(base: Base, whites: Sequence[tuple[White, Array]], candidate: Candidate) -> Candidate:
    """The same with the likeliest frequency and damping, of recordings that are freed of its swing."""
    change = candidate.change
    assert isinstance(change, Swinging)
    pair, with_it = (change.frequency_hz, change.damping), []
    for white, left in whites:
        skin = _Skin.of(white, left, base, change.markers)
        moved = sum(skin.move(pair).values(), np.zeros(()))
        with_it.append(replace(skin, left=left + moved))
    anew = _tune(with_it, change.markers, pair)[1]
    return replace(candidate, note=describe_oscillation(*anew), change=Swinging(change.markers, *anew))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Skin:
    """Some markers of a recording that may swing."""

    white: White
    left: Array  # (n, 3 m): residuals less everything ordinary that lasts
    markers: tuple[str, ...]
    pull: Array  # (n_frames, m, 3), m/s2, ground: minus the acceleration of their places
    axes: Array  # (n, m, 3, 3): of their segments, as rows
    spots: NDArray[np.intp]  # (m, 3): along the axes of their segments

    @classmethod
    def of(cls, white: White, left: Array, base: Base, markers: Sequence[str]) -> _Skin:
        numbers = {spot: k for k, spot in enumerate(base.spots)}
        known = [m for m in markers if m in white.look.item.markers and MarkerSpot(m, 0) in numbers]
        spots = np.array([[numbers[MarkerSpot(m, axis)] for axis in range(3)] for m in known], dtype=np.intp)
        item, rows = white.look.item, white.look.rows
        at = [item.markers.index(m) for m in known]
        pull, axes = compute_pull(item.places[:, at], item.step), place_in_segments(item, rows)[:, at]
        return cls(
            white=white,
            left=left,
            markers=tuple(known),
            pull=pull,
            axes=axes,
            spots=spots.reshape(-1, 3),
        )

    def move(self, pair: tuple[float, float]) -> dict[str, Array]:
        """What the swing of every marker does to the whitened residuals, (n, 3 m)."""
        if not len(self.spots):
            return {}
        look = self.white.look
        swing, _ = simulate_oscillator(self.pull, look.item.step, *pair)
        moved = np.matmul(self.axes, swing[look.rows][..., None])
        return {
            marker: np.einsum("na,nac->nc", moved[:, k, :, 0], self.white.columns[:, self.spots[k]])
            for k, marker in enumerate(self.markers)
        }


def _weigh(looks: Sequence[_Skin], groups: Sequence[Sequence[str]], pair: tuple[float, float]) -> Array:
    """Log Bayes factor of the swing of every group, levels of markers learnt anew beside it."""
    rests = []
    for look in looks:
        moved = look.move(pair)
        swings = [sum((moved[m] for m in group if m in moved), np.zeros_like(look.left)) for group in groups]
        rests.append((look.white, look.left - np.stack(swings)))
    return weigh_markers(rests) - weigh_markers([(look.white, look.left) for look in looks])


def _tune(
    looks: Sequence[_Skin], group: tuple[str, ...], pair: tuple[float, float]
) -> tuple[float, tuple[float, float]]:
    """The likeliest frequency and damping of a group, and its log Bayes factor there."""

    def turn_back(x: Array) -> tuple[float, float]:
        f, z = np.exp(x).tolist()
        return min(max(f, FREQUENCIES_HZ[0]), FREQUENCIES_HZ[1]), min(max(z, DAMPINGS[0]), DAMPINGS[1])

    def cost(x: Array) -> float:
        return -float(_weigh(looks, [group], turn_back(x))[0])

    found = scipy.optimize.minimize(
        cost, np.log(pair), method="Nelder-Mead", options={"xatol": 0.01, "fatol": 0.1, "maxfev": 60}
    )
    return -float(found.fun), turn_back(found.x)


EFFECTS = (
    Effect(
        kind=KIND,
        meaning="the skin under the marker oscillates when the segment accelerates",
        details=describe_shape,
    ),
)
