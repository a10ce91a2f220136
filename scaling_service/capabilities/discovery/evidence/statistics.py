"""How much each candidate explains, whether that could be chance, and whether it holds on other recordings.

Each candidate is fitted to the blocks beside the nuisances. What it leaves of the scores of every block
shows how far scores stray by themselves, whatever the size, the shape and the memory of the noise, as long
as blocks are longer than its memory (cluster-robust variance: Liang & Zeger 1986, Biometrika 73:13; with
the leverage of few clusters taken off: Bell & McCaffrey 2002, Surv Methodol 28:169). The sum of the scores
against that variance is Hotelling's statistic, whose reference has as many degrees of freedom as there are
blocks that really count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from scaling_service.capabilities.discovery.evidence.sums import Block, Evidence, invert_curvature
from scaling_service.capabilities.discovery.laws.candidates import Candidate
from scaling_service.numerics.multibody.laws import Array

_FEW = 6
"""Blocks below which the spread of gains is that of the effect's own course (chosen: a walk across two plates
has three, each with another share of the load)."""

_MOST_OF_IT = 0.8
"""Share of what stands above the noise that is most of it (chosen: a cause leaves what its law misses)."""

_SURELY = 5.0
"""Standard deviations of white noise's squares from which something surely stands above it (chosen: memory of
the noise makes them about twice as wide)."""

_DETERMINED = 0.99
"""Share of a column's direction that must be shown for its number to mean anything (chosen)."""

