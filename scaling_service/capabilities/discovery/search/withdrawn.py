"""Effects taken back by their columns alone, without following the recordings anew.

Whether a name is still the best of its rivals, and whether an effect still does any good, is asked of every
effect each time that another one is found. To first order the answer lies in products of columns that are
made once: what an effect took off is put back, and it and its rivals are fitted beside everything else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.evidence.score import Evidence, Stretch
from scaling_service.capabilities.discovery.laws.additions import Sized
from scaling_service.capabilities.discovery.search.candidates import Candidate
from scaling_service.capabilities.discovery.search.option import Option
from scaling_service.capabilities.discovery.search.options import gathered, options_of
from scaling_service.numerics.multibody.laws import Array


@dataclass(frozen=True, slots=True, eq=False)
class Withdrawable:
    """All that is known of one sort, motion or forces, beside rivals.

    Parameters
    ----------
    evidence : Evidence
        Gathered together: known columns are its nuisances.
    known : tuple of Sized
    rivals : tuple of Candidate
    """

    evidence: Evidence
    known: tuple[Sized, ...]
    rivals: tuple[Candidate, ...]

    @classmethod
    def of(
        cls, now: Account, rivals: Sequence[Candidate], stretch_s: float, *, of_forces: bool
    ) -> Withdrawable:
        """Pass all recordings once."""
        known = tuple(s for s in now.everything if s.candidate.columns and s.candidate.of_forces == of_forces)
        return cls(gathered(now, rivals, stretch_s, of_forces=of_forces, together=True), known, tuple(rivals))

    def without(self, effect: Sized, rivals: Sequence[Candidate]) -> list[Option]:
        """One of the known and some of the rivals as options where that one is taken back, the best first."""
        edges = np.cumsum([0, *(len(s.candidate.columns) for s in self.known)])
        k = next(k for k, s in enumerate(self.known) if s.candidate.key == effect.candidate.key)
        own = np.arange(edges[k], edges[k + 1])
        others = np.delete(np.arange(edges[-1]), own)
        groups = [own, *(np.r_[self.evidence.groups[self.rivals.index(c)]] for c in rivals)]
        stretches = tuple(_put_back(s, own, self.known[k].size) for s in self.evidence.stretches)
        evidence = replace(self.evidence, stretches=stretches).arranged(others, groups)
        return options_of(evidence, [self.known[k].candidate, *rivals])


def _put_back(s: Stretch, own: Array, size: Array) -> Stretch:
    """A stretch in which columns of known size are no longer taken off."""
    square = s.square + float(2.0 * size @ s.scores[own] + size @ s.own[np.ix_(own, own)] @ size)
    return replace(s, scores=s.scores + s.own[:, own] @ size, square=square)
