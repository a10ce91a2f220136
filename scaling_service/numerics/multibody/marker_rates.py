"""Normal equations of marker positions, velocities and accelerations in q, qdot and qddot.

A marker on a link that is varied by the twist xi = (v, w) moves by ``v + w x r``; rates follow by
differentiating. All markers of a link are thus quadratic in the 18 numbers (xi, xi', xi''): they are summed
on the link and up the tree, and projected on the joints last. Markers may also glide on their segments:
shared shifts along the segments' axes, each times a known signal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.numerics.multibody import motion
from scaling_service.numerics.multibody.rigid import build_skew
from scaling_service.numerics.multibody.tree import Tree, cross, evaluate_local_positions


@dataclass(frozen=True, slots=True, eq=False)
class MarkerTargets:
    """What markers should do, frames first."""

    values: Array  # (3, n, n_markers, 3), m, m/s, m/s2: positions, velocities, accelerations
    weights: Array  # (3, n, n_markers): of the squares; zero where nothing is known

    def rows(self, rows: slice) -> MarkerTargets:
        """Only these frames."""
        return MarkerTargets(self.values[:, rows], self.weights[:, rows])


def compute_marker_motion(tree: Tree, p: Array, state: motion.LinkMotion) -> Array:
    """Positions, velocities and accelerations of a tree's markers, (3, n, n_markers, 3).

    ``tree``: with the links of the mechanism that moved.
    ``p``: (n_parameters,).
    """
    link, local = tree.marker_link, evaluate_local_positions(tree, p)
    at = np.einsum("mjan,mjn->man", state.poses.axes[link], local) + state.poses.origins[link]
    speed = motion.point_velocity(state.twists[link], at)
    acceleration = motion.point_acceleration(state.twists[link], state.accelerations[link], at)
    return np.ascontiguousarray(np.stack([at, speed, acceleration]).transpose(0, 3, 1, 2))


def compute_marker_misfit(moved: Array, targets: MarkerTargets) -> tuple[Array, Array]:
    """Gaps (3, n, n_markers, 3), zero where unknown, and the weighted squares' sums, (3,)."""
    gap = np.where(targets.weights[..., None] > 0.0, targets.values - moved, 0.0)
    return gap, np.einsum("onm,onma->o", targets.weights, gap**2)


def form_normal_equations(
    mechanism: motion.Mechanism,
    tree: Tree,
    screws: motion.Screws,
    rows: Array,
    gap: Array,
    weights: Array,
    m: int,
) -> tuple[Array, Array]:
    """Half the gradient and the Gauss-Newton matrix of the weighted squares, by frame.

    ``tree``: with the markers.
    ``screws``: of the mechanism's free coordinates.
    ``rows`` (n, n_markers, 9, 18): as :func:`list_twist_rows` gives them.
    ``gap``: (3, n, n_markers, 3).
    ``weights``: (3, n, n_markers).
    ``m``: the number of free coordinates.
    Returns ``gradient``: (n, 3, m).
    ``curvature``: (n, 3, 3, m, m).
    """
    # Moments (n, n_links, 18, 18) and pulls (n, n_links, 18) of the markers on each link
    n = len(rows)
    heavy = np.repeat(np.moveaxis(weights, 0, -1), 3, axis=-1)  # (n, n_markers, 9)
    gaps = np.moveaxis(gap, 0, 2).reshape(n, -1, 9)
    moments, pulls = np.zeros((n, mechanism.n_links, 18, 18)), np.zeros((n, mechanism.n_links, 18))
    for k, markers in enumerate(tree.marker_rows):
        if len(markers):
            some = rows[:, markers].reshape(n, -1, 18)
            weighed = some * heavy[:, markers].reshape(n, -1, 1)
            turned = np.swapaxes(weighed, 1, 2)
            moments[:, k] = turned @ some
            pulls[:, k] = (turned @ gaps[:, markers].reshape(n, -1, 1))[..., 0]
    below = mechanism.carriers[screws.entries]
    composite = np.einsum("ek,nkcd->necd", below, moments, optimize=True)
    pull = np.einsum("ek,nkc->nec", below, pulls, optimize=True)
    by = np.ascontiguousarray(screws.variations().transpose(3, 0, 1, 2))  # (n, e, 18, 3)
    # From twists to coordinates; two entries meet where one carries the other.
    count = by.shape[1]
    gradient = np.zeros((n, 3, m))
    for e, column in enumerate(screws.columns.tolist()):
        gradient[:, :, column] -= np.einsum("nci,nc->ni", by[:, e], pull[:, e])
    curvature = np.zeros((n, m, 3, m, 3))
    inside = below @ below.T == below.sum(axis=1)  # [e, f]: all below f is below e
    pushed = composite @ by  # (n, e, 18, 3)
    for f in range(count):
        above = np.flatnonzero(inside[:, f])
        twins = inside[f, above]  # the same links below: met twice
        blocks = by[:, above].reshape(n, len(above), 18, 3).transpose(0, 1, 3, 2).reshape(n, -1, 18)
        product = (blocks @ pushed[:, f]).reshape(n, len(above), 3, 3)
        for row, e in enumerate(above.tolist()):
            a, b = screws.columns[e], screws.columns[f]
            curvature[:, a, :, b, :] += product[:, row]
            if not twins[row]:
                curvature[:, b, :, a, :] += np.swapaxes(product[:, row], 1, 2)
    return gradient, np.ascontiguousarray(curvature.transpose(0, 2, 4, 1, 3))


