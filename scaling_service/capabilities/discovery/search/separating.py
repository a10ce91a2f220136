"""Which ordinary movement would tell an effect from those that this recording does not tell it from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.evidence.forces import gather_forces
from scaling_service.capabilities.discovery.evidence.movements import MOVEMENTS
from scaling_service.capabilities.discovery.evidence.performing import performed, performed_on_plates
from scaling_service.capabilities.discovery.evidence.score import Evidence, gather
from scaling_service.capabilities.discovery.laws.additions import Sized
from scaling_service.capabilities.discovery.search.candidates import Candidate
from scaling_service.capabilities.discovery.search.judging import inverse_of
from scaling_service.numerics.multibody.laws import Array

_CLEAR = 25.0
"""Whitened square that must be left (chosen: five standard deviations of one number)."""

_STRETCH_S = 1.0
_NEAREST = 6  # others looked at; chosen: the rest are further off


def would_separate(effect: Sized, others: Sequence[Candidate], now: Account) -> str:
    """The movement in which the nearest of the others leaves most of the effect unexplained, or ``""``."""
    own = effect.candidate
    columns = [c for c in others if c.columns and c.of_forces == own.of_forces][:_NEAREST]
    if not own.columns or not columns or not now.watched:
        return ""
    best = (_CLEAR, "")
    every = [replace(c, trials=()) for c in (own, *columns)]
    for movement in MOVEMENTS:
        shown = _shown(every, now, movement)
        if shown is not None:
            left = _left(effect.size, shown)
            if left > best[0]:
                best = left, movement
    return best[1]


def _shown(candidates: Sequence[Candidate], now: Account, movement: str) -> Evidence | None:
    """What a movement would show of candidates: among the markers, or on plates under the feet."""
    if candidates[0].of_forces:
        made = (performed_on_plates(item, movement) for item in now.weighed)
        weighed = next((item for item in made if item is not None), None)
        if weighed is None:
            return None
        return gather_forces([weighed], [], candidates, _STRETCH_S, together=True)
    item = performed(now.watched[0], movement)
    return None if item is None else gather([item], [], candidates, _STRETCH_S, together=True)


def _left(size: Array, shown: Evidence) -> float:
    """Whitened square of the first candidate, of that size, that the best of the others cannot explain."""
    own, *rest = shown.groups
    total = np.sum([s.own for s in shown.stretches], axis=0)
    signal = float(size @ total[own, own] @ size)
    left = []
    for rows in rest:
        along = total[rows, own] @ size
        inverse = inverse_of(total[rows, rows], shown.raw[rows])[0]
        left.append(signal - float(along @ inverse @ along))
    return min(left)
