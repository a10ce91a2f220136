"""Which ordinary movement would tell an effect from those that this recording does not tell it from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scaling_service.discovery.additions import Sized
from scaling_service.discovery.candidates import Candidate
from scaling_service.discovery.evidence import gather
from scaling_service.discovery.fitting import Account
from scaling_service.discovery.judging import inverse_of
from scaling_service.discovery.movements import MOVEMENTS, RATE_HZ, coordinates_of
from scaling_service.discovery.watched import Watched
from scaling_service.kernels.laws import Array
from scaling_service.kernels.tree import marker_positions
from scaling_service.models.trial import Trial

_CLEAR = 25.0
"""Whitened square that must be left (chosen: five standard deviations of one number)."""

_NEAREST = 6  # others looked at; chosen: the rest are further off

OTHER_FORCES = "a recording with other postures, loads and speeds on the plates"


def would_separate(effect: Sized, others: Sequence[Candidate], now: Account) -> str:
    """The movement in which the nearest of the others leaves most of the effect unexplained, or ``""``."""
    if effect.candidate.of_forces:
        return OTHER_FORCES
    if not effect.candidate.columns or not now.watched:
        return ""
    best = (_CLEAR, "")
    columns = [c for c in others if c.columns and not c.of_forces][:_NEAREST]
    for movement in MOVEMENTS if columns else ():
        item = _performed(now.watched[0], movement)
        if item is not None:
            left = _left(effect, columns, item)
            if left > best[0]:
                best = left, movement
    return best[1]


def _performed(like: Watched, movement: str) -> Watched | None:
    """The same markers on the same body in another movement."""
    q = coordinates_of(like.task.model, movement)
    if q is None:
        return None
    times: Array = np.arange(len(q)) / RATE_HZ
    places = marker_positions(like.task.tree, q, like.task.p)
    trial = Trial(movement, times, like.markers, places, RATE_HZ)
    return replace(like, trial=trial, role="fit", task=replace(like.task, measured=places), q=q)


def _left(effect: Sized, others: Sequence[Candidate], item: Watched) -> float:
    """Whitened square of the effect that the best of the others cannot explain in a movement."""
    every = [replace(c, trial=None) for c in (effect.candidate, *others)]
    found = gather([item], [], every, 1.0, together=True)
    own, *rest = found.groups
    total = np.sum([s.own for s in found.stretches], axis=0)
    signal = float(effect.size @ total[own, own] @ effect.size)
    left = []
    for rows in rest:
        along = total[rows, own] @ effect.size
        inverse = inverse_of(total[rows, rows], found.raw[rows])[0]
        left.append(signal - float(along @ inverse @ along))
    return min(left)
