"""Curves over the gait cycle, each cycle on the same nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from scaling_service.core.errors import TrialUnusable
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.statistics.complete import ComparisonImpossible, checked

NODES = 101
"""0 to 100 % of the cycle, as Pataky's examples and published joint angles (Schwartz 2008: every 2 %)."""

FEWEST = 4
"""Frames in a cycle; chosen: a cubic through fewer would be no measurement."""


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """One curve per subject and method.

    Raises ValueMissing: a node that is not finite; subject, method and node are named.
    Raises ComparisonImpossible: fewer than two subjects, methods or nodes, or a shape that does not fit the
        names.
    """

    quantity: str  # What the curves are, such as a coordinate's name
    subjects: tuple[str, ...]
    methods: tuple[str, ...]
    # (n_subjects, n_methods, n_nodes): the first node is 0 % and the last 100 % of the cycle; any unit, the
    # tests have none
    values: Array

    def __post_init__(self) -> None:
        table = checked(self.values, self.subjects, self.methods, quantity=self.quantity, dimensions=3)
        if table.shape[2] < 2:
            raise ComparisonImpossible("a curve of one node is a scalar", field=self.quantity)
        object.__setattr__(self, "values", table)


def normalised_cycles(
    times: ArrayLike,
    values: ArrayLike,
    cycles: Sequence[tuple[float, float]],
    names: Sequence[str],
    *,
    trial: str,
    nodes: int = NODES,
) -> Array:
    """Cut cycles out of a recording and put each on the same nodes, by a cubic spline.

    ``times``: (n_frames,), s, increasing.
    ``values``: (n_frames, n_curves).
    ``cycles`` sequence of (start_s, end_s): they may overlap and need not fall on frames.
    ``names``: sequence of str, length n_curves.
    ``trial``: its name, for messages.
    ``nodes``: from 0 to 100 % of the cycle, both included.
    Returns (n_cycles, n_curves, nodes): the first two axes batch; units as given.
    Raises TrialUnusable: a cycle that ends before it starts, leaves the recording or has fewer than four
        frames, or a value within it (or in the frame at either side of it) that is not finite: gaps are not
        bridged.

    Examples
    --------
    >>> t = np.linspace(0.0, 2.0, 201)
    >>> cut = normalised_cycles(t, np.column_stack([t, t**2]), [(0.5, 1.5)], ("a", "b"), trial="walk")
    >>> cut.shape, [round(float(v), 6) for v in cut[0, 1, [0, 50, 100]]]
    ((1, 2, 101), [0.25, 1.0, 2.25])
    """
    clock, recorded = np.asarray(times, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if clock.ndim != 1 or recorded.shape != (len(clock), len(names)) or nodes < 2 or not len(clock):
        raise ValueError(
            f"values {recorded.shape} do not fit {len(clock)} times and {len(names)} names on {nodes} nodes"
        )
    curves = np.empty((len(cycles), len(names), nodes))
    for k, (start, end) in enumerate(cycles):
        rows = _rows(clock, start, end, trial)
        _refuse_gaps(clock[rows], recorded[rows], names, trial)
        curves[k] = CubicSpline(clock[rows], recorded[rows])(np.linspace(start, end, nodes)).T
    return curves


def _rows(times: Array, start: float, end: float, trial: str) -> slice:
    """The frames of a cycle with one beside each end that falls between two."""
    if not start < end:
        raise TrialUnusable(
            f"a cycle from {start:g} s to {end:g} s ends before it starts",
            file=trial,
            remedy="Check the events",
        )
    # Times in files are rounded: an event that is the last frame may lie a hair behind it.
    slack = 1e-6 * (times[-1] - times[0])
    if start < times[0] - slack or end > times[-1] + slack:
        raise TrialUnusable(
            f"the cycle from {start:g} s to {end:g} s leaves the recording "
            f"({times[0]:g} s to {times[-1]:g} s)",
            file=trial,
            remedy="Leave the cycle out",
        )
    first = max(int(np.searchsorted(times, start, side="right")) - 1, 0)
    last = min(int(np.searchsorted(times, end, side="left")), len(times) - 1)
    if last - first + 1 < FEWEST:
        raise TrialUnusable(
            f"the cycle from {start:g} s to {end:g} s has {last - first + 1} frames, and needs {FEWEST}",
            file=trial,
            remedy="Check the events",
        )
    return slice(first, last + 1)


def _refuse_gaps(times: Array, values: Array, names: Sequence[str], trial: str) -> None:
    gaps = np.argwhere(~np.isfinite(values))
    if len(gaps):
        row, column = gaps[0]
        raise TrialUnusable(
            f"'{names[column]}' has no value at {times[row]:g} s, within a cycle",
            file=trial,
            field=names[column],
            remedy="Leave the cycle out, or fill the markers' gap first",
        )
