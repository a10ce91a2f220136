"""Curves over the gait cycle, each cycle on the same nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import scipy
from numpy.typing import ArrayLike

from scaling_service.core.arrays import Array
from scaling_service.core.errors import TrialUnusable
from scaling_service.numerics.statistics import complete, permutation_tests

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
        table = complete.require_complete(
            self.values, self.subjects, self.methods, quantity=self.quantity, dimensions=3
        )
        if table.shape[2] < 2:
            raise complete.ComparisonImpossible("a curve of one node is a scalar", field=self.quantity)
        object.__setattr__(self, "values", table)


def normalise_cycles(
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
    >>> cut = normalise_cycles(t, np.column_stack([t, t**2]), [(0.5, 1.5)], ("a", "b"), trial="walk")
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
        rows = _select_rows(clock, start, end, trial)
        gaps = np.argwhere(~np.isfinite(recorded[rows]))
        if len(gaps):
            row, column = gaps[0]
            raise TrialUnusable(
                f"'{names[column]}' has no value at {clock[rows][row]:g} s, within a cycle",
                file=trial,
                field=names[column],
                remedy="Leave the cycle out, or fill the markers' gap first",
            )
        curves[k] = scipy.interpolate.CubicSpline(clock[rows], recorded[rows])(
            np.linspace(start, end, nodes)
        ).T
    return curves


def _select_rows(times: Array, start: float, end: float, trial: str) -> slice:
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


@dataclass(frozen=True, slots=True)
class WaveformSettings:
    """How curves are compared.

    The analysis of variance exchanges labels within subjects, which supposes, like the parametric test, that
    methods scatter alike; where one scatters three times as much as four others it finds a difference of
    means that is not there in 25 % of cohorts (the parametric test: 23 %). The paired tests exchange signs.
    """

    alpha: float = 0.05  # Chance of any false finding along a curve; shared by the pairs
    # All are taken where they are no more than this, else so many are drawn. Chosen: with 10,000 the level
    # reached has a standard error of 0.2 % at 5 %.
    rearrangements: int = 10_000

    def __post_init__(self) -> None:
        if not 0.0 < self.alpha < 1.0:
            raise complete.ComparisonImpossible(
                f"a significance level of {self.alpha:g} is not between 0 and 1", field="alpha"
            )
        if self.rearrangements < 2:
            raise complete.ComparisonImpossible(
                "a permutation test needs at least two rearrangements", field="rearrangements"
            )


@dataclass(frozen=True, slots=True, eq=False)
class PairedCurves:
    """Two methods along the cycle.

    ``difference_mean`` and ``difference_sd`` (n - 1), shape (n_nodes,), are of the first method minus the
    second over the subjects, in the quantity's unit; a positive t says that the first is larger.
    """

    methods: tuple[str, str]
    difference_mean: Array
    difference_sd: Array
    test: permutation_tests.CurveTest


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WaveformComparison:
    """A curve compared between methods over a cohort.

    ``anova``: between all methods; between two it is the square of their t.
    ``pairs``: empty unless ``anova`` is significant: the post hoc tests are gated by it, as in the paper.
    ``n_pairs``: by which alpha was divided.
    """

    quantity: str
    subjects: tuple[str, ...]
    methods: tuple[str, ...]
    anova: permutation_tests.CurveTest
    pairs: tuple[PairedCurves, ...]
    n_pairs: int

    def pair(self, method: str, reference: str) -> PairedCurves:
        """The pair of two methods, in either order (KeyError if it was not tested)."""
        for pair in self.pairs:
            if set(pair.methods) == {method, reference}:
                return pair
        raise KeyError((method, reference))


def compare_waveforms(
    curves: Curves,
    rng: np.random.Generator,
    *,
    reference: str | None = None,
    settings: WaveformSettings | None = None,
) -> WaveformComparison:
    """Compare curves between methods: analysis of variance, then paired tests where it is significant.

    ``curves``: one per subject and method: several cycles of a subject are averaged before, for they are not
        independent.
    ``rng``: used only where rearrangements are too many to take all.
    ``reference``: only the pairs with this method are tested, and alpha is shared by those; else all pairs.
    Raises ComparisonImpossible: a reference that is not among the methods.

    Examples
    --------
    >>> from scaling_service.core.streams import stream
    >>> bump = np.exp(-0.5 * ((np.arange(101) - 50) / 8) ** 2)
    >>> rng = stream(1, "example")
    >>> noise = rng.normal(size=(9, 2, 1)) * np.cos(np.arange(101) / 20)
    >>> values = noise + np.stack([0 * bump, 9 * bump])
    >>> found = compare_waveforms(Curves("knee", tuple("abcdefghi"), ("MB", "EB"), values), rng)
    >>> found.anova.significant, len(found.pair("MB", "EB").test.clusters)
    (True, 1)
    """
    chosen = settings or WaveformSettings()
    if reference is None:
        pairs = list(combinations(curves.methods, 2))
    else:
        if reference not in curves.methods:
            raise complete.ComparisonImpossible(
                f"the reference '{reference}' is not among the methods {', '.join(curves.methods)}",
                field=curves.quantity,
                remedy="Name one of them",
            )
        pairs = [(method, reference) for method in curves.methods if method != reference]
    anova = analyse_repeated_measures(curves.values, rng, chosen)
    tested = pairs if anova.significant else []
    return WaveformComparison(
        quantity=curves.quantity,
        subjects=curves.subjects,
        methods=curves.methods,
        anova=anova,
        pairs=tuple(_compare_pair(curves, *pair, len(pairs), rng, chosen) for pair in tested),
        n_pairs=len(pairs),
    )


def analyse_repeated_measures(
    values: Array, rng: np.random.Generator, settings: WaveformSettings | None = None
) -> permutation_tests.CurveTest:
    """One-way analysis of variance with repeated measures along curves, by exchange within subjects.

    ``values`` (n_subjects, n_conditions, n_nodes): complete: use ``Curves`` to make sure.
    """
    chosen = settings or WaveformSettings()
    statistic = permutation_tests.RepeatedMeasuresF(values)
    n, k = values.shape[:2]
    rearranged = permutation_tests.draw_orders(n, k, chosen.rearrangements, rng)
    return permutation_tests.assess_curve(
        "F", statistic, statistic.degrees_of_freedom, rearranged, chosen.alpha
    )


def compare_paired(
    first: Array,
    second: Array,
    rng: np.random.Generator,
    settings: WaveformSettings | None = None,
    *,
    n_tests: int = 1,
) -> permutation_tests.CurveTest:
    """Paired two-tailed t test along curves, by exchange of signs.

    ``first``, ``second``: (n_subjects, n_nodes).
    ``n_tests``: alpha is divided by it (Bonferroni).
    """
    chosen = settings or WaveformSettings()
    scale = float(max(np.abs(first).max(), np.abs(second).max()))
    statistic = permutation_tests.PairedT(first - second, scale)
    rearranged = permutation_tests.draw_signs(len(first), chosen.rearrangements, rng)
    return permutation_tests.assess_curve(
        "t", statistic, statistic.degrees_of_freedom, rearranged, chosen.alpha / n_tests
    )


def _compare_pair(
    curves: Curves,
    first: str,
    second: str,
    n_pairs: int,
    rng: np.random.Generator,
    settings: WaveformSettings,
) -> PairedCurves:
    ours, theirs = (curves.values[:, curves.methods.index(name)] for name in (first, second))
    difference = ours - theirs
    return PairedCurves(
        methods=(first, second),
        difference_mean=difference.mean(axis=0),
        difference_sd=difference.std(axis=0, ddof=1),
        test=compare_paired(ours, theirs, rng, settings, n_tests=n_pairs),
    )
