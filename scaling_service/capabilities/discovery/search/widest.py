"""Of the same effect in several scopes that are not told apart, one: in more trials, or in the later ones."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from scaling_service.capabilities.discovery.search.option import Option

_AS_GOOD = 0.95
"""Of what an effect in the first trial and not in others explains, what it must explain in these and not in
the first so that it is the same said the other way round (chosen)."""


def widest(passing: Sequence[Option], trials: Sequence[str], fitting: Collection[str]) -> list[Option]:
    """Without what passes in more trials too, or in all others, where gains cannot tell which it is.

    Gains in held-out trials and in those to fit do not compare. And where two scopes hold the same trials to
    fit, gains are the same: the held-out trials have judged the wider one, and it passed. Where what it
    changes is free in all trials, it explains as much in all others, reversed: then the model is taken to be
    right in the first trial, for what changes, changes later.

    Parameters
    ----------
    passing : sequence of Option
    trials : sequence of str
        All trials, in their order.
    fitting : collection of str
        Those of them that are to fit.
    """
    every, known = frozenset(trials), frozenset(fitting)
    scopes: dict[str, dict[frozenset[str], float]] = {}
    for option in passing:
        scopes.setdefault(_thing(option), {})[_scope(option, every)] = option.fitted.expected

    def covered(option: Option) -> bool:
        own, all_scopes = _scope(option, every), scopes[_thing(option)]
        wider = [other & known for other in all_scopes if own < other]
        return any(fits and own & known in (frozenset(), fits) for fits in wider)

    def reversed_later(option: Option) -> bool:
        own = _scope(option, every)
        others = scopes[_thing(option)].get(every - own, 0.0)
        return trials[0] in own and others > _AS_GOOD * option.fitted.expected

    return [option for option in passing if not covered(option) and not reversed_later(option)]


def _scope(option: Option, every: frozenset[str]) -> frozenset[str]:
    return frozenset(option.candidate.trials) or every


def _thing(option: Option) -> str:
    """What it is, wherever it is."""
    return replace(option.candidate, trials=()).name
