"""One number per subject and method, compared over a cohort: Friedman's test and Tukey's HSD on ranks.

Puchaud 2019 (section 2.3) compares segment lengths and kinematic errors of the models so. The post hoc
test is Tukey's honestly significant difference applied to the mean ranks, with infinite degrees of
freedom because the variance of ranks is known, not estimated: what MATLAB's ``multcompare`` does after
``friedman``, known elsewhere as Nemenyi's or the Wilcoxon-Nemenyi-McDonald-Thompson test (Hollander &
Wolfe 1999, Nonparametric Statistical Methods, 2nd ed., section 7.3).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from types import MappingProxyType

import numpy as np
import scipy
from numpy.typing import ArrayLike

from scaling_service.capabilities.cohort.summary import MethodSummary, SubjectSummary
from scaling_service.model.results import Array
from scaling_service.numerics.statistics.complete import ComparisonImpossible, Panel, checked, panels, rows

SAME = 1e-9
"""Relative to the largest value: chosen. Two methods that must give one length (marker-based scaling,
and its optimisation of axes and markers only) reach it by different sums; nine digits call it a tie,
where rounding errors would be ranked otherwise."""


@dataclass(frozen=True, slots=True)
class RankedPair:
    """Two methods after Friedman's test; differences are the first's minus the second's over the subjects."""

    methods: tuple[str, str]
    difference_mean: float
    difference_sd: float
    difference_median: float
    rank_difference: float  # of mean ranks; rank 1 is the smallest value
    q: float  # the studentized range statistic of that difference
    p: float  # family-wise over all pairs (Tukey's HSD)
    significant: bool  # p < alpha, and Friedman's test itself significant: it gates the post hoc test


@dataclass(frozen=True, slots=True)
class GroupComparison:
    """A quantity compared between methods over a cohort; mappings are of method to value over subjects."""

    quantity: str
    subjects: tuple[str, ...]
    methods: tuple[str, ...]
    mean: Mapping[str, float]
    sd: Mapping[str, float]  # n - 1
    median: Mapping[str, float]
    mean_rank: Mapping[str, float]
    chi_square: float  # Friedman's statistic, corrected for ties
    degrees_of_freedom: int
    p: float  # from the chi-square distribution, as in MATLAB; approximate for few subjects
    kendall_w: float  # 0 where subjects rank the methods without agreement, 1 where all rank them alike
    rank_difference_critical: float  # mean ranks further apart differ; 0 where all subjects tie all methods
    alpha: float
    pairs: tuple[RankedPair, ...]  # all, in the methods' order

    @property
    def significant(self) -> bool:
        """Whether Friedman's test finds a difference between any methods."""
        return self.p < self.alpha

    def pair(self, method: str, reference: str) -> RankedPair:
        """The pair of two methods, in either order (KeyError if there is none)."""
        for pair in self.pairs:
            if set(pair.methods) == {method, reference}:
                return pair
        raise KeyError((method, reference))

    def against(self, reference: str) -> dict[str, RankedPair]:
        """Each other method's pair with a reference."""
        return {m: self.pair(m, reference) for m in self.methods if m != reference}


def compare_groups(
    values: Mapping[str, Mapping[str, float]], methods: Sequence[str], *, quantity: str, alpha: float = 0.05
) -> GroupComparison:
    """Compare a quantity between methods, given as ``{subject: {method: value}}``.

    Raises
    ------
    ValueMissing
        A subject lacks a method, or its value is not finite; both are named.
    ComparisonImpossible
        Fewer than two subjects or methods.

    Examples
    --------
    >>> lengths = {f"S{k}": {"MB": 0.43 + k / 100, "EB": 0.42 + k / 90, "MB_lam": 0.44 + k / 80}
    ...            for k in range(9)}
    >>> found = compare_groups(lengths, ("MB", "EB", "MB_lam"), quantity="femur_r")
    >>> round(found.chi_square, 6), found.significant, found.pair("EB", "MB_lam").significant
    (18.0, True, True)
    """
    subjects, table = rows(values, methods, quantity=quantity)
    return compare_columns(table, subjects, methods, quantity=quantity, alpha=alpha)


def compare_columns(
    values: ArrayLike, subjects: Sequence[str], methods: Sequence[str], *, quantity: str, alpha: float = 0.05
) -> GroupComparison:
    """As :func:`compare_groups`, from an array of shape (n_subjects, n_methods)."""
    if not 0.0 < alpha < 1.0:
        raise ComparisonImpossible(f"a significance level of {alpha:g} is not between 0 and 1", field="alpha")
    table = checked(values, subjects, methods, quantity=quantity, dimensions=2)
    n, k = table.shape
    ranks = scipy.stats.rankdata(_without_noise(table), axis=1)
    mean_rank = ranks.mean(axis=0)
    # The variance of one subject's ranks: k (k + 1) / 12 without ties, less with them.
    variance = float(np.sum((ranks - (k + 1) / 2) ** 2)) / (n * (k - 1))
    spread = n * float(np.sum((mean_rank - (k + 1) / 2) ** 2))
    statistic = spread / variance if variance > 0.0 else 0.0
    p = float(scipy.stats.chi2.sf(statistic, k - 1))
    error = float(np.sqrt(variance / n))
    return GroupComparison(
        quantity=quantity,
        subjects=tuple(subjects),
        methods=tuple(methods),
        mean=_named(methods, table.mean(axis=0)),
        sd=_named(methods, table.std(axis=0, ddof=1)),
        median=_named(methods, np.median(table, axis=0)),
        mean_rank=_named(methods, mean_rank),
        chi_square=statistic,
        degrees_of_freedom=k - 1,
        p=p,
        kendall_w=statistic / (n * (k - 1)),
        rank_difference_critical=float(scipy.stats.studentized_range.isf(alpha, k, np.inf)) * error,
        alpha=alpha,
        pairs=_pairs(table, mean_rank, error, methods, alpha, gate=p < alpha),
    )