_FEWEST = 3
"""Blocks from which a spread of gains is estimated (chosen: one degree of freedom more than needed)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Fitted:
    """One candidate, fitted to some blocks."""

    size: Array  # (k,): of each column, SI
    covariance: Array  # (k, k): robust; of what the recordings do not show, zero
    gain: float  # fall of the whitened sum of squares
    by_chance: float  # the gain that noise of this kind gives on average
    p: float  # of as large a statistic by chance, for this candidate alone
    identifiable: float  # share of the columns' square that neither pose nor nuisances hide
    freedom: float = float("nan")  # degrees of freedom of the p-value's reference

    @classmethod
    def of_any_course(cls, gain: float, by_chance: float, p: float) -> Fitted:
        """Of what has no columns, for its course is not known."""
        return cls(
            size=np.zeros(0),
            covariance=np.zeros((0, 0)),
            gain=gain,
            by_chance=by_chance,
            p=p,
            identifiable=1.0,
        )

    @property
    def expected(self) -> float:
        """The gain to expect on as much other data (Takeuchi 1976, after Konishi & Kitagawa 2008, ch. 3)."""
        return self.gain - 2.0 * self.by_chance

    @property
    def rank(self) -> float:
        """What orders candidates, rounded: those that explain the same stay as the catalogue has them."""
        return -float(f"{self.expected:.9g}")

    @property
    def spread(self) -> Array:
        """The covariance, widened so that 1.96 deviations hold 95 %, few as the blocks may be."""
        if not self.freedom >= 1.0:
            return self.covariance
        wider = float(scipy.stats.t.ppf(0.975, self.freedom) / scipy.stats.norm.ppf(0.975))
        return np.asarray(wider**2 * self.covariance)


NOTHING = Fitted(
    size=np.zeros(0), covariance=np.zeros((0, 0)), gain=0.0, by_chance=0.0, p=1.0, identifiable=0.0
)


def fit_each(evidence: Evidence, candidates: Sequence[Candidate]) -> tuple[Fitted, ...]:
    """Fit every candidate, in the evidence's order, by itself to the trials that are to fit.

    One that is in no trial to fit is fitted where it is; what is held out does not decide the nuisances.
    Columns and residuals are both freed of the nuisances (Frisch & Waugh 1933, Econometrica 1:387): the sum
    of the scores would be the same without the latter, but they would stray from block to block.
    """
    count, width, raw = evidence.nuisances, len(evidence.raw), evidence.raw
    fits = [s for s in evidence.blocks if s.role == "fit"]
    scores = np.array([s.scores for s in fits]).reshape(len(fits), width)
    cross = np.array([s.cross for s in fits]).reshape(len(fits), count, width)
    total, inner = cross.sum(axis=0), cross[:, :, :count]
    inverse = invert_curvature(total[:, :count], raw[:count])[0]
    follow, step = inverse @ total, inverse @ scores[:, :count].sum(axis=0)
    carried = inner @ follow
    scores = scores - scores[:, :count] @ follow - step @ (cross - carried)
    held_out = {s.trial for s in evidence.blocks if s.role == "held_out"}
    found = []
    for k, (rows, candidate) in enumerate(zip(evidence.groups, candidates, strict=True)):
        alone = [s for s in evidence.blocks if s.trial in candidate.trials]
        if alone and held_out.issuperset(s.trial for s in alone):
            own, of_blocks = evidence.products(k, alone), np.array([s.scores[rows] for s in alone])
        else:
            f, of_blocks = follow[:, rows], scores[:, rows]
            mixed = f.T @ cross[:, :, rows]
            own = evidence.products(k, fits) + f.T @ carried[:, :, rows] - mixed - mixed.transpose(0, 2, 1)
        found.append(fit_columns(of_blocks, own, raw[rows], () if candidate.trials else fits))
    return tuple(found)


def fit_columns(scores: Array, own: Array, raw: Array, blocks: Sequence[Block] = ()) -> Fitted:
    """Fit columns to blocks: scores (n_blocks, k), products (n_blocks, k, k), squares as they were (k,).

    ``blocks``: these, if the effect is in all recordings, so that others confirm it. Few do not tell how
    scores stray, least where one of them shows most of the effect. What takes off most of what surely stands
    above the noise is held against noise alone, too: scores stray as here, at least as white noise and as
    what is left, and each block counts as a marker in one frame.
    """
    curvature = own.sum(axis=0)
    inverse, identifiable, directions = invert_curvature(curvature, raw)
    rank = directions.shape[1]
    if rank == 0:
        return NOTHING
    white, shares = scores @ directions, np.einsum("ki,bkl,lj->bij", directions, own, directions)
    total = white.sum(axis=0)
    left = white - shares @ total
    leverage = np.einsum("bii->b", shares) / rank
    left /= np.sqrt(np.maximum(1.0 - leverage, 0.05))[:, None]
    variance, gain = left.T @ left, float(total @ total)
    counting = 1.0 / float((leverage**2).sum())
    freedom, by_chance, p = counting - rank, float("inf"), 1.0
    if freedom >= 1.0:
        value, vector = np.linalg.eigh(variance)
        value = np.maximum(value, 1e-9 * max(float(value[-1]), 1e-300))
        hotelling = float(((vector.T @ total) ** 2 / value).sum())
        by_chance = float(np.trace(variance))
        p = float(scipy.special.fdtrc(rank, freedom, hotelling * freedom / (rank * (counting - 1.0))))
    if _is_most_explained(gain, blocks):
        unexplained = (sum(s.square for s in blocks) - gain) / sum(s.freedom for s in blocks)
        strays, few = max(1.0, unexplained, float(np.trace(variance)) / rank), 3.0 * len(blocks)
        p = min(1.0, 2.0 * min(p, float(scipy.special.fdtrc(rank, few, gain / (rank * strays)))))
        if freedom < 1.0:
            freedom, by_chance, variance = few, rank * strays, strays * np.eye(rank)
    size = inverse @ scores.sum(axis=0)
    if not np.isfinite(by_chance):
        return Fitted(
            size=size,
            covariance=np.zeros_like(inverse),
            gain=gain,
            by_chance=by_chance,
            p=p,
            identifiable=identifiable,
        )
    covariance = directions @ variance @ directions.T
    shown = _share_shown(directions, raw) > _DETERMINED
    covariance *= np.outer(shown, shown)
    return Fitted(
        size=size,
        covariance=covariance,
        gain=gain,
        by_chance=by_chance,
        p=p,
        identifiable=identifiable,
        freedom=freedom,
    )


def _is_most_explained(gain: float, blocks: Sequence[Block]) -> bool:
    """Whether a gain is most of what surely stands above the noise of blocks.

    Noise with memory is larger than the floors, and no larger than in the quietest block.
    """
    if not blocks:
        return False
    square, count = np.array([(s.square, s.freedom) for s in blocks]).T
    noise = max(1.0, float((square / count).min())) * float(count.sum())
    above = float(square.sum()) - noise
    return above > _SURELY * noise * np.sqrt(2.0 / float(count.sum())) and gain > _MOST_OF_IT * above


def _share_shown(directions: Array, raw: Array) -> Array:
    """How much of each column (k,) lies in the directions (k, rank) of which the blocks show something."""
    if not directions.shape[1]:
        return np.zeros(len(raw))
    basis = np.linalg.qr(np.sqrt(raw)[:, None] * directions)[0]
    return np.asarray((basis**2).sum(axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class Explained:
    """What a fitted candidate takes off each block that it was fitted to."""

    size: Array  # (k,): of the candidate's columns, SI
    along: Array  # (n_nuisances,): how the nuisances move with it
    step: Array  # (n_nuisances,): how they move without it
    gains: Array  # (n_blocks,): of the whitened sum of squares


def explain(evidence: Evidence, index: int, blocks: Sequence[Block]) -> Explained:
    """Fit one candidate, by its index in evidence that was gathered together, to blocks."""
    rows, count = evidence.groups[index], evidence.nuisances
    total, score, inverse = evidence.summed(tuple(blocks))
    follow, step = inverse @ total[:count, rows], inverse @ score[:count]
    curvature = total[rows, rows] - total[rows, :count] @ follow
    size = invert_curvature(curvature, evidence.raw[rows])[0] @ (score[rows] - follow.T @ score[:count])
    along = -follow @ size
    found = Explained(size, along, step, np.zeros(0))
    return replace(found, gains=compute_gains(evidence, index, found, blocks))


def compute_gains(evidence: Evidence, index: int, found: Explained, blocks: Sequence[Block]) -> Array:
    """What a candidate takes off blocks beyond what nuisances by themselves do, (n_blocks,)."""
    return _compute_gains_and_squares(evidence, index, found, blocks)[0]


def _compute_gains_and_squares(
    evidence: Evidence, index: int, found: Explained, blocks: Sequence[Block]
) -> tuple[Array, Array]:
    """Gains, and the squares of what the candidate predicts, (n_blocks,) each."""
    count, rows = evidence.nuisances, evidence.groups[index]
    along, size = found.along, found.size

    def compute_gain(s: Block) -> tuple[float, float]:
        beside = s.own[:count, rows]
        predicted = s.own[:count, :count] @ along + beside @ size  # the nuisances' scores
        square = float(along @ predicted + size @ (along @ beside + s.own[rows, rows] @ size))
        slope = along @ s.scores[:count] + size @ s.scores[rows] - predicted @ found.step
        return float(2.0 * slope) - square, square

    both = np.array([compute_gain(s) for s in blocks]).reshape(-1, 2)
    return both[:, 0], both[:, 1]


def assess_lead(best: Array, other: Array, penalty: float) -> float:
    """How likely chance alone makes the best as much better as it is (Vuong 1989, Econometrica 57:307).

    ``best``, ``other``: gains of the two, (n_blocks,); ``penalty``: what the best spends more on chance, not
    finite where that cannot be told. One where blocks are too few to tell.
    """
    if len(best) < _FEWEST or not np.isfinite(penalty):
        return 1.0
    lead = best - other - penalty / len(best)
    if not lead.std():
        return 1.0 if lead.mean() <= 0.0 else 0.0
    return assess_above_zero(lead)


@dataclass(frozen=True, slots=True)
class HeldOut:
    """A candidate on blocks that did not fit it."""

    gain: float  # share of their whitened sum of squares that it takes off
    p: float  # of as consistent a gain by chance
    folds: bool  # whether these were blocks of time of the same trial, for want of another one
    # whether the gain is more than all squares of noise there, or most of what stands above them
    outweighs_noise: bool = False


def try_held_out(
    evidence: Evidence, index: int, candidate: Candidate, overdispersion: float = 1.0
) -> HeldOut:
    """Try a candidate on what did not fit it.

    One that is in trials to fit and in held-out ones is fitted to those and tried on these; any other is
    fitted to every other block where it is and tried on those between. Trials to fit in which it is not
    always tell the nuisances from it.

    Gains stray by how much of the effect each block shows, too. Where blocks are few and the gain outweighs
    the noise there, and wherever it is most of what stands above the noise, noise alone is asked, too,
    whether it could bring the sum. Its variance is four times the squares that the candidate predicts, times
    ``overdispersion``: how much more scores stray than white noise of the floors would make them, as in the
    fit, and at least as what is left of these blocks.
    """
    here = [s for s in evidence.blocks if candidate.holds_in(s.trial)]
    fitting = [s for s in here if s.role == "fit"]
    held = [s for s in here if s.role == "held_out"]
    others = [s for s in evidence.blocks if s.role == "fit" and not candidate.holds_in(s.trial)]
    halves = [(here[0::2], here[1::2]), (here[1::2], here[0::2])]
    rounds = [(fitting, held)] if fitting and held else halves
    gains, squares, square, freedom = [], [], 0.0, 0.0
    for known, new in rounds:
        found = explain(evidence, index, [*others, *known])
        gain, predicted = _compute_gains_and_squares(evidence, index, found, new)
        gains.append(gain)
        squares.append(predicted)
        square += sum(s.square for s in new)
        freedom += sum(s.freedom for s in new)
    every = np.concatenate(gains)
    share = float(every.sum() / square) if square else 0.0
    most = _is_most_explained(float(every.sum()), [s for _, new in rounds for s in new])
    p, outweighs = assess_above_zero(every), bool(every.sum() > freedom > 0.0)
    if np.isfinite(overdispersion) and (most or (len(every) < _FEW and outweighs)):
        left = max(square - float(every.sum()), 0.0) / freedom
        noise = 4.0 * max(1.0, overdispersion, left) * float(np.concatenate(squares).sum())
        alone = float(scipy.special.ndtr(-every.sum() / np.sqrt(noise))) if noise > 0.0 else 1.0
        p = min(1.0, 2.0 * min(p, alone))
    return HeldOut(share, p, len(rounds) > 1, most or outweighs)


def assess_share(taken: float, by_chance: float, numbers: float) -> float:
    """How likely as many numbers take off as much as some did of squares, by chance (Fisher's F)."""
    return float(scipy.special.fdtrc(numbers, numbers, taken / max(by_chance, 1e-300))) if numbers else 1.0


def assess_above_zero(values: Array) -> float:
    """How likely chance alone brings the mean so far above zero."""
    if len(values) < _FEWEST:
        return 1.0
    spread = float(values.std(ddof=1))
    if spread == 0.0:
        return 1.0
    return float(scipy.special.stdtr(len(values) - 1, -values.mean() / (spread / np.sqrt(len(values)))))


def find_best_span(gain: Array) -> tuple[float, slice]:
    """The span of the largest sum, and that sum (Bentley 1984, Commun ACM 27:865)."""
    total = np.concatenate([[0.0], np.cumsum(gain)])
    low = np.minimum.accumulate(total)
    stop = int(np.argmax(total - low))
    start = int(np.flatnonzero(total[: stop + 1] == low[stop])[-1])
    return float(total[stop] - total[start]), slice(start, stop)


def adjust_holm(p: Array) -> Array:
    """P-values that pay for their number (Holm 1979, Scand J Stat 6:65)."""
    order, count = np.argsort(p), len(p)
    stepped = np.maximum.accumulate((count - np.arange(count)) * p[order])
    result = np.empty(count)
    result[order] = np.minimum(stepped, 1.0)
    return result
