"""One number per subject and method, compared over a cohort: Friedman's test and Tukey's HSD on ranks.

Puchaud 2019 (section 2.3) compares segment lengths and kinematic errors of the models so. The post hoc
test is Tukey's honestly significant difference applied to the mean ranks, with infinite degrees of
freedom because the variance of ranks is known, not estimated: what MATLAB's ``multcompare`` does after
``friedman``, known elsewhere as Nemenyi's or the Wilcoxon-Nemenyi-McDonald-Thompson test (Hollander &
Wolfe 1999, Nonparametric Statistical Methods, 2nd ed., section 7.3).
"""

from __future__ import annotations

import math
from collections import abc
from itertools import combinations

import numpy as np
import scipy
from numpy.typing import ArrayLike

from scaling_service.capabilities.cohort import result as documents
from scaling_service.capabilities.cohort import summary
from scaling_service.numerics.statistics import complete

SAME = 1e-9
"""Relative to the largest value: chosen. Two methods that must give one length (marker-based scaling,
and its optimisation of axes and markers only) reach it by different sums; nine digits call it a tie,
where rounding errors would be ranked otherwise."""

_MM, _DEG = 1e3, 180.0 / math.pi


def compare_groups(
    values: ArrayLike,
    subjects: abc.Sequence[str],
    methods: abc.Sequence[str],
    *,
    quantity: str,
    alpha: float = 0.05,
) -> documents.FriedmanEntry:
    """Compare a quantity between methods: Friedman's test, and every pair of methods after it.

    ``values``: (n_subjects, n_methods). Raises ValueMissing: one is not finite; subject and method are named.
    Raises ComparisonImpossible: fewer than two subjects or methods.

    Examples
    --------
    >>> lengths = [[0.43 + k / 100, 0.42 + k / 90, 0.44 + k / 80] for k in range(9)]
    >>> found = compare_groups(lengths, "abcdefghi", ("MB", "EB", "MB_lam"), quantity="femur_r")
    >>> round(found.chi_square, 6), found.significant, found.pair("EB", "MB_lam").significant
    (18.0, True, True)
    """
    if not 0.0 < alpha < 1.0:
        raise complete.ComparisonImpossible(
            f"a significance level of {alpha:g} is not between 0 and 1", field="alpha"
        )
    table = complete.require_complete(values, subjects, methods, quantity=quantity, dimensions=2)
    n, k = table.shape
    step = SAME * float(np.abs(table).max())
    ranks = scipy.stats.rankdata((np.round(table / step) if step > 0.0 else table), axis=1)
    mean_rank = ranks.mean(axis=0)
    # The variance of one subject's ranks: k (k + 1) / 12 without ties, less with them.
    variance = float(np.sum((ranks - (k + 1) / 2) ** 2)) / (n * (k - 1))
    spread = n * float(np.sum((mean_rank - (k + 1) / 2) ** 2))
    statistic = spread / variance if variance > 0.0 else 0.0
    p = float(scipy.stats.chi2.sf(statistic, k - 1))
    # Tukey's HSD on mean ranks, whose standard error is known
    first, second = np.array(list(combinations(range(k), 2))).T
    error, apart = math.sqrt(variance / n), np.abs(mean_rank[first] - mean_rank[second])
    q = apart / error if error > 0.0 else np.zeros(len(first))
    of_pairs = scipy.stats.studentized_range.sf(q, k, np.inf)
    differences = table[:, first] - table[:, second]
    return documents.FriedmanEntry(
        chi_square=statistic,
        degrees_of_freedom=k - 1,
        p=p,
        kendall_w=statistic / (n * (k - 1)),
        alpha=alpha,
        significant=p < alpha,
        pairs=[
            documents.RankedPairEntry(
                methods=(methods[first[i]], methods[second[i]]),
                difference_mean=differences[:, i].mean(),
                difference_sd=differences[:, i].std(ddof=1),
                p=of_pairs[i],
                significant=p < alpha and bool(of_pairs[i] < alpha),
            )
            for i in range(len(first))
        ],
    )


