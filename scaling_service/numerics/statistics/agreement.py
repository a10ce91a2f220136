"""How well a method agrees with a reference, subject by subject: Bland-Altman, ICC, RMSE."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from scaling_service.core.arrays import Array
from scaling_service.numerics.statistics import complete

LIMITS = 0.95
"""The share of differences between the limits of agreement (Bland & Altman 1986; z = 1.96)."""

_ROUNDING = 1e-13
"""Relative: chosen, some hundred times the spacing of doubles."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its confidence interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class BlandAltman:
    """Differences of a method from a reference, in the quantity's unit.

    ``bias``: mean of method minus reference.
    ``sd``: of the differences (n - 1).
    ``lower``, ``upper``: limits of agreement, bias ± 1.96 SD.
    ``slope``: of the differences against the means of method and reference: away from zero where the
        disagreement grows with size (Bland & Altman 1999, section 3); NaN where all means are one.
    """

    bias: Estimate
    sd: float
    lower: Estimate
    upper: Estimate
    slope: Estimate
    n: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreement:
    """A method against a reference over a cohort.

    ``icc_agreement`` is ICC(2,1), ``icc_consistency`` ICC(3,1), which forgives a constant bias. ``rmse``
    is in the quantity's unit. Intervals are at ``confidence``.
    """

    quantity: str
    method: str
    reference: str
    bland_altman: BlandAltman
    icc_agreement: Estimate
    icc_consistency: Estimate
    rmse: float
    confidence: float


def measure_agreement(
    values: Mapping[str, Mapping[str, float]],
    method: str,
    reference: str,
    *,
    quantity: str,
    confidence: float = 0.95,
) -> Agreement:
    """Compare a method with a reference, given as ``{subject: {method: value}}``.

    The reference may be the known truth, under a name of its own.

    Raises ValueMissing: a subject lacks the method or the reference, or a value is not finite; both are
        named.
    Raises ComparisonImpossible: fewer than three subjects.

    Examples
    --------
    >>> femurs = {"S1": {"MB": 0.43, "EB": 0.42}, "S2": {"MB": 0.45, "EB": 0.45},
    ...           "S3": {"MB": 0.40, "EB": 0.41}, "S4": {"MB": 0.48, "EB": 0.46}}
    >>> found = measure_agreement(femurs, "MB", "EB", quantity="femur_r")
    >>> round(found.bland_altman.bias.value, 6), round(found.rmse, 6)
    (0.005, 0.012247)
    """
    for subject, by_method in values.items():
        for name in (method, reference):
            if name not in by_method:
                raise complete.report_absent(subject, name, quantity)
    pairs = complete.require_complete(
        [[by_method[method], by_method[reference]] for by_method in values.values()],
        tuple(values),
        (method, reference),
        quantity=quantity,
        dimensions=2,
    )
    if len(pairs) < 3:
        raise complete.ComparisonImpossible(
            f"agreement needs at least three subjects, and there are {len(pairs)}",
            field=quantity,
            remedy="Add subjects",
        )
    absolute, consistent = compute_intraclass_correlations(pairs, confidence=confidence)
    return Agreement(
        quantity=quantity,
        method=method,
        reference=reference,
        bland_altman=compute_bland_altman(pairs[:, 0], pairs[:, 1], confidence=confidence),
        icc_agreement=absolute,
        icc_consistency=consistent,
        rmse=float(np.sqrt(np.mean((pairs[:, 0] - pairs[:, 1]) ** 2))),
        confidence=confidence,
    )


def compute_bland_altman(values: Array, reference: Array, *, confidence: float = 0.95) -> BlandAltman:
    """Bias and limits of agreement of paired values.

    ``values``, ``reference``: (n_subjects,), three or more, finite.
    ``confidence``: of the intervals.

    Bland & Altman 1986 (Lancet 327:307-310) with the standard error of a limit from Bland & Altman 1999 (Stat
    Methods Med Res 8:135-160, section 2.1), s² (1/n + z² / (2 (n - 1))), of which the earlier paper's 3 s²/n
    is the rounded form.
    """
    n, differences, means = len(values), values - reference, (values + reference) / 2
    bias, sd = float(differences.mean()), float(differences.std(ddof=1))
    quantile = float(scipy.stats.t.ppf((1 + confidence) / 2, n - 1))
    z = float(scipy.stats.norm.ppf((1 + LIMITS) / 2))
    wide = quantile * sd * float(np.sqrt(1 / n + z**2 / (2 * (n - 1))))
    lower, upper = bias - z * sd, bias + z * sd
    return BlandAltman(
        bias=_estimate_about(bias, quantile * sd / float(np.sqrt(n))),
        sd=sd,
        lower=_estimate_about(lower, wide),
        upper=_estimate_about(upper, wide),
        slope=_fit_slope(means, differences, confidence),
        n=n,
    )


