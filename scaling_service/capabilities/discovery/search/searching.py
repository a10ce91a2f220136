"""Round after round names are given until nothing passes; then what is superfluous is dropped.

What is dropped may have stood in the place of something else, so the search goes on where something was.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from scaling_service.capabilities.discovery.disturbances.laws import foreign
from scaling_service.capabilities.discovery.disturbances.search import stranger
from scaling_service.capabilities.discovery.evidence.fitting import Account, Recording, account, scene_of
from scaling_service.capabilities.discovery.laws.additions import Sized
from scaling_service.capabilities.discovery.search.candidates import Masked
from scaling_service.capabilities.discovery.search.choosing import chosen, tuned_name
from scaling_service.capabilities.discovery.search.findings import Foreign, Named
from scaling_service.capabilities.discovery.search.hindsight import without_the_superfluous
from scaling_service.capabilities.discovery.search.options import Options, look
from scaling_service.capabilities.discovery.search.pairs import two_of_one_marker, two_of_one_plate
from scaling_service.capabilities.discovery.search.rivals import Naming, revisited
from scaling_service.capabilities.discovery.search.strictness import DiscoverySettings
from scaling_service.capabilities.discovery.search.trying import tried_in_full

Progress = Callable[[str, float], None]

_TIMES = 3  # that names are given and looked back at, at most (chosen)
_DONE = 0.8  # of the work, when the search is over


@dataclass(slots=True, eq=False)
class Search:
    """What was named so far, and what was tried in vain.

    Parameters
    ----------
    recordings : sequence of Recording
    settings : DiscoverySettings
    report : callable
    now : Account
        With all that was named.
    named : list of Named
    refused : set of str
        Keys of candidates.
    early : set of str
        Those of them that may be tried again when more is known of the forces.
    options : Options, optional
        What the last round saw.
    odd_law : Foreign, optional
        A law that no effect has and that ends the search.
    share : float
        Of the work, as it was reported last.
    """

    recordings: Sequence[Recording]
    settings: DiscoverySettings
    report: Progress
    now: Account
    named: list[Named] = field(default_factory=list)
    refused: set[str] = field(default_factory=set)
    early: set[str] = field(default_factory=set)
    options: Options | None = None
    odd_law: Foreign | None = None
    share: float = 0.0

    def finish(self) -> Options:
        """Until nothing passes and nothing is superfluous; returns what the last round saw."""
        for _ in range(_TIMES):
            while self._round():
                pass
            self._tell("looking back", _DONE)
            if not self._dropped() or self.odd_law is not None:
                break
        assert self.options is not None
        return self.options

    def _round(self) -> bool:
        """Name what passes best; whether to go on."""
        settings = self.settings
        self._tell(f"looking for effect {len(self.named) + 1}", _DONE * len(self.named) / settings.most)
        now = self.now
        options = look(now, scene_of(now), settings.stretch_s, settings.shortlist, self.options)
        self.options = options
        found = chosen(now, options, self.named, self.refused, settings)
        self.odd_law = foreign(now, options, settings)
        if self.odd_law is not None:
            return False
        masked = [e for e in now.effects if isinstance(e.candidate.change, Masked)]
        odd = stranger(now, options, settings) if len(masked) < settings.strangers else None
        pair = [] if odd is None else two_of_one_marker(odd, now, self._naming(options), self.refused)
        if odd is not None and not pair:
            left_out = Sized(odd.candidate, np.zeros(0))
            self.now = account(now.model, self.recordings, now.free, (*now.effects, left_out), now)
            return True
        found = pair or found
        if found:
            self._try(found, options)
        return bool(found)

    def _try(self, found: Sequence[Named], options: Options) -> None:
        """Add what holds, and compare names that were given before with their rivals."""
        tried = tried_in_full(self.now, found, self.recordings, self.settings)
        self.now = tried.account
        self.early |= tried.early
        self.refused |= tried.refused | tried.early
        if any(n.effect.candidate.of_forces for n in tried.added):
            self.refused -= self.early
            self.early.clear()
        if tried.added:
            named = [*self.named, *tried.added]
            self.named, self.now = revisited(named, self.now, self._naming(options))

    def _dropped(self) -> bool:
        """Whether something of what was named is superfluous; it is dropped, and refused from now on."""
        assert self.options is not None
        if self.named or self.odd_law is None:  # nothing is named in the stead of a law that no effect has
            naming = self._naming(self.options)
            self.named, self.now = two_of_one_plate(self.named, self.now, naming)
        given = {n.effect.candidate.key for n in self.named}
        self.named, self.now = without_the_superfluous(self.named, self.now, self.recordings, self.settings)
        dropped = given - {n.effect.candidate.key for n in self.named}
        self.refused |= dropped
        return bool(dropped)

    def _tell(self, what: str, share: float) -> None:
        self.share = max(self.share, min(share, _DONE))
        self.report(what, self.share)

    def _naming(self, options: Options) -> Naming:
        name = partial(tuned_name, options=options, settings=self.settings)
        return Naming(self.recordings, self.settings, options.count, name)
