"""What a person's recordings say of an effect of the model, named or not, free of the prior."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scaling_service.capabilities.discovery.laws.candidates import Candidate
from scaling_service.core.arrays import Array

OF_MODELS = ("segment_mass", "segment_com", "joint_centre_offset", "joint_axis_tilt", "coupled_motion")
"""What a generic model brings to all persons alike; sizes and markers' places are each person's own."""


_LEAST = 1e-12  # of the prior's variance that a posterior may leave


@dataclass(frozen=True, slots=True, eq=False)
class Leaning:
    """Score x (k,) and information X (k, k) of a candidate's numbers: log likelihood ``x'b - b'Xb/2``."""

    candidate: Candidate
    score: Array
    information: Array
    sd: Array  # (k,): prior deviations

    @classmethod
    def of(cls, candidate: Candidate, size: Array, covariance: Array, sd: Array) -> Leaning:
        """From a posterior about a prior of independent deviations about zero."""
        values, vectors = np.linalg.eigh(covariance / np.outer(sd, sd))
        inverse = (vectors / np.maximum(values, _LEAST)) @ vectors.T / np.outer(sd, sd)
        return cls(candidate, inverse @ size, np.asarray(inverse - np.diag(sd**-2.0)), sd)

    def rescale(self, unit: float) -> Leaning:
        """Of numbers in another unit: one of the new is ``unit`` of the old."""
        return replace(
            self, score=unit * self.score, information=unit**2 * self.information, sd=self.sd / unit
        )

    def solve(self) -> tuple[Array, Array]:
        """Size (k,) and covariance (k, k), about the prior."""
        covariance = np.linalg.inv(self.information + np.diag(self.sd**-2.0))
        return covariance @ self.score, np.asarray(covariance)

    def weigh(self, size: Array) -> float:
        """Log likelihood of a size against nothing."""
        return float(self.score @ size - 0.5 * size @ self.information @ size)
