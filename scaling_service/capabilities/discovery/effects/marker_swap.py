"""Two labels that changed places for a while."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.laws.additions import Sized
from scaling_service.capabilities.discovery.laws.exchanges import Swap, swaps
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Exchange
from scaling_service.capabilities.discovery.search.comparing import Unseen
from scaling_service.capabilities.discovery.search.judging import Fitted
from scaling_service.capabilities.discovery.search.option import Option

KIND = "marker_swap"
MEANING = "two labels are exchanged for a while"


def options(now: Account, scene: Scene, stretch_s: float) -> Iterator[Option]:
    """The best pair and span of every trial, and of all of them where all have the same."""
    for swap in swaps(now.watched):
        where = (swap.exchange.first, swap.exchange.second)
        candidate = Candidate(KIND, where, (), trials=swap.trials, change=swap.exchange)
        yield _tried(candidate, swap, now, stretch_s)


def _tried(candidate: Candidate, swap: Swap, now: Account, stretch_s: float) -> Option:
    """An exchange takes nothing from the data but its span, so all that it explains counts as unseen."""
    shown = [w for w in now.watched if candidate.holds_in(w.name)]
    square = sum(w.square for w in shown)
    spans, pairs = len(shown[0].q), math.comb(len(shown[0].markers), 2)
    alike = max(1.0, stretch_s * shown[0].trial.rate_hz)
    strength = swap.gain / max(swap.level, 1.0) / alike
    p = min(1.0, float(np.exp(math.log(spans * pairs) - 0.5 * min(strength, 1e3))))
    fitted = Fitted(np.zeros(0), np.zeros((0, 0)), swap.gain, swap.level, p, 1.0)
    return Option(candidate, fitted, None, Unseen(swap.gain / max(square, 1e-300), p, True))


def details(effect: Sized, after: Account) -> Mapping[str, float]:
    """From when to when."""
    exchange = effect.candidate.change
    assert isinstance(exchange, Exchange)
    return {"start_s": exchange.start_s, "end_s": exchange.end_s}