def list_twist_rows(moved: Array) -> Array:
    """How twists and their rates move markers and their rates, (n, n_markers, 9, 18)."""
    n, count = moved.shape[1:3]
    rows = np.zeros((n, count, 9, 18))
    at, speed, acceleration = (-build_skew(part) for part in moved)
    for order in range(3):
        own = slice(3 * order, 3 * order + 3)
        rows[:, :, own, 6 * order : 6 * order + 3] = np.eye(3)
        rows[:, :, own, 6 * order + 3 : 6 * order + 6] = at
    rows[:, :, 3:6, 3:6] = speed
    rows[:, :, 6:9, 3:6] = acceleration
    rows[:, :, 6:9, 9:12] = 2.0 * speed
    return rows


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
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
        return MarkerShifts(
            marker=self.marker, axis=self.axis, signal=self.signal, sd=self.sd, signals=self.signals[:, rows]
        )

    def columns(self, tree: Tree, state: motion.LinkMotion) -> Array:
        """Shifts per unit of each number, and their rates, (k, n, 9)."""
        link = tree.marker_link[self.marker]
        axes = state.poses.axes[link, self.axis]  # (k, 3, n)
        omega, alpha = state.twists[link, 3:], state.accelerations[link, 3:]
        turned = cross(omega, axes)
        bent = cross(alpha, axes) + cross(omega, turned)
        value, rate, second = ((self.sd * part[:, self.signal]).T[:, None] for part in self.signals)
        found = np.empty((self.count, 9, value.shape[2]))
        found[:, :3] = axes * value
        found[:, 3:6] = turned * value + axes * rate
        found[:, 6:] = bent * value + 2.0 * turned * rate + axes * second
        return np.ascontiguousarray(found.transpose(0, 2, 1))

    def move(self, columns: Array, x: Array, count: int) -> Array:
        """How far ``count`` markers are shifted, (3, n, count, 3)."""
        total = np.zeros((count, *columns.shape[1:]))
        for k, marker in enumerate(self.marker.tolist()):
            total[marker] += x[k] * columns[k]
        return total.reshape(count, -1, 3, 3).transpose(2, 1, 0, 3)


def shift_normal(
    shifts: MarkerShifts,
    mechanism: motion.Mechanism,
    tree: Tree,
    screws: motion.Screws,
    rows: Array,
    columns: Array,
    gap: Array,
    weights: Array,
    m: int,
) -> tuple[Array, Array, Array]:
    """Normal equations of the shared numbers: what markers say of them, and how they go with the motion.

    ``rows`` (n, n_markers, 9, 18): as ``rows_of_twists`` gives them for the shifted markers.
    ``columns``: (k, n, 9).
    ``gap``: (3, n, n_markers, 3).
    ``weights``: (3, n, n_markers).
    ``m``: the number of free coordinates.
    Returns half the gradient (k,), the curvature (k, k), and the coupling with q, qdot and qddot of every
        frame (n, 3, m, k).
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
    return gradient, corner, coupling
