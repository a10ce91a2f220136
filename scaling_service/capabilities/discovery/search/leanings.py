"""What a person's recordings say of effects of the model, named or not, free of the prior."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from scaling_service.capabilities.discovery.laws.candidates import Candidate
from scaling_service.core.arrays import Array

OF_MODELS = ("segment_mass", "segment_com", "joint_centre_offset", "joint_axis_tilt", "coupled_motion")
"""What a generic model brings to all persons alike; sizes and markers' places are each person's own."""

_LEAST = 1e-12  # of the prior's variance that a posterior may leave


@dataclass(frozen=True, slots=True, eq=False)
class Leanings:
    """Log likelihood ``x'b - b'Xb/2`` of the numbers b of some candidates together, one after the other."""

    candidates: tuple[Candidate, ...] = ()
    score: Array = field(default_factory=lambda: np.zeros(0))  # (n,): x, SI
    information: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (n, n): X
    sd: Array = field(default_factory=lambda: np.zeros(0))  # (n,): prior deviations

    @classmethod
    def of(cls, candidate: Candidate, size: Array, covariance: Array, sd: Array) -> Leanings:
        """Of one, from a posterior (k,), (k, k) about a prior of independent deviations about zero."""
        values, vectors = np.linalg.eigh(covariance / np.outer(sd, sd))
        inverse = (vectors / np.maximum(values, _LEAST)) @ vectors.T / np.outer(sd, sd)
        return cls((candidate,), inverse @ size, np.asarray(inverse - np.diag(sd**-2.0)), sd)

    @classmethod
    def join(cls, parts: Sequence[Leanings]) -> Leanings:
        """Of several that say nothing of each other."""
        if not parts:
            return cls()
        return cls(
            tuple(c for part in parts for c in part.candidates),
            np.concatenate([part.score for part in parts]),
            np.asarray(scipy.linalg.block_diag(*(part.information for part in parts))),
            np.concatenate([part.sd for part in parts]),
        )

    def rows(self) -> Iterator[tuple[Candidate, slice]]:
        """Each candidate with where its numbers stand."""
        at = 0
        for candidate in self.candidates:
            yield candidate, slice(at, at + len(candidate.columns))
            at += len(candidate.columns)

    def each(self) -> Iterator[tuple[Candidate, Array, Array, Array]]:
        """Each candidate with its size (k,), covariance (k, k) and prior (k,), were there only that one."""
        for candidate, at in self.rows():
            covariance = np.linalg.inv(self.information[at, at] + np.diag(self.sd[at] ** -2.0))
            yield candidate, covariance @ self.score[at], np.asarray(covariance), self.sd[at]
