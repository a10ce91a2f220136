"""Names that were given early, compared with their rivals again once more is known.

The first name is given while everything else is still missing, and what is missing may have spoken for the
wrong place. With the others known, another candidate may explain clearly more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from scaling_service.capabilities.discovery.evidence.fitting import Account, Recording, scene_of, without
from scaling_service.capabilities.discovery.search import catalogue
from scaling_service.capabilities.discovery.search.candidates import Candidate, Contact
from scaling_service.capabilities.discovery.search.comparing import no_worse
from scaling_service.capabilities.discovery.search.findings import Named
from scaling_service.capabilities.discovery.search.hindsight import does_good, keeps_to_its_range
from scaling_service.capabilities.discovery.search.option import Option
from scaling_service.capabilities.discovery.search.options import ALIKE
from scaling_service.capabilities.discovery.search.refining import ROUGHLY, SOON, misfit, refined
from scaling_service.capabilities.discovery.search.strictness import DiscoverySettings
from scaling_service.capabilities.discovery.search.withdrawn import Withdrawable


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
    """Give every name but the last of its sort to a rival that explains clearly more, or more with less."""
    kept = list(named)
    for of_forces in (False, True):
        sort = [k for k, n in enumerate(named) if n.effect.candidate.of_forces == of_forces]
        early = [k for k in sort[:-1] if named[k].effect.candidate.columns and _rivals(named[k])]
        rivals = list(dict.fromkeys(c for k in early for c in _rivals(named[k])))
        known: Withdrawable | None = None
        for k in early:
            known = known or Withdrawable.of(now, rivals, naming.settings.stretch_s, of_forces=of_forces)
            given = _given_away(kept[k], known, now, naming)
            if given is not None:
                (kept[k], now), known = given, None
    return _touched_anew(kept, now, naming)


def _given_away(n: Named, known: Withdrawable, now: Account, naming: Naming) -> tuple[Named, Account] | None:
    """A better rival with the name, if there is one whose numbers a laboratory could meet."""
    better = better_rival(n, known.without(n.effect, _rivals(n)), naming.settings)
    if better is None:
        return None
    bare = without({n.effect.candidate.key}, now, naming.recordings)
    made = naming.name(better, bare)
    if made is None:
        return None
    of_forces = made.effect.candidate.of_forces
    tried = refined(
        bare, naming.recordings, [made.effect], naming.settings.stretch_s, SOON, of_forces=of_forces
    )
    return (replace(made, rivals=n.rivals), tried) if keeps_to_its_range(made, tried) else None


def _touched_anew(named: Sequence[Named], now: Account, naming: Naming) -> tuple[list[Named], Account]:
    """Look again for where something touches, now that more is known of the forces."""
    recordings, stretch_s = naming.recordings, naming.settings.stretch_s
    kept = list(named)
    loads = [k for k, n in enumerate(named) if n.effect.candidate.of_forces]
    for k in loads[:-1]:
        own = kept[k].effect.candidate
        if isinstance(own.change, Contact):
            bare = without({own.key}, now, recordings)
            again = catalogue.options(bare, scene_of(bare), stretch_s, of_forces=True)
            same = (o for o in again if o.candidate.kind == own.kind and o.candidate.trials == own.trials)
            best = next(same, None)
            made = None if best is None else naming.name(best, bare)
            if made is not None:
                tried = refined(bare, recordings, [made.effect], stretch_s, ROUGHLY, of_forces=True)
                if misfit(tried) < misfit(now):
                    kept[k], now = made, tried
    return kept, now


def _rivals(n: Named) -> list[Candidate]:
    own = n.effect.candidate
    return [c for c in n.rivals if c.key != own.key and c.trials == own.trials]


def better_rival(n: Named, options: Sequence[Option], settings: DiscoverySettings) -> Option | None:
    """The best of a name and its rivals, if it is a rival and chance does not make the difference.

    Nor does it where the rival needs fewer numbers for more. What looking back would drop gets no name.
    """
    best = next(iter(options), None)
    mine = next((o for o in options if o.candidate.key == n.effect.candidate.key), None)
    if best is None or best is mine or best.fitted.p > settings.level or not does_good(best, settings):
        return None
    if mine is None or len(best.candidate.columns) < len(mine.candidate.columns):
        return best
    assert best.gains is not None
    assert mine.gains is not None
    p = no_worse(best.gains, mine.gains, best.fitted.by_chance - mine.fitted.by_chance)
    return best if p <= ALIKE else None