def compute_intraclass_correlations(table: Array, *, confidence: float = 0.95) -> tuple[Estimate, Estimate]:
    """ICC(2,1), of absolute agreement, and ICC(3,1), of consistency.

    ``table``: (n_subjects, n_methods), three or more subjects, finite.
    Returns ``absolute``, ``consistent``: of single measurements; NaN where all values are one.

    Shrout & Fleiss 1979 (Psychol Bull 86:420-428); intervals from McGraw & Wong 1996 (Psychol Methods
    1:30-46, table 7, ICC(A,1) and ICC(C,1)), that of ICC(2,1) with Satterthwaite's degrees of freedom.
    """
    n, k = table.shape
    # Between subjects, between methods, and of what is left; rounding errors count as nothing.
    centred = table - table.mean()
    by_subject, by_method = centred.mean(axis=1), centred.mean(axis=0)
    left = centred - by_subject[:, None] - by_method
    squares = np.array([k * np.sum(by_subject**2), n * np.sum(by_method**2), np.sum(left**2)])
    squares[squares <= table.size * (_ROUNDING * np.abs(table).max()) ** 2] = 0.0
    rows, columns, error = (squares / (n - 1, k - 1, (n - 1) * (k - 1))).tolist()
    upper = (1 + confidence) / 2
    if error <= 0.0:
        # Every method shifts all subjects alike: the intervals have no width, or there is nothing to see.
        if rows <= 0.0:
            nothing = Estimate(float("nan"), float("nan"), float("nan"))
            return nothing, nothing
        value = rows / (rows + k * columns / n)
        # With a bias but no error the interval of the absolute form is not defined, only its value.
        open_ended = Estimate(value, float("nan"), float("nan")) if columns > 0.0 else Estimate(1.0, 1.0, 1.0)
        return open_ended, Estimate(1.0, 1.0, 1.0)
    ratio = rows / error
    free = (n - 1, (n - 1) * (k - 1))
    low = ratio / float(scipy.stats.f.ppf(upper, *free))
    high = ratio * float(scipy.stats.f.ppf(upper, *free[::-1]))
    consistent = Estimate(*(float((f - 1) / (f + k - 1)) for f in (ratio, low, high)))
    value = (rows - error) / (rows + (k - 1) * error + k * (columns - error) / n)
    a = k * value / (n * (1 - value))
    b = 1 + k * value * (n - 1) / (n * (1 - value))
    spread = (a * columns) ** 2 / (k - 1) + (b * error) ** 2 / ((n - 1) * (k - 1))
    free = (a * columns + b * error) ** 2 / spread
    noise = k * columns + (k * n - k - n) * error
    above = float(scipy.stats.f.ppf(upper, n - 1, free))
    below = float(scipy.stats.f.ppf(upper, free, n - 1))
    low = n * (rows - above * error) / (above * noise + n * rows)
    high = n * (below * rows - error) / (noise + n * below * rows)
    return Estimate(value, low, high), consistent


def _fit_slope(means: Array, differences: Array, confidence: float) -> Estimate:
    n = len(means)
    centred = means - means.mean()
    size = float(centred @ centred)
    if size <= n * (_ROUNDING * float(np.abs(means).max())) ** 2:
        return Estimate(float("nan"), float("nan"), float("nan"))
    value = float(centred @ differences) / size
    left = differences - differences.mean() - value * centred
    error = float(np.sqrt(left @ left / (n - 2) / size))
    return _estimate_about(value, float(scipy.stats.t.ppf((1 + confidence) / 2, n - 2)) * error)


def _estimate_about(value: float, half_width: float) -> Estimate:
    return Estimate(value, value - half_width, value + half_width)
