"""What Muller et al. 2017 claim, and what only virtual persons can tell: each question with its figures."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from scaling_service.capabilities.dynamics.uncertainty import total as totals
from scaling_service.capabilities.kinetics.inverse_dynamics import COMPONENTS
from scaling_service.core.arrays import Array
from scaling_service.studies import claims
from scaling_service.studies.muller2017.result import Muller2017Document

NOMINAL = 0.95
"""Rate at which a frame's interval by the markers' errors should hold the true error."""

INTERVAL = 1.96
"""Standard deviations of a Gaussian that hold ``NOMINAL`` of it."""

VERTICAL, HORIZONTAL = (1, 4), ((0, 2), (3, 5))
"""Places of the vertical force and moment, and of the horizontal ones."""

LEAST_R2 = 0.96
"""Lower end of the paper's R2 (sec. 3.1: 0.963 to 0.999), rounded down."""

ALIKE = 0.35
"""Spread of slopes over persons (SD over mean) up to which they are called consistent (chosen: the boxes of
figure 8 are about a third of their median wide)."""

ORDERS = 3.0
"""Powers of ten between kinematics and plates that make the plates' share negligible (chosen; the paper:
5)."""

ALPHA = 0.05

ROUGH = 0.10
"""Largest difference of slopes that linear propagation may have from sampled ones (chosen: a thousand samples
scatter by about 3 %)."""


CLAIMS: claims.Claims[Muller2017Document] = claims.Claims.read(__package__)


def _of(study: Muller2017Document, name: str) -> NDArray[Any]:
    """Six numbers, or flags, of every person, (n, 6)."""
    return np.array([getattr(person, name) for person in study.persons])


def _by_component(values: Iterable[float], digits: int = 0) -> str:
    return ", ".join(f"{name} {value:.{digits}f}" for name, value in zip(COMPONENTS, values, strict=True))


def _assess_positive(difference: Array) -> float:
    """One-sided signed-rank test that paired differences are positive."""
    if not np.any(difference):
        return 1.0
    return float(scipy.stats.wilcoxon(difference, alternative="greater").pvalue)


@CLAIMS.decide
def linear(study: Muller2017Document) -> claims.Answer:
    r2, centred = _of(study, "r2"), _of(study, "r2_centred")
    said = f"R2 {r2.min():.3f} to {r2.max():.3f}; about the mean {centred.min():.3f} to {centred.max():.3f}"
    return claims.Answer(bool(r2.min() >= LEAST_R2), said)


@CLAIMS.decide
def consistent(study: Muller2017Document) -> claims.Answer:
    slopes = _of(study, "slopes_per_cm")
    if len(slopes) < 3:
        return claims.Answer(None, "too few persons")
    spread = slopes.std(axis=0, ddof=1) / slopes.mean(axis=0)
    means = _by_component(slopes.mean(axis=0), 3)
    return claims.Answer(
        bool(spread.max() <= ALIKE), f"SD over mean at most {spread.max():.2f}; per cm: {means}"
    )


@CLAIMS.decide
def least_vertical(study: Muller2017Document) -> claims.Answer:
    slopes = _of(study, "slopes_per_cm")
    smaller = [
        slopes[:, list(flat)].min(axis=1) - slopes[:, up]
        for up, flat in zip(VERTICAL, HORIZONTAL, strict=True)
    ]
    p = [_assess_positive(difference) for difference in smaller]
    counts = [int((difference > 0).sum()) for difference in smaller]
    said = f"force in {counts[0]} of {len(slopes)} (p = {p[0]:.3g}), moment in {counts[1]} (p = {p[1]:.3g})"
    return claims.Answer(_is_significant(max(p), study), said)


def _is_significant(p: float, study: Muller2017Document) -> bool | None:
    """A signed-rank test of fewer than five pairs can never be significant."""
    return None if len(study.persons) < 5 else p < ALPHA


@CLAIMS.decide
def horizontals_alike(study: Muller2017Document) -> claims.Answer:
    slopes = _of(study, "slopes_per_cm").mean(axis=0)
    ratios = [slopes[a] / slopes[b] for a, b in HORIZONTAL]
    holds = all(0.1 < ratio < 10.0 for ratio in ratios)
    return claims.Answer(holds, f"fx over fz {ratios[0]:.2f}, mx over mz {ratios[1]:.2f}")


@CLAIMS.decide
def plates_negligible(study: Muller2017Document) -> claims.Answer:
    orders = np.log10(_of(study, "kinematic") / _of(study, "plate"))
    said = f"{orders.min():.1f} to {orders.max():.1f} orders; plates {_of(study, 'plate').max():.1e} at most"
    return claims.Answer(bool(orders.min() >= ORDERS), said)


@CLAIMS.decide
def table_acceptable(study: Muller2017Document) -> claims.Answer:
    dr = 100 * _of(study, "dr")
    force, moment = dr[:, :3].mean(axis=1), dr[:, 3:].mean(axis=1)
    holds = bool((force <= 100 * totals.SMALL_FORCE).all() and (moment <= 100 * totals.SMALL_MOMENT).all())
    said = (
        f"forces {force.mean():.2f} ± {force.std(ddof=min(1, len(force) - 1)):.2f} %, moments "
        f"{moment.mean():.2f} ± {moment.std(ddof=min(1, len(moment) - 1)):.2f} %"
    )
    return claims.Answer(holds, said)


