"""Markers that glide on their segments: shared shifts along the segments' axes, each times a known signal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.mechanism import Mechanism
from scaling_service.numerics.multibody.screws import Screws
from scaling_service.numerics.multibody.spatial import Moving
from scaling_service.numerics.multibody.tree import Tree, cross


@dataclass(frozen=True, slots=True, eq=False)
class MarkerShifts:
    """Shared numbers ``x``, each of which moves one marker by ``x * sd * signal(t)`` along one local axis."""

    # marker, axis, signal: (k,)
    marker: NDArray[np.intp]
    axis: NDArray[np.intp]
    signal: NDArray[np.intp]
    sd: Array  # (k,), m: the shift for x = 1 where the signal is one
    signals: Array  # (3, n, n_signals): with their first and second rates

    @property
    def count(self) -> int:
        """How many shared numbers there are."""
        return len(self.sd)

    def rows(self, rows: slice) -> MarkerShifts:
        """Only these frames."""
        return MarkerShifts(self.marker, self.axis, self.signal, self.sd, self.signals[:, rows])

    def columns(self, tree: Tree, state: Moving) -> Array:
        """Shifts per unit of each number, and their rates, (k, n, 9)."""
        link = tree.marker_link[self.marker]
        axes = state.poses.axes[link, self.axis]  # (k, 3, n)
        spin, pace = state.twists[link, 3:], state.accelerations[link, 3:]
        turned = cross(spin, axes)
        bent = cross(pace, axes) + cross(spin, turned)
        value, rate, second = ((self.sd * part[:, self.signal]).T[:, None] for part in self.signals)
        found = np.empty((self.count, 9, value.shape[2]))
        found[:, :3] = axes * value
        found[:, 3:6] = turned * value + axes * rate
        found[:, 6:] = bent * value + 2.0 * turned * rate + axes * second
        return np.ascontiguousarray(found.transpose(0, 2, 1))

    def moved(self, columns: Array, x: Array, count: int) -> Array:
        """How far ``count`` markers are shifted, (3, n, count, 3)."""
        total = np.zeros((count, *columns.shape[1:]))
        for k, marker in enumerate(self.marker.tolist()):
            total[marker] += x[k] * columns[k]
        return total.reshape(count, -1, 3, 3).transpose(2, 1, 0, 3)


@dataclass(frozen=True, slots=True, eq=False)
class ShiftNormal:
    """Normal equations of the shared numbers."""

    gradient: Array  # (k,): half of it
    corner: Array  # (k, k)
    cross: Array  # (n, 3, m, k): coupling with q, qdot and qddot of every frame


def shift_normal(
    shifts: MarkerShifts,
    mechanism: Mechanism,
    tree: Tree,
    screws: Screws,
    rows: Array,
    columns: Array,
    gap: Array,
    weights: Array,
    m: int,
) -> ShiftNormal:
    """What markers say of the shared numbers, and how these go with the motion.

    ``rows`` (n, n_markers, 9, 18): as ``rows_of_twists`` gives them for the shifted markers.
    ``columns``: (k, n, 9).
    ``gap``: (3, n, n_markers, 3).
    ``weights``: (3, n, n_markers).
    ``m``: the number of free coordinates.
    """
    n, marker = columns.shape[1], shifts.marker
    gaps = np.ascontiguousarray(gap.transpose(2, 1, 0, 3)).reshape(-1, n, 9)
    spread = np.repeat(weights.transpose(2, 1, 0), 3, axis=2)  # (n_markers, n, 9)
    gradient, corner = np.empty(shifts.count), np.zeros((shifts.count, shifts.count))
    pushed = np.empty((n, shifts.count, 18))
    for one in np.unique(marker):
        own = np.flatnonzero(marker == one)
        heavy = columns[own] * spread[one]
        flat = heavy.reshape(len(own), -1)
        gradient[own] = -flat @ gaps[one].ravel()
        corner[np.ix_(own, own)] = flat @ columns[own].reshape(len(own), -1).T
        pushed[:, own] = heavy.swapaxes(0, 1) @ rows[:, one]
    below = mechanism.carriers[screws.entries][:, tree.marker_link[marker]] > 0.0
    by = np.ascontiguousarray(screws.variations().transpose(3, 0, 2, 1))  # (n, e, 3, 18)
    coupling = np.zeros((n, 3, m, shifts.count))
    for e, column in enumerate(screws.columns.tolist()):
        some = np.flatnonzero(below[e])
        if len(some):
            coupling[:, :, column, some] += by[:, e] @ pushed[:, some].swapaxes(1, 2)
    return ShiftNormal(gradient, corner, coupling)
