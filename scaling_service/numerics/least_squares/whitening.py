"""Kinematic problems whose markers err together: what is known, and residuals as independent numbers.

``y = h(q, p) + e`` with errors that markers of one link share, and a Gaussian prior of the shared parameters,
of any covariance.
"""

from __future__ import annotations

import copy
import dataclasses
from collections import abc

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.numerics.least_squares.problem import find_seen
from scaling_service.numerics.multibody.tree import Tree


class GaussianPrior:
    """What is known of some numbers, gathered piece by piece in information form."""

    def __init__(self, names: abc.Sequence[str]) -> None:
        self.names = tuple(names)
        self._place = {name: k for k, name in enumerate(self.names)}
        self.precision = np.zeros((len(self.names),) * 2)
        self.pull = np.zeros(len(self.names))

    def add(self, rows: abc.Sequence[abc.Mapping[str, float]], mean: Array, covariance: Array) -> None:
        """Linear combinations of the numbers, each a mapping of name to weight, are Gaussian.

        ``mean``: (k,). ``covariance`` (k, k): positive definite.
        """
        used = list(dict.fromkeys(name for row in rows for name in row))
        at = [self._place[name] for name in used]
        weights = np.array([[row.get(name, 0.0) for name in used] for row in rows])
        informed = np.linalg.solve(covariance, np.column_stack([weights, mean]))
        self.precision[np.ix_(at, at)] += weights.T @ informed[:, :-1]
        self.pull[at] += weights.T @ informed[:, -1]

    def add_values(self, names: abc.Sequence[str], mean: Array, covariance: Array) -> None:
        """The numbers themselves, (k,), are Gaussian."""
        self.add([{name: 1.0} for name in names], mean, covariance)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ErrorGroup:
    """Markers of one link and the covariance of their errors in the link's frame.

    ``instrument``: variance of each number, m2, that is the cameras' and not the skin's; part of the whole.
    """

    markers: NDArray[np.intp]  # (m,): numbers of the tree's markers
    covariance: Array  # (3 m, 3 m), m2: marker by marker, x, y, z
    instrument: float = 0.0


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PosteriorProblem:
    """Markers of some frames, how they err, and what is known of the shared parameters."""

    tree: Tree
    measured: Array  # (n_frames, n_markers, 3), m: NaN where a marker was not seen
    shares: Array  # (n_frames,): how much of a frame says something of its own, 0 to 1
    coordinates: NDArray[np.intp]  # the coordinates to estimate
    groups: tuple[ErrorGroup, ...]
    prior: GaussianPrior  # of the tree's parameters, in their order
    # What is known of each frame's coordinates beside the markers, in information form: precision (n_frames,
    # n, n) and that times the mean (n_frames, n), of the coordinates to estimate
    held: tuple[Array, Array] | None = None
    # As ``held``: what parameters that were integrated over add to the cost, which is no information
    integrated: tuple[Array, Array] | None = None

    def in_frames(self, rows: slice | NDArray[np.intp]) -> PosteriorProblem:
        """The same in some frames."""
        held, integrated = (
            None if part is None else (part[0][rows], part[1][rows]) for part in (self.held, self.integrated)
        )
        measured, shares = self.measured[rows], self.shares[rows]
        return dataclasses.replace(self, measured=measured, shares=shares, held=held, integrated=integrated)

    def hold_once(self) -> PosteriorProblem:
        """With what is known of coordinates beside the markers said once over all frames, not once in each.

        Who carries a foot turned in does so in every frame: a range tells where a movement lies in it, and a
        hundred frames are no hundred words about what they share.
        """
        if self.held is None:
            return self
        share = self.shares / self.shares.sum()
        precision, pull = self.held
        return dataclasses.replace(self, held=(precision * share[:, None, None], pull * share[:, None]))


class Whitening:
    """Roots of the inverse covariances, for each pattern of markers that some frame shows.

    Whitened numbers stand group by group, as the roots mix what one group holds and nothing else.
    """

    def __init__(self, problem: PosteriorProblem) -> None:
        seen = find_seen(problem.measured)
        self._root = np.sqrt(problem.shares)
        self.parts: list[Part] = []
        start = 0
        for group in problem.groups:
            patterns, of_frame = np.unique(seen[:, group.markers], axis=0, return_inverse=True)
            roots = np.zeros((len(patterns), *group.covariance.shape))
            for root, pattern in zip(roots, patterns, strict=True):
                rows = np.flatnonzero(np.repeat(pattern, 3))
                if len(rows):
                    lower = np.linalg.cholesky(group.covariance[np.ix_(rows, rows)])
                    root[np.ix_(rows, rows)] = np.linalg.inv(lower)
            columns = slice(start, start + 3 * len(group.markers))
            self.parts.append(Part(group, of_frame.ravel(), roots, columns))
            start = columns.stop
        self._count = start

    def in_frames(self, rows: NDArray[np.intp]) -> Whitening:
        """The same of some frames."""
        found = copy.copy(self)
        found._root = self._root[rows]
        found.parts = [dataclasses.replace(part, of_frame=part.of_frame[rows]) for part in self.parts]
        return found

    def apply(self, axes: Array, link: NDArray[np.intp], vectors: Array) -> Array:
        """Vectors of markers in the room, (k, n_markers, 3, n), as independent numbers, (n, k, n_numbers).

        ``axes`` (n_links, 3, 3, n): rows are the links' axes. ``link``: of each marker.
        """
        count, n = len(vectors), vectors.shape[-1]
        result = np.empty((n, count, self._count))
        for part in self.parts:
            rotation = axes[link[part.group.markers[0]]]
            flat = np.einsum("jan,vman->nvmj", rotation, vectors[:, part.group.markers]).reshape(n, count, -1)
            alone = len(part.roots) == 1  # the frames need no choice, which copies them
            for pattern, root in enumerate(part.roots):
                rows = slice(None) if alone else np.flatnonzero(part.of_frame == pattern)
                result[rows, :, part.columns] = flat[rows] @ root.T
        result *= self._root[:, None, None]
        return result

    def apply_along(self, part: Part, gains: Array, rates: Array) -> Array:
        """Vectors along directions that stay in the link's frame, as independent numbers of the part.

        ``gains`` (k, 3 m): the directions. ``rates`` (k, n): how far. Returns (n, k, 3 m).
        """
        turned = np.einsum("pij,kj->pki", part.roots, gains)
        return np.asarray(turned[part.of_frame] * (rates.T * self._root[:, None])[:, :, None])

    def weigh_misfit(self, white: Array) -> tuple[float, float, float]:
        """Squares of whitened residuals as far as the groups' own errors rule them, beside the instrument's.

        The slope of the likelihood by the size of these errors has such weights: of a direction with the own
        variance s beside the instrument's n, s / (s + n). Returns the sum; the sum of the weights, which is
        what it is expected to be; and the number of residuals, each counted as its frame is.
        """
        misfit = weights = count = 0.0
        for part in self.parts:
            own, instrument = white[:, part.columns], part.group.instrument
            misfit += float(np.square(own).sum())
            for pattern, root in enumerate(part.roots):
                rows = part.of_frame == pattern
                misfit -= instrument * float(np.square(own[rows] @ root).sum())
                shown, share = float((np.diag(root) > 0.0).sum()), float(np.square(self._root[rows]).sum())
                weights += share * (shown - instrument * float(np.square(root).sum()))
                count += share * shown
        return misfit, weights, count


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One group in a whitening: the root of each pattern, the pattern of each frame, its numbers' columns."""

    group: ErrorGroup
    of_frame: NDArray[np.intp]
    roots: Array
    columns: slice
