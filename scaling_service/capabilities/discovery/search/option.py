"""A candidate, fitted and tried on what did not fit it."""

from __future__ import annotations

from dataclasses import dataclass

from scaling_service.capabilities.discovery.search.candidates import Candidate
from scaling_service.capabilities.discovery.search.comparing import Unseen
from scaling_service.capabilities.discovery.search.judging import Fitted
from scaling_service.numerics.multibody.laws import Array


@dataclass(frozen=True, slots=True, eq=False)
class Option:
    """What could be the next effect.

    Parameters
    ----------
    candidate : Candidate
    fitted : Fitted
    gains : ndarray, shape (n_stretches,), or None
        What it takes off each stretch that decides for it.
    unseen : Unseen
    alike : tuple of Candidate
        Those that are known not to be told from it.
    """

    candidate: Candidate
    fitted: Fitted
    gains: Array | None
    unseen: Unseen
    alike: tuple[Candidate, ...] = ()
