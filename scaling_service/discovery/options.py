"""All that could be the next effect, side by side: columns, locked motions, exchanged labels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.discovery.candidates import Candidate, Contact, FreeMotion
from scaling_service.discovery.catalogue import candidates as catalogue
from scaling_service.discovery.comparing import Unseen, explained, no_worse, unseen
from scaling_service.discovery.contacts import Touch, touches
from scaling_service.discovery.evidence import Evidence, gather
from scaling_service.discovery.exchanges import Swap, swaps
from scaling_service.discovery.fitting import Account
from scaling_service.discovery.forces import gather_forces
from scaling_service.discovery.freedoms import Freedom, freedoms
from scaling_service.discovery.judging import Fitted, fit_each
from scaling_service.discovery.scene import Scene
from scaling_service.kernels.laws import Array

ALIKE = 0.05
"""Chance of so large a lead above which two candidates count as not told apart (chosen: the custom)."""


@dataclass(frozen=True, slots=True, eq=False)
class Option:
    """A candidate, fitted and tried on what did not fit it.

    Parameters
    ----------
    gains : ndarray, shape (n_stretches,), or None
        What it takes off each stretch of the trials that are to fit, or of its own trial.
    alike : tuple of Candidate
        Those that are known not to be told from it.
    """

    candidate: Candidate
    fitted: Fitted
    gains: Array | None
    unseen: Unseen
    alike: tuple[Candidate, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Options:
    """The best, the best first, and among how many they were chosen."""

    best: list[Option]
    count: int


def look(now: Account, scene: Scene, stretch_s: float, shortlist: int) -> Options:
    """Try everything in the catalogue at every place.

    Parameters
    ----------
    shortlist : int
        How many to try on what did not fit them.
    """
    taken = {s.candidate.name for s in now.everything}
    free = [_of_freedom(f) for f in freedoms(scene, now.watched, stretch_s)]
    exchanged = [_of_swap(s, now, stretch_s) for s in swaps(now.watched)]
    touched = [_of_touch(t) for t in touches(now.weighed, stretch_s) if not _touched(t.candidate, now)]
    every = [c for c in catalogue(scene) if c.name not in taken]
    columns = _columns(now, [c for c in every if not c.of_forces], stretch_s, shortlist)
    loads = _columns(now, [c for c in every if c.of_forces], stretch_s, shortlist)
    others = [o for o in (*free, *exchanged, *touched) if o.candidate.name not in taken]
    best = sorted((*columns, *loads, *others), key=lambda o: -o.fitted.expected)
    return Options(best, len(every) + len(free) + len(exchanged) + len(touched))


def _columns(now: Account, choice: Sequence[Candidate], stretch_s: float, shortlist: int) -> list[Option]:
    """Candidates that all show among the markers, or all in the wrench."""
    if not choice:
        return []
    of_forces = choice[0].of_forces
    known = [s.candidate for s in now.everything if s.candidate.columns]
    known = [c for c in known if c.of_forces == of_forces]

    def passed(candidates: Sequence[Candidate], *, together: bool) -> Evidence:
        if of_forces:
            return gather_forces(now.weighed, known, candidates, stretch_s, together=together)
        return gather(now.watched, known, candidates, stretch_s, together=together)

    fitted = fit_each(passed(choice, together=False), choice)
    likely = [k for k, c in enumerate(choice) if _plausible(c, fitted[k])]
    order = sorted(likely, key=lambda k: -fitted[k].expected)[:shortlist]
    picked = [choice[k] for k in order]
    detail = passed(picked, together=True)
    found = []
    for at, k in enumerate(order):
        trial = choice[k].trial
        here = [s for s in detail.stretches if (s.role == "fit" if trial is None else s.trial == trial)]
        gains = explained(detail, at, here).gains
        found.append(Option(choice[k], fitted[k], gains, unseen(detail, at, choice[k])))
    return found


def _plausible(candidate: Candidate, fitted: Fitted) -> bool:
    """Whether every number lies in its range, give or take its own deviation."""
    if not len(fitted.size):
        return False
    spread = np.sqrt(np.diag(fitted.covariance))
    return all(
        column.plausible(size - sd) or column.plausible(size + sd) or column.plausible(size)
        for column, size, sd in zip(candidate.columns, fitted.size.tolist(), spread.tolist(), strict=True)
    )


def _touched(candidate: Candidate, now: Account) -> bool:
    """Whether a contact at this segment is known already, in the same trial or in all."""
    known = [e.candidate for e in now.effects if isinstance(e.candidate.change, Contact)]
    return any(c.where == candidate.where and (c.trial is None or c.trial == candidate.trial) for c in known)


def _of_touch(touch: Touch) -> Option:
    tried = Unseen(touch.gain_share, touch.fitted.p, True)
    return Option(touch.candidate, touch.fitted, None, tried, touch.others)


def _of_freedom(free: Freedom) -> Option:
    return Option(free.candidate, free.fitted, free.gains, Unseen(free.unseen_gain, free.unseen_p, False))


def _of_swap(swap: Swap, now: Account, stretch_s: float) -> Option:
    """An exchange takes nothing from the data but its span, so all that it explains counts as unseen."""
    item = next(w for w in now.watched if swap.candidate.trial in (None, w.name))
    square = sum(w.square for w in now.watched if swap.candidate.trial in (None, w.name))
    n, pairs = len(item.q), math.comb(len(item.markers), 2)
    alike = max(1.0, stretch_s * item.trial.rate_hz)
    strength = swap.gain / max(swap.level, 1.0) / alike
    p = min(1.0, float(np.exp(math.log(n * pairs) - 0.5 * min(strength, 1e3))))
    fitted = Fitted(np.zeros(0), np.zeros((0, 0)), swap.gain, swap.level, p, 1.0)
    return Option(swap.candidate, fitted, None, Unseen(swap.gain / max(square, 1e-300), p, True))


def confusable(option: Option, others: Sequence[Option]) -> tuple[Candidate, ...]:
    """The candidates that explain what this one does so nearly as well that chance could make the difference.

    A motion that may take any course could always stand for one that follows a law, so it does not count.
    """
    if option.gains is None:
        return option.alike
    found = []
    for other in others:
        comparable = other.gains is not None and len(other.gains) == len(option.gains)
        looser = isinstance(other.candidate.change, FreeMotion) and option.candidate.change is None
        same = other.candidate.trial == option.candidate.trial
        alike = other.candidate.of_forces == option.candidate.of_forces
        if other is not option and comparable and same and alike and not looser:
            assert other.gains is not None
            p = no_worse(option.gains, other.gains, option.fitted.by_chance - other.fitted.by_chance)
            if p > ALIKE:
                found.append((p, other.candidate))
    return tuple(candidate for _, candidate in sorted(found, key=lambda item: -item[0]))