def _average_errors(method: summary.MethodSummary) -> dict[str, float]:
    """Mean kinematic error over the trials of each role, every trial counting the same, m.

    Chosen: Puchaud 2019 defines the error of a trial, and does not say how trials are pooled.
    """
    by_role: dict[str, list[float]] = {}
    for trial in method.trials.values():
        if np.isfinite(trial.mean):
            by_role.setdefault(trial.role, []).append(trial.mean)
    return {role: float(np.mean(errors)) for role, errors in by_role.items()}


def compare_quantities(
    subjects: abc.Sequence[summary.SubjectSummary], methods: abc.Sequence[str], alpha: float
) -> dict[str, list[documents.QuantityEntry]]:
    """Every quantity of every kind, over every panel that the cohort allows.

    ``alpha`` is of each test: quantities are not corrected for each other, as in Puchaud 2019 (section 2.3).
    """
    import pandas  # only here and after all work: it takes half a second

    # Kind of quantity, as the document's lists are called, to its factor and where a method's summary has it.
    kinds: abc.Mapping[str, tuple[float, abc.Callable[[summary.MethodSummary], abc.Mapping[str, float]]]] = {
        "segment_lengths_mm": (_MM, lambda method: method.lengths),
        "kinematic_error_mm": (_MM, _average_errors),
        "knee_axis_deg": (
            _DEG,
            lambda method: {
                f"{side}_{axis}": turn
                for side, turns in method.knee_axes.items()
                for axis, turn in zip("xy", turns, strict=True)
            },
        ),
        "marker_shift_mm": (
            _MM,
            lambda method: (
                {"mean_over_markers": float(np.mean(list(method.marker_shifts.values())))}
                if method.marker_shifts
                else {}
            ),
        ),
        "from_truth_mm": (_MM, lambda method: method.from_truth_m),
        "from_truth_deg": (_DEG, lambda method: method.from_truth_rad),
    }
    long = pandas.DataFrame(
        (
            (kind, quantity, s.subject, name, factor * value)
            for kind, (factor, read) in kinds.items()
            for s in subjects
            for name, method in s.methods.items()
            for quantity, value in read(method).items()
        ),
        columns=["kind", "quantity", "subject", "method", "value"],
    )
    entries: dict[str, list[documents.QuantityEntry]] = {kind: [] for kind in kinds}
    for (kind, quantity), found in long.groupby(["kind", "quantity"], sort=False):
        table = found.pivot(index="subject", columns="method", values="value")
        table = table.replace([np.inf, -np.inf], np.nan).reindex([s.subject for s in subjects])
        has = {subject: list(row.dropna().index) for subject, row in table.iterrows()}
        for panel in complete.list_panels(has, methods):
            part = table.loc[list(panel.subjects), list(panel.methods)]
            note = explain_too_few(panel)
            tested = None
            if not note:
                tested = compare_groups(part, panel.subjects, panel.methods, quantity=quantity, alpha=alpha)
            entries[kind].append(
                documents.QuantityEntry(
                    quantity=quantity,
                    compared=documents.Compared.model_validate(panel),
                    mean=part.mean().to_dict(),
                    sd=part.std().to_dict() if len(part) > 1 else {},
                    values=part.to_dict("index"),
                    friedman=tested,
                    note=note,
                )
            )
    return entries


def explain_too_few(panel: complete.Panel) -> str:
    """Why a panel cannot be tested; empty where it can."""
    if len(panel.methods) < 2:
        return f"only {panel.methods[0]} gives a value: nothing to compare"
    if len(panel.subjects) < 2:
        count = len(panel.subjects)
        return f"{count} subject{'s' if count != 1 else ''} with all of {', '.join(panel.methods)}: no test"
    return ""
