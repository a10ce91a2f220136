"""Two labels that changed places for a while."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from scaling_service.discovery.at_once import each
from scaling_service.discovery.candidates import Exchange
from scaling_service.discovery.evidence import Generators, span
from scaling_service.discovery.watched import Watched
from scaling_service.kernels.laws import Array

_BLOCK = 128
_SAME_S = 0.1  # chosen: times of one script differ by less from trial to trial
_SHORTEST = 3  # frames; chosen: fewer are a flicker that does no harm


@dataclass(frozen=True, slots=True, eq=False)
class Swap:
    """Two labels exchanged for some frames.

    Parameters
    ----------
    exchange : Exchange
    trials : tuple of str
        Those in which they are; all of them unless given.
    gain : float
        Fall of the whitened sum of squares.
    level : float
        Whitened square of one number in the other frames.
    """

    exchange: Exchange
    trials: tuple[str, ...]
    gain: float
    level: float


def swaps(watched: Sequence[Watched]) -> list[Swap]:
    """The best pair and span of every trial, if any helps."""
    found = [swap for swap in each(_best, watched) if swap is not None]
    together = _together(found)
    return found if together is None or len(found) < len(watched) else [*found, together]


def _together(found: Sequence[Swap]) -> Swap | None:
    """One exchange for all trials, where all have the same pair at the same times."""
    spans = np.array([(s.exchange.start_s, s.exchange.end_s) for s in found])
    pairs = {(s.exchange.first, s.exchange.second) for s in found}
    if len(found) < 2 or len(pairs) > 1 or np.ptp(spans, axis=0).max() > _SAME_S:
        return None
    exchange = Exchange(*pairs.pop(), *np.median(spans, axis=0).tolist())
    return Swap(exchange, (), sum(s.gain for s in found), max(s.level for s in found))


def _best(item: Watched) -> Swap | None:
    pairs = list(combinations(range(len(item.markers)), 2))
    if not pairs:
        return None
    gains, square, freedom = _gains(item, pairs)
    spans = [_span(gains[:, k]) for k in range(len(pairs))]
    k = int(np.argmax([gain for gain, _ in spans]))
    gain, rows = spans[k]
    if gain <= 0.0 or rows.stop - rows.start < _SHORTEST:
        return None
    first, second = (item.markers[m] for m in pairs[k])
    times = item.trial.times
    exchange = Exchange(first, second, float(times[rows.start]), float(times[rows.stop - 1]))
    outside = np.ones(len(times), dtype=bool)
    outside[rows] = False
    level = float(square[outside].sum() / max(freedom[outside].sum(), 1.0)) if outside.any() else 1.0
    return Swap(exchange, (item.name,), gain, level)


def _gains(item: Watched, pairs: Sequence[tuple[int, int]]) -> tuple[Array, Array, Array]:
    """Of every frame what exchanging each pair would take off, (n, n_pairs); its square; its freedom."""
    n, count = len(item.q), len(item.markers)
    generators = Generators.of(item, ())
    gains, square, freedom = np.empty((n, len(pairs))), np.empty(n), np.empty(n)
    a, b = np.array(pairs, dtype=np.intp).T
    for start in range(0, n, _BLOCK):
        block = slice(start, min(start + _BLOCK, n))
        gap, pose, _ = generators.at(item, block)
        basis = span(pose)
        gap = gap - np.einsum("nrq,nq->nr", basis, np.einsum("nrq,nr->nq", basis, gap))
        measured = item.task.measured[block]
        apart = np.nan_to_num(measured[:, b] - measured[:, a])
        to_a, to_b = apart / item.floor[a][:, None], -apart / item.floor[b][:, None]
        by_marker = gap.reshape(-1, count, 3)
        hidden = basis.reshape(len(gap), count, 3, -1)
        slope = (by_marker[:, a] * to_a).sum(axis=2) + (by_marker[:, b] * to_b).sum(axis=2)
        along = np.einsum("npc,npcq->npq", to_a, hidden[:, a]) + np.einsum(
            "npc,npcq->npq", to_b, hidden[:, b]
        )
        size = (to_a**2).sum(axis=2) + (to_b**2).sum(axis=2) - (along**2).sum(axis=2)
        known = item.seen[block]
        gains[block] = np.where(known[:, a] & known[:, b], -2.0 * slope - size, 0.0)
        square[block] = (gap**2).sum(axis=1)
        freedom[block] = 3.0 * known.sum(axis=1) - (basis**2).sum(axis=(1, 2))
    return gains, square, freedom


def _span(gain: Array) -> tuple[float, slice]:
    """The span of the largest sum (Bentley 1984, Commun ACM 27:865)."""
    total = np.concatenate([[0.0], np.cumsum(gain)])
    low = np.minimum.accumulate(total)
    stop = int(np.argmax(total - low))
    start = int(np.flatnonzero(total[: stop + 1] == low[stop])[-1])
    return float(total[stop] - total[start]), slice(start, stop)
