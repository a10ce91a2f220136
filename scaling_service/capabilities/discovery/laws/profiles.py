"""How the value at a spot varies: not at all, with a coordinate, as oscillating skin, while a foot stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scaling_service.capabilities.discovery.observations.oscillator import (
    differentiate_places,
    simulate_oscillator,
)
from scaling_service.capabilities.discovery.observations.tracked import TrackedTrial
from scaling_service.model.body import Term
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import place_tree_markers
from scaling_service.numerics.signals.filters import filter_butterworth

_LOW = 0.05  # quantile of heights at which a segment stands
_NEAR_M = 0.015  # m; chosen: a foot that rolls over the floor keeps its middle so near its lowest
_RISES_M = 0.05  # m; chosen: a foot that steps rises more
_FLOOR_M = 0.2  # m; chosen: the middle of a standing foot's markers is lower


@dataclass(frozen=True, slots=True)
class Constant:
    """The same in all frames."""

    def values(self, item: TrackedTrial, _skin: Skin) -> Array:
        """In every frame, (n,)."""
        return np.ones(len(item.q))

    def term(self, gain: float) -> Term:
        """The profile times a gain, as a term of a law."""
        return Term(gain)


@dataclass(frozen=True, slots=True)
class Following:
    """In proportion to a coordinate (rad or m)."""

    coordinate: str

    def values(self, item: TrackedTrial, _skin: Skin) -> Array:
        """In every frame, (n,)."""
        return np.asarray(item.q[:, item.task.model.coordinate_names.index(self.coordinate)])

    def term(self, gain: float) -> Term:
        """The profile times a gain, as a term of a law."""
        return Term(gain, coordinate=self.coordinate)


@dataclass(frozen=True, slots=True)
class Oscillation:
    """The skin under a marker as an oscillator that its segment drives, along an axis of the segment (m)."""

    marker: str
    frequency_hz: float
    damping: float
    axis: int

    def values(self, item: TrackedTrial, skin: Skin) -> Array:
        """In every frame, (n,); zero without the marker."""
        return _of_marker(self.marker, self.axis, item, skin.local(self.frequency_hz, self.damping))


@dataclass(frozen=True, slots=True)
class Passing:
    """A marker's own velocity (``order`` 1, m/s) or acceleration (2, m/s2), along an axis of its segment."""

    marker: str
    order: int
    axis: int

    def values(self, item: TrackedTrial, skin: Skin) -> Array:
        """In every frame, (n,); zero without the marker."""
        return _of_marker(self.marker, self.axis, item, skin.passing(self.order))


@dataclass(frozen=True, slots=True)
class HighPassed:
    """What is faster than a frequency in a marker's own path (m), along an axis of its segment."""

    marker: str
    frequency_hz: float
    axis: int

    def values(self, item: TrackedTrial, skin: Skin) -> Array:
        """In every frame, (n,); zero without the marker."""
        return _of_marker(self.marker, self.axis, item, skin.high_passed(self.frequency_hz))


@dataclass(frozen=True, slots=True)
class Standing:
    """The time since the segment with these markers came to stand on the floor, zero off it (s)."""

    markers: tuple[str, ...]

    def values(self, item: TrackedTrial, _skin: Skin) -> Array:
        """In every frame, (n,)."""
        height = _measure_height(item, self.markers)
        down = height < np.quantile(height, _LOW) + _NEAR_M
        frames = np.arange(len(down))
        last_up = np.maximum.accumulate(np.where(down, -1, frames))
        return np.where(down, (frames - last_up) * item.step, 0.0)


Profile = Constant | Following | Oscillation | Passing | HighPassed | Standing
ALWAYS = Constant()


def _of_marker(marker: str, axis: int, item: TrackedTrial, moved: Array) -> Array:
    """What one of all markers (n, n_markers, 3) does along an axis, (n,); zero where it is not tracked."""
    if marker not in item.markers:
        return np.zeros(len(item.q))
    return np.asarray(moved[:, item.markers.index(marker), axis])


class Skin:
    """Skin of one recording as oscillators that its segments drive: ``u'' + 2 z w u' + w^2 u = -a``."""

    def __init__(self, item: TrackedTrial) -> None:
        self._item = item
        self._moved: dict[tuple[float, float], Array] = {}
        self._passing: dict[int, Array] = {}
        self._high_passed: dict[float, Array] = {}

    @cached_property
    def _places_and_axes(self) -> tuple[Array, Array]:
        """Of every marker, (n, n_markers, 3), ground; its segment's axes."""
        tree, poses = self._item.task.tree, self._item.poses
        return np.moveaxis(place_tree_markers(tree, poses), -1, 0), poses.axes[tree.marker_link]

    @cached_property
    def _rates_and_axes(self) -> tuple[Array, Array, Array]:
        """Velocity and acceleration under every marker, (n, n_markers, 3), ground; its segment's axes."""
        places, axes = self._places_and_axes
        return *differentiate_places(places, self._item.step), axes

    def passing(self, order: int) -> Array:
        """Rates of this order under every marker, (n, n_markers, 3), in the axes of its segment."""
        if order not in self._passing:
            *rates, axes = self._rates_and_axes
            self._passing[order] = np.asarray(np.einsum("majn,nmj->nma", axes, rates[order - 1]))
        return self._passing[order]

    def high_passed(self, frequency_hz: float) -> Array:
        """What is faster than a frequency in every marker's path, (n, n_markers, 3), m, as ``passing``."""
        if frequency_hz not in self._high_passed:
            places, axes = self._places_and_axes
            slow = filter_butterworth(
                places.reshape(len(places), -1),
                rate_hz=1.0 / self._item.step,
                cutoff_hz=frequency_hz,
                order=4,
            ).values
            left = places - slow.reshape(places.shape)
            self._high_passed[frequency_hz] = np.asarray(np.einsum("majn,nmj->nma", axes, left))
        return self._high_passed[frequency_hz]

    def local(self, frequency_hz: float, damping: float) -> Array:
        """How far every marker moves, steady at first, (n, n_markers, 3), m, in the axes of its segment."""
        pair = (frequency_hz, damping)
        if pair not in self._moved:
            _, acceleration, axes = self._rates_and_axes
            moved = simulate_oscillator(-acceleration, self._item.step, frequency_hz, damping)[0]
            self._moved[pair] = np.asarray(np.einsum("majn,nmj->nma", axes, moved))
        return self._moved[pair]


def evaluate_profiles(profiles: Sequence[Profile], item: TrackedTrial) -> Array:
    """Profiles in every frame of a recording, (n_profiles, n_frames)."""
    skin = Skin(item)
    found = np.ones((len(profiles), len(item.q)))
    for k, profile in enumerate(profiles):
        found[k] = profile.values(item, skin)
    return found


def is_stance(item: TrackedTrial, markers: Sequence[str]) -> bool:
    """Whether a segment with these markers comes down to the floor and leaves it again."""
    height = _measure_height(item, markers)
    low = float(np.quantile(height, _LOW))
    return low < _FLOOR_M and float(height.max()) - low > _RISES_M


def _measure_height(item: TrackedTrial, markers: Sequence[str]) -> Array:
    """Of the middle of the markers, (n,), m."""
    at = [item.markers.index(m) for m in markers if m in item.markers]
    return np.asarray(item.places[:, at, 1].mean(axis=1)) if at else np.zeros(len(item.q))
