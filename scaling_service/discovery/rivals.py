"""Names that were given early, compared with their rivals again once more is known.

The first name is given while everything else is still missing, and what is missing may have spoken for the
wrong place. With the others known, another candidate may explain clearly more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from scaling_service.discovery.comparing import no_worse
from scaling_service.discovery.findings import Named
from scaling_service.discovery.fitting import Account, Recording, account, reweighed
from scaling_service.discovery.option import Option
from scaling_service.discovery.options import ALIKE, compared
from scaling_service.discovery.refining import ROUGHLY, refined
from scaling_service.discovery.strictness import DiscoverySettings


@dataclass(frozen=True, slots=True)
class Naming:
    """What it takes to give a name anew.

    Parameters
    ----------
    recordings : sequence of Recording
    settings : DiscoverySettings
    count : int
        Of the options among which names are chosen.
    name : callable
        Makes a named effect of an option, in an account.
    """

    recordings: Sequence[Recording]
    settings: DiscoverySettings
    count: int
    name: Callable[[Option, Account], Named | None]


def revisited(named: Sequence[Named], now: Account, naming: Naming) -> tuple[list[Named], Account]:
    """Give every name but the last of its sort to the rival that explains clearly more, if one does."""
    recordings, settings = naming.recordings, naming.settings
    kept = list(named)
    for k, n in enumerate(named):
        later = [m for m in named[k + 1 :] if m.effect.candidate.of_forces == n.effect.candidate.of_forces]
        if later and n.rivals and n.effect.candidate.columns:
            without = _without(n, now, recordings)
            better = _better(n, without, settings)
            made = None if better is None else naming.name(better, without)
            if made is not None:
                kept[k] = replace(made, rivals=n.rivals)
                of_forces = n.effect.candidate.of_forces
                now = refined(
                    without, recordings, [made.effect], settings.stretch_s, ROUGHLY, of_forces=of_forces
                )
    return kept, now


def _without(n: Named, now: Account, recordings: Sequence[Recording]) -> Account:
    others = tuple(e for e in now.effects if e.candidate.key != n.effect.candidate.key)
    if n.effect.candidate.of_forces:
        return reweighed(replace(now, effects=others), recordings)
    return account(now.model, recordings, now.free, others, now)


def _better(n: Named, without: Account, settings: DiscoverySettings) -> Option | None:
    """The best of the rivals, if chance does not make the difference."""
    own = n.effect.candidate
    choice = [own, *(c for c in n.rivals if c.key != own.key and c.trials == own.trials)]
    options = compared(without, choice, settings.stretch_s, len(choice))
    best = max(options, key=lambda o: o.fitted.expected, default=None)
    mine = next((o for o in options if o.candidate.key == own.key), None)
    if best is None or best is mine or best.unseen.p > settings.level or best.unseen.gain <= 0.0:
        return None
    if mine is None:
        return best
    assert best.gains is not None
    assert mine.gains is not None
    p = no_worse(best.gains, mine.gains, best.fitted.by_chance - mine.fitted.by_chance)
    return best if p <= ALIKE else None