@CLAIMS.decide
def uncertainty_exceeds(study: Muller2017Document) -> claims.Answer:
    above = _of(study, "total") > _of(study, "dr")
    but_vertical = np.delete(above, VERTICAL[1], axis=1)
    ratio = _by_component(np.median(_of(study, "total") / _of(study, "dr"), axis=0))
    return claims.Answer(
        bool(but_vertical.all()),
        f"in {int(above.sum())} of {above.size}; times the residual (median): {ratio}",
    )


@CLAIMS.decide
def calibration_refused(study: Muller2017Document) -> claims.Answer:
    supported = _of(study, "calibration_supported")
    every, some = supported.all(axis=1), supported.any(axis=1)
    counts = {"yes": every.sum(), "in part": (some & ~every).sum(), "no": (~some).sum()}
    said = ", ".join(f"{word}: {count}" for word, count in counts.items())
    return claims.Answer(not every.any(), f"calibration supported {said}")


@CLAIMS.decide
def refusal_is_right(study: Muller2017Document) -> claims.Answer:
    refused, blamed = ~_of(study, "calibration_supported"), _of(study, "blamed")
    wrong = refused & blamed
    by = ", ".join(f"{n} {k}" for n, k in zip(COMPONENTS, wrong.sum(axis=0), strict=True) if k)
    said = f"{int((refused & ~blamed).sum())} of {int(refused.sum())} refusals are right"
    return claims.Answer(not wrong.any(), said + (f"; inertia is the larger part in {by}" if by else ""))


@CLAIMS.decide
def covers(study: Muller2017Document) -> claims.Answer:
    true, total = _of(study, "true_measurement_error"), _of(study, "total")
    covered = true <= total
    ratio = _by_component(np.median(total / true, axis=0))
    return claims.Answer(
        bool(covered.all()),
        f"in {int(covered.sum())} of {covered.size}; times the true error (median): {ratio}",
    )


@CLAIMS.decide
def markers_cover(study: Muller2017Document) -> claims.Answer:
    mean = _of(study, "coverage").mean(axis=0)
    ratio = np.median(_of(study, "markers_sd") / _of(study, "true_measurement_error"), axis=0)
    said = (
        f"{100 * mean.mean():.1f} % of frames; {_by_component(100 * mean, 1)}; "
        f"stated SD over true RMS {ratio.mean():.2f}"
    )
    return claims.Answer(bool(mean.min() >= NOMINAL), said)


@CLAIMS.decide
def linear_agrees(study: Muller2017Document) -> claims.Answer:
    ratio = _of(study, "linear_slopes_per_cm") / _of(study, "slopes_per_cm")
    return claims.Answer(
        bool(np.abs(ratio - 1.0).max() <= ROUGH), f"ratio {ratio.min():.3f} to {ratio.max():.3f}"
    )


def _compute_growth(study: Muller2017Document) -> Array:
    """True held-out error after over before an identification with hardly any tables, (n, 6)."""
    return np.array([person.identified_freely.growth for person in study.persons])


@CLAIMS.decide
def identification_worse(study: Muller2017Document) -> claims.Answer:
    worse = np.array([person.identified_freely.worse for person in study.persons])
    median = _by_component(np.median(_compute_growth(study), axis=0), 2)
    p = _assess_positive(np.log(worse))
    return claims.Answer(
        _is_significant(p, study),
        f"worse in {int((worse > 1).sum())} of {len(worse)} persons, p = {p:.3g}; ratio (median): {median}",
    )


@CLAIMS.decide
def worse_where_forbidden(study: Muller2017Document) -> claims.Answer:
    logs, blamed = np.log(_compute_growth(study)), _of(study, "blamed")
    refused = np.array([row[~b].mean() for row, b in zip(logs, blamed, strict=True) if not b.all()])
    allowed = logs[blamed]
    p = _assess_positive(refused)
    better = f"{np.exp(np.median(allowed)):.2f} in the {len(allowed)} others" if len(allowed) else "no others"
    said = f"after over before {np.exp(np.median(refused)):.2f} there (p = {p:.3g}), {better}"
    return claims.Answer(_is_significant(p, study), said)


@CLAIMS.decide
def markers_verdict(study: Muller2017Document) -> claims.Answer:
    supported, blamed = _of(study, "supported_by_markers"), _of(study, "blamed")
    if not supported.any():
        return claims.Answer(None, "nothing is supported")
    logs = np.log(_compute_growth(study))
    allowed, refused = (float(np.exp(np.median(logs[which]))) for which in (supported, ~supported))
    right = int((supported & blamed).sum())
    said = (
        f"{right} of {int(supported.sum())} supported components are inertia's, {int(blamed.sum())} are in "
        f"all; after over before {allowed:.2f} in these, {refused:.2f} in the others (medians)"
    )
    return claims.Answer(right == supported.sum() and allowed < 1.0 < refused, said)


@CLAIMS.decide
def held_out_residual_deceives(study: Muller2017Document) -> claims.Answer:
    free = [person.identified_freely for person in study.persons]
    fell = [float(np.linalg.norm(f.residual_after) / np.linalg.norm(f.residual_before)) for f in free]
    truer = [f.worse for f in free]
    both = sum(f < 1.0 < t for f, t in zip(fell, truer, strict=True))
    said = f"residual after over before {np.median(fell):.2f}, true error {np.median(truer):.2f} (medians)"
    return claims.Answer(both > 0, f"in {both} of {len(free)} persons; {said}")
