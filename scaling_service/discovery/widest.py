"""Of the same effect in more trials and in fewer, the one in more."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from scaling_service.discovery.option import Option


def widest(passing: Sequence[Option], trials: Collection[str], fitting: Collection[str]) -> list[Option]:
    """Without what passes in more trials too, where gains cannot tell which of the two it is.

    Gains in held-out trials and in those to fit do not compare. And where two scopes hold the same trials to
    fit, gains are the same: the held-out trials have judged the wider one, and it passed.

    Parameters
    ----------
    passing : sequence of Option
    trials, fitting : collection of str
        All trials, and those of them that are to fit.
    """
    every, known = frozenset(trials), frozenset(fitting)
    scopes: dict[str, list[frozenset[str]]] = {}
    for option in passing:
        scopes.setdefault(_thing(option), []).append(frozenset(option.candidate.trials) or every)

    def covered(option: Option) -> bool:
        own = frozenset(option.candidate.trials) or every
        wider = [other & known for other in scopes[_thing(option)] if own < other]
        return any(fits and own & known in (frozenset(), fits) for fits in wider)

    return [option for option in passing if not covered(option)]


def _thing(option: Option) -> str:
    """What it is, wherever it is."""
    return replace(option.candidate, trials=()).name
