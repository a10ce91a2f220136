"""Two labels that changed places for a while."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.effects.catalogue import Effect
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate
from scaling_service.capabilities.discovery.evidence.statistics import Fitted, HeldOut, find_best_span
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate, Exchange
from scaling_service.capabilities.discovery.laws.spots import Generators
from scaling_service.capabilities.discovery.observations.tracked import TrackedTrial
from scaling_service.core.threads import map_parallel
from scaling_service.numerics.multibody.laws import Array

_CHUNK = 128
_SAME_S = 0.1  # chosen: times of one script differ by less from trial to trial
_SHORTEST = 3  # frames; chosen: fewer are a flicker that does no harm


@dataclass(frozen=True, slots=True, eq=False)
class Swap:
    """Two labels exchanged for some frames."""

    exchange: Exchange
    trials: tuple[str, ...]  # those in which they are; all of them unless given
    gain: float  # fall of the whitened sum of squares
    level: float  # whitened square of one number in the other frames


def find_swaps(fit: Fit) -> Iterator[ScoredCandidate]:
    """The best pair and span of every trial, and of all of them where all have the same."""
    found = [swap for swap in map_parallel(_find_best, fit.tracked) if swap is not None]
    together = _join_swaps(found)
    for swap in found if together is None or len(found) < len(fit.tracked) else [*found, together]:
        yield _score_swap(swap, fit)


def _score_swap(swap: Swap, fit: Fit) -> ScoredCandidate:
    """An exchange takes nothing from the data but its span, so all that it explains counts as held out."""
    where = (swap.exchange.first, swap.exchange.second)
    candidate = Candidate(
        kind="marker_swap", where=where, columns=(), trials=swap.trials, change=swap.exchange
    )
    shown = [w for w in fit.tracked if candidate.holds_in(w.name)]
    square = sum(w.square for w in shown)
    spans, pairs = len(shown[0].q), math.comb(len(shown[0].markers), 2)
    alike = max(1.0, fit.settings.block_s * shown[0].trial.rate_hz)
    strength = swap.gain / max(swap.level, 1.0) / alike
    p = min(1.0, float(np.exp(math.log(spans * pairs) - 0.5 * min(strength, 1e3))))
    fitted = Fitted.of_any_course(swap.gain, swap.level, p)
    return ScoredCandidate(
        candidate=candidate,
        fitted=fitted,
        gains=None,
        held_out=HeldOut(swap.gain / max(square, 1e-300), p, folds=True),
    )


def _join_swaps(found: Sequence[Swap]) -> Swap | None:
    """One exchange for all trials, where all have the same pair at the same times."""
    spans = np.array([(s.exchange.start_s, s.exchange.end_s) for s in found])
    pairs = {(s.exchange.first, s.exchange.second) for s in found}
    if len(found) < 2 or len(pairs) > 1 or np.ptp(spans, axis=0).max() > _SAME_S:
        return None
    exchange = Exchange(*pairs.pop(), *np.median(spans, axis=0).tolist())
    return Swap(exchange, (), sum(s.gain for s in found), max(s.level for s in found))


def _find_best(item: TrackedTrial) -> Swap | None:
    pairs = list(combinations(range(len(item.markers)), 2))
    if not pairs:
        return None
    gains, square, freedom = _measure_gains(item, pairs)
    spans = [find_best_span(gains[:, k]) for k in range(len(pairs))]
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


def _measure_gains(item: TrackedTrial, pairs: Sequence[tuple[int, int]]) -> tuple[Array, Array, Array]:
    """Of every frame what exchanging each pair would take off, (n, n_pairs); its square; its freedom."""
    generators = Generators.of(item, ())
    a, b = np.array(pairs, dtype=np.intp).T

    def of(chunk: slice) -> tuple[Array, Array, Array]:
        return _measure_gains_in(chunk, item, generators, a, b)

    gains, square, freedom = zip(*map_parallel(of, item.chunks(_CHUNK)), strict=True)
    return np.concatenate(gains), np.concatenate(square), np.concatenate(freedom)


def _measure_gains_in(
    chunk: slice, item: TrackedTrial, generators: Generators, a: NDArray[np.intp], b: NDArray[np.intp]
) -> tuple[Array, Array, Array]:
    """The same in some frames.

    An exchange moves the first by d and the second by -d. What the pose hides of that is the square of
    (H_a / f_a - H_b / f_b)' d, with H the rows of a marker in the pose's basis and f the floors.
    """
    gap, _, _, basis = generators.free_of_pose(item, chunk)
    known, n, count = item.seen[chunk], len(gap), len(item.markers)
    apart = np.nan_to_num(item.task.measured[chunk][:, b] - item.task.measured[chunk][:, a])
    pull = gap.reshape(n, count, 3) / item.floor[:, None]
    slope = ((pull[:, a] - pull[:, b]) * apart).sum(axis=2)
    rows = basis / np.repeat(item.floor, 3)
    hidden = (rows.transpose(0, 2, 1) @ rows).reshape(n, count, 3, count, 3)
    both = hidden[:, a, :, a] + hidden[:, b, :, b] - hidden[:, a, :, b] - hidden[:, b, :, a]
    size = (apart**2).sum(axis=2) * (item.floor[a] ** -2 + item.floor[b] ** -2)
    size -= np.einsum("npc,pncd,npd->np", apart, both, apart, optimize=True)
    gains = np.where(known[:, a] & known[:, b], -2.0 * slope - size, 0.0)
    return gains, (gap**2).sum(axis=1), 3.0 * known.sum(axis=1) - (basis**2).sum(axis=(1, 2))


def _describe_swap(effect: Estimate, _after: Fit) -> Mapping[str, float]:
    """From when to when."""
    exchange = effect.candidate.change
    assert isinstance(exchange, Exchange)
    return {"start_s": exchange.start_s, "end_s": exchange.end_s}


EFFECTS = (
    Effect(
        kind="marker_swap",
        meaning="two labels are exchanged for a while",
        search=find_swaps,
        details=_describe_swap,
    ),
)
