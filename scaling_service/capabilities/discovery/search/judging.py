"""How much each candidate explains, and whether that could be chance.

Each candidate is fitted to the stretches beside the nuisances. What it leaves of the scores of every stretch
shows how far scores stray by themselves, whatever the size, the shape and the memory of the noise, as long
as stretches are longer than its memory (cluster-robust variance: Liang & Zeger 1986, Biometrika 73:13; with
the leverage of few clusters taken off: Bell & McCaffrey 2002, Surv Methodol 28:169). The sum of the scores
against that variance is Hotelling's statistic, whose reference has as many degrees of freedom as there are
stretches that really count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from scaling_service.capabilities.discovery.evidence.score import Evidence, Stretch
from scaling_service.capabilities.discovery.search.candidates import Candidate
from scaling_service.numerics.multibody.laws import Array

HIDDEN = 1e-3
"""Share of a direction's square below which the pose or a nuisance is taken to hide it (chosen: at 1e-3 a
change of 10 mm shows as 0.3 mm, no more than the model's curvature leaves)."""


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """One candidate, fitted to some stretches.

    Parameters
    ----------
    size : ndarray, shape (k,)
        Of each column, SI.
    covariance : ndarray, shape (k, k)
        Robust; of what the recordings do not show, zero.
    gain : float
        Fall of the whitened sum of squares.
    by_chance : float
        The gain that noise of this kind gives on average.
    p : float
        Of as large a statistic by chance, for this candidate alone.
    shown : float
        Share of the columns' square that neither pose nor nuisances hide.
    freedom : float
        Degrees of freedom of the p-value's reference.
    """

    size: Array
    covariance: Array
    gain: float
    by_chance: float
    p: float
    shown: float
    freedom: float = float("nan")

    @property
    def expected(self) -> float:
        """The gain to expect on as much other data (Takeuchi 1976, after Konishi & Kitagawa 2008, ch. 3)."""
        return self.gain - 2.0 * self.by_chance

    @property
    def spread(self) -> Array:
        """The covariance, widened so that 1.96 deviations hold 95 %, few as the stretches may be."""
        if not self.freedom >= 1.0:
            return self.covariance
        wider = float(scipy.stats.t.ppf(0.975, self.freedom) / scipy.stats.norm.ppf(0.975))
        return np.asarray(wider**2 * self.covariance)


NOTHING = Fitted(np.zeros(0), np.zeros((0, 0)), 0.0, 0.0, 1.0, 0.0)


def fit_each(evidence: Evidence, candidates: Sequence[Candidate]) -> tuple[Fitted, ...]:
    """Fit every candidate by itself to the trials that are to fit.

    One that is in no trial to fit is fitted where it is; what is held out does not decide the nuisances.

    Parameters
    ----------
    evidence : Evidence
    candidates : sequence of Candidate
        In the evidence's order.
    """
    evidence = evidence.apart()
    fits = [s for s in evidence.stretches if s.role == "fit"]
    nothing = np.zeros((0, len(evidence.raw))), np.zeros((0, *evidence.stretches[0].own.shape))
    fitting = _without_nuisances(evidence, fits) if fits else nothing
    alone: dict[tuple[str, ...], tuple[Array, Array]] = {}
    for trials in {c.trials for c in candidates}:
        here = [s for s in evidence.stretches if s.trial in trials]
        if here and all(s.role == "held_out" for s in here):
            alone[trials] = np.array([s.scores for s in here]), np.array([s.own for s in here])
    found = []
    for k, (rows, candidate) in enumerate(zip(evidence.groups, candidates, strict=True)):
        scores, own = alone.get(candidate.trials, fitting)
        width = rows.stop - rows.start
        found.append(fit(scores[:, rows], own[:, k, :width, :width], evidence.raw[rows]))
    return tuple(found)


def _without_nuisances(evidence: Evidence, chosen: Sequence[Stretch]) -> tuple[Array, Array]:
    """Scores (B, n_columns) and own products (B, n_groups, w, w) where the nuisances follow.

    Columns and residuals are both freed of the nuisances (Frisch & Waugh 1933, Econometrica 1:387): the sum
    of the scores would be the same without the latter, but they would stray from stretch to stretch.
    """
    scores, own = np.array([s.scores for s in chosen]), np.array([s.own for s in chosen])
    count = evidence.nuisances
    if not count:
        return scores, own
    cross = np.array([s.cross for s in chosen])
    total = cross.sum(axis=0)
    inverse = inverse_of(total[:, :count], evidence.raw[:count])[0]
    follow, step = inverse @ total, inverse @ scores[:, :count].sum(axis=0)
    inner = cross[:, :, :count]
    scores = scores - scores[:, :count] @ follow - step @ (cross - inner @ follow)
    own = own.copy()
    for k, rows in enumerate(evidence.groups):
        width = rows.stop - rows.start
        f = follow[:, rows]
        mixed = f.T @ cross[:, :, rows]
        own[:, k, :width, :width] += f.T @ inner @ f - mixed - mixed.transpose(0, 2, 1)
    return scores, own


def fit(scores: Array, own: Array, raw: Array) -> Fitted:
    """Fit columns to stretches.

    Parameters
    ----------
    scores : ndarray, shape (n_stretches, k)
    own : ndarray, shape (n_stretches, k, k)
    raw : ndarray, shape (k,)
        Squares of the columns before anything was taken out.
    """
    curvature = own.sum(axis=0)
    inverse, shown, directions = inverse_of(curvature, raw)
    rank = directions.shape[1]
    if rank == 0:
        return NOTHING
    white, shares = scores @ directions, np.einsum("ki,bkl,lj->bij", directions, own, directions)
    total = white.sum(axis=0)
    left = white - shares @ total
    leverage = np.einsum("bii->b", shares) / rank
    left /= np.sqrt(np.maximum(1.0 - leverage, 0.05))[:, None]
    variance = left.T @ left
    counting = 1.0 / float((leverage**2).sum())
    freedom = counting - rank
    gain = float(total @ total)
    if freedom < 1.0:
        return Fitted(inverse @ scores.sum(axis=0), np.zeros_like(inverse), gain, float("inf"), 1.0, shown)
    value, vector = np.linalg.eigh(variance)
    value = np.maximum(value, 1e-9 * max(float(value[-1]), 1e-300))
    hotelling = float(((vector.T @ total) ** 2 / value).sum())
    p = float(scipy.special.fdtrc(rank, freedom, hotelling * freedom / (rank * (counting - 1.0))))
    covariance = directions @ variance @ directions.T
    return Fitted(
        inverse @ scores.sum(axis=0), covariance, gain, float(np.trace(variance)), p, shown, freedom
    )


def inverse_of(curvature: Array, raw: Array) -> tuple[Array, float, Array]:
    """Inverse of a curvature where the recordings show something, and how much they show.

    Returns
    -------
    inverse : ndarray, shape (k, k)
    shown : float
        The largest share of any direction's square that is not hidden.
    directions : ndarray, shape (k, rank)
        D with D D' = inverse: D' score has unit variance for white noise.
    """
    scale = np.divide(1.0, np.sqrt(raw), out=np.zeros_like(raw), where=raw > 0)
    value, vector = np.linalg.eigh(curvature * np.outer(scale, scale))
    known = value > HIDDEN
    directions = scale[:, None] * vector[:, known] / np.sqrt(value[known])
    return directions @ directions.T, float(value.max(initial=0.0)), directions
