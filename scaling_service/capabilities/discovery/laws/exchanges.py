"""Two labels that changed places for a while."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.evidence.watched import Watched
from scaling_service.capabilities.discovery.laws.at_once import each
from scaling_service.capabilities.discovery.laws.generators import Generators, span
from scaling_service.capabilities.discovery.search.candidates import Exchange
from scaling_service.numerics.multibody.laws import Array

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
    n, generators = len(item.q), Generators.of(item, ())
    a, b = np.array(pairs, dtype=np.intp).T

    def of(start: int) -> tuple[Array, Array, Array]:
        return _gains_in(slice(start, min(start + _BLOCK, n)), item, generators, a, b)

    gains, square, freedom = zip(*each(of, range(0, n, _BLOCK)), strict=True)
    return np.concatenate(gains), np.concatenate(square), np.concatenate(freedom)


def _gains_in(
    block: slice, item: Watched, generators: Generators, a: NDArray[np.intp], b: NDArray[np.intp]
) -> tuple[Array, Array, Array]:
    """The same in some frames.

    An exchange moves the first by d and the second by -d. What the pose hides of that is the square of
    (H_a / f_a - H_b / f_b)' d, with H the rows of a marker in the pose's basis and f the floors.
    """
    gap, pose, _ = generators.at(item, block)
    basis = span(pose)
    gap = gap - np.einsum("nrq,nq->nr", basis, np.einsum("nrq,nr->nq", basis, gap))
    known, n, count = item.seen[block], len(gap), len(item.markers)
    apart = np.nan_to_num(item.task.measured[block][:, b] - item.task.measured[block][:, a])
    pull = gap.reshape(n, count, 3) / item.floor[:, None]
    slope = ((pull[:, a] - pull[:, b]) * apart).sum(axis=2)
    rows = basis / np.repeat(item.floor, 3)[:, None]
    hidden = (rows @ rows.transpose(0, 2, 1)).reshape(n, count, 3, count, 3)
    both = hidden[:, a, :, a] + hidden[:, b, :, b] - hidden[:, a, :, b] - hidden[:, b, :, a]
    size = (apart**2).sum(axis=2) * (item.floor[a] ** -2 + item.floor[b] ** -2)
    size -= np.einsum("npc,pncd,npd->np", apart, both, apart, optimize=True)
    gains = np.where(known[:, a] & known[:, b], -2.0 * slope - size, 0.0)
    return gains, (gap**2).sum(axis=1), 3.0 * known.sum(axis=1) - (basis**2).sum(axis=(1, 2))


def _span(gain: Array) -> tuple[float, slice]:
    """The span of the largest sum (Bentley 1984, Commun ACM 27:865)."""
    total = np.concatenate([[0.0], np.cumsum(gain)])
    low = np.minimum.accumulate(total)
    stop = int(np.argmax(total - low))
    start = int(np.flatnonzero(total[: stop + 1] == low[stop])[-1])
    return float(total[stop] - total[start]), slice(start, stop)