def _pairs(
    table: Array, mean_rank: Array, error: float, methods: Sequence[str], alpha: float, *, gate: bool
) -> tuple[RankedPair, ...]:
    """Tukey's HSD on mean ranks whose standard error is known."""
    first, second = np.array(list(combinations(range(len(methods)), 2))).T
    apart = mean_rank[first] - mean_rank[second]
    q = np.abs(apart) / error if error > 0.0 else np.zeros(len(first))
    p = scipy.stats.studentized_range.sf(q, len(methods), np.inf)
    differences = table[:, first] - table[:, second]
    return tuple(
        RankedPair(
            methods=(methods[first[i]], methods[second[i]]),
            difference_mean=float(differences[:, i].mean()),
            difference_sd=float(differences[:, i].std(ddof=1)),
            difference_median=float(np.median(differences[:, i])),
            rank_difference=float(apart[i]),
            q=float(q[i]),
            p=float(p[i]),
            significant=bool(gate and p[i] < alpha),
        )
        for i in range(len(first))
    )


def _without_noise(table: Array) -> Array:
    """Values rounded so that equal results reached by different routes are ties."""
    step = SAME * float(np.abs(table).max())
    return np.round(table / step) if step > 0.0 else table


def _named(methods: Sequence[str], values: Array) -> dict[str, float]:
    return {method: float(value) for method, value in zip(methods, values, strict=True)}


@dataclass(frozen=True, slots=True)
class ScalarComparison:
    """One number per subject and method, m or rad, over those who have all of a panel's methods."""

    kind: str  # a key of KINDS
    quantity: str  # femur_r, evaluation …
    panel: Panel
    values: Mapping[str, Mapping[str, float]]  # subject to method to value, of the panel
    mean: Mapping[str, float]
    sd: Mapping[str, float]  # n - 1; empty for a single subject
    test: GroupComparison | None  # Friedman's with Tukey's HSD
    note: str = ""  # why there is no test


def _errors(method: MethodSummary) -> dict[str, float]:
    """Mean kinematic error over the trials of each role, every trial counting the same, m.

    Chosen: Puchaud 2019 defines the error of a trial, and does not say how trials are pooled.
    """
    by_role: dict[str, list[float]] = {}
    for trial in method.trials.values():
        if np.isfinite(trial.mean):
            by_role.setdefault(trial.role, []).append(trial.mean)
    return {role: float(np.mean(errors)) for role, errors in by_role.items()}


def _axes(method: MethodSummary) -> dict[str, float]:
    return {
        f"{side}_{axis}": turn
        for side, turns in method.knee_axes.items()
        for axis, turn in zip("xy", turns, strict=True)
    }


def _shift(method: MethodSummary) -> dict[str, float]:
    shifts = list(method.marker_shifts.values())
    return {"mean_over_markers": float(np.mean(shifts))} if shifts else {}


KINDS: Mapping[str, Callable[[MethodSummary], Mapping[str, float]]] = MappingProxyType(
    {
        "segment_length": lambda method: method.lengths,
        "kinematic_error": _errors,
        "knee_axis": _axes,
        "marker_shift": _shift,
        "from_truth_m": lambda method: method.from_truth_m,
        "from_truth_rad": lambda method: method.from_truth_rad,
    }
)
"""Kind of quantity to where a method's summary holds it; ``knee_axis`` and ``from_truth_rad`` are in rad, the
others in m."""


def compare_scalars(
    subjects: Sequence[SubjectSummary], methods: Sequence[str], alpha: float
) -> Iterator[ScalarComparison]:
    """Every quantity of every kind, over every panel that the cohort allows.

    ``alpha`` is of each test: quantities are not corrected for each other, as in Puchaud 2019 (section 2.3).
    """
    import pandas  # only here and after all work: it takes half a second

    long = pandas.DataFrame(
        (
            (kind, quantity, s.subject, name, value)
            for kind, read in KINDS.items()
            for s in subjects
            for name, method in s.methods.items()
            for quantity, value in read(method).items()
        ),
        columns=["kind", "quantity", "subject", "method", "value"],
    )
    for (kind, quantity), found in long.groupby(["kind", "quantity"], sort=False):
        table = found.pivot(index="subject", columns="method", values="value")
        table = table.replace([np.inf, -np.inf], np.nan).reindex([s.subject for s in subjects])
        has = {subject: list(row.dropna().index) for subject, row in table.iterrows()}
        for panel in panels(has, methods):
            part = table.loc[list(panel.subjects), list(panel.methods)]
            values, note = part.to_dict("index"), too_few(panel)
            yield ScalarComparison(
                kind=kind,
                quantity=quantity,
                panel=panel,
                values=values,
                mean=part.mean().to_dict(),
                sd=part.std().to_dict() if len(part) > 1 else {},
                test=None if note else compare_groups(values, panel.methods, quantity=quantity, alpha=alpha),
                note=note,
            )


def too_few(panel: Panel) -> str:
    """Why a panel cannot be tested; empty where it can."""
    if len(panel.methods) < 2:
        return f"only {panel.methods[0]} gives a value: nothing to compare"
    if len(panel.subjects) < 2:
        count = len(panel.subjects)
        return f"{count} subject{'s' if count != 1 else ''} with all of {', '.join(panel.methods)}: no test"
    return ""
