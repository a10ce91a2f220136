"""What is named next: the best effect of the motion with its companions, and the best of the forces.

One effect after the other would be slow where much is missing, and would leave no room for small ones. So
others of the motion are named along with the best if they pass beside it and explain most of what they do
without it: then they are no shadows of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scaling_service.capabilities.discovery.evidence.fitting import Account, scene_of
from scaling_service.capabilities.discovery.laws.additions import Sized
from scaling_service.capabilities.discovery.laws.tuning import tuned
from scaling_service.capabilities.discovery.search.candidates import Candidate
from scaling_service.capabilities.discovery.search.findings import Named
from scaling_service.capabilities.discovery.search.nameable import smallest_nameable
from scaling_service.capabilities.discovery.search.option import Option
from scaling_service.capabilities.discovery.search.options import Options, confusable, gathered, options_of
from scaling_service.capabilities.discovery.search.separating import would_separate
from scaling_service.capabilities.discovery.search.strictness import DiscoverySettings
from scaling_service.capabilities.discovery.search.widest import widest

_COMPANIONS = 3  # named along with the best effect of the motion at most (chosen)
_MOST = 0.5  # chosen: of what a companion explains, what it must explain beside the others
_WORTH = 0.1
"""Of what the best explains, what a companion must (chosen: what the law of a large effect misses, being one
of small effects, is less: of 12 degrees 1 %)."""


def chosen(
    now: Account,
    options: Options,
    named: Sequence[Named],
    refused: set[str],
    settings: DiscoverySettings,
) -> list[Named]:
    """The best of the motion and of the forces that pass, as far as there is room, with their companions.

    Parameters
    ----------
    named : sequence of Named
        So far.
    refused : set of str
        Keys of candidates that were tried in vain; more may be added.
    """
    found: list[Named] = []
    trials = [item.name for item in now.watched]
    fitting = [item.name for item in now.watched if item.role == "fit"]
    for of_forces in (False, True):
        room = settings.most - sum(n.effect.candidate.of_forces == of_forces for n in named)
        passing = [
            o for o in options.best if o.candidate.of_forces == of_forces and _passes(o, options, settings)
        ]
        passing = widest(passing, trials, fitting)
        first = _first(passing, options, now, refused, settings) if room > 0 else None
        if first is not None:
            others = [o for o in passing if o.candidate.key not in refused and not o.candidate.of_forces]
            found += [first, *_companions(first, others, options, now, settings)[: room - 1]]
    return found


def _companions(
    first: Named, passing: Sequence[Option], options: Options, now: Account, settings: DiscoverySettings
) -> list[Named]:
    """Effects that explain beside the first, and beside each other, most of what each does alone."""
    worth = _WORTH * first.fitted.expected
    plain = [o for o in passing if o.candidate.columns and o.candidate.swing is None]
    left = {o.candidate.key: o for o in plain if o.fitted.expected > worth}
    left.pop(first.effect.candidate.key, None)
    choice = [first.effect.candidate, *(o.candidate for o in left.values())]
    found = [first]
    if not left or not first.effect.candidate.columns:
        return []
    evidence = gathered(now, choice, settings.stretch_s, of_forces=False, together=True)
    columns = {c.key: np.r_[rows] for c, rows in zip(choice, evidence.groups, strict=True)}
    free = np.arange(evidence.nuisances)
    while left and len(found) <= _COMPANIONS:
        known = np.concatenate([free, *(columns[n.effect.candidate.key] for n in found)])
        rest = [o.candidate for o in left.values()]
        again = options_of(evidence.arranged(known, [columns[c.key] for c in rest]), rest)
        still = [
            left[o.candidate.key]
            for o in again
            if o.fitted.expected > _MOST * left[o.candidate.key].fitted.expected
            and _passes(o, options, settings)
        ]
        left = {o.candidate.key: o for o in still[1:]}
        found += [_named(o, options, now, settings) for o in still[:1]]
    return found[1:]


def _first(
    passing: Sequence[Option],
    options: Options,
    now: Account,
    refused: set[str],
    settings: DiscoverySettings,
) -> Named | None:
    """The best that is not refused; what swings is refused if no plausible swing fits."""
    for option in passing:
        if option.candidate.key not in refused:
            named = tuned_name(option, now, options, settings)
            if named is not None:
                return named
            refused.add(option.candidate.key)
    return None


def tuned_name(option: Option, now: Account, options: Options, settings: DiscoverySettings) -> Named | None:
    """An option as a named effect, at the frequency that explains most; None where no swing is plausible."""
    best = tuned(option, now, scene_of(now), settings.stretch_s)
    return None if best is None else _named(best, options, now, settings)


def _passes(option: Option, options: Options, settings: DiscoverySettings) -> bool:
    fitted, tried = option.fitted, option.unseen
    likely = fitted.p * options.count <= settings.level and fitted.expected > 0.0
    return likely and tried.p <= settings.level and tried.gain > 0.0


def _named(option: Option, options: Options, now: Account, settings: DiscoverySettings) -> Named:
    effect = Sized(option.candidate, option.fitted.size)
    twins = confusable(option, options.best)
    return Named(
        effect,
        option.fitted.spread,
        {},
        {},
        smallest_nameable(effect, option.fitted, settings.level / options.count),
        option.fitted,
        min(1.0, option.fitted.p * options.count),
        option.unseen,
        twins,
        would_separate(effect, twins, now) if twins else "",
        tuple(o.candidate for o in options.best if _comparable(o.candidate, option.candidate)),
    )


def _comparable(other: Candidate, candidate: Candidate) -> bool:
    """Whether both are sums of columns of the same sort."""
    return bool(other.columns and candidate.columns) and other.of_forces == candidate.of_forces
