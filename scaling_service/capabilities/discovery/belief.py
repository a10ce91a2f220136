"""How far a named effect may be believed: that it is no chance, which of its class, its sign and its size."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import scipy

from scaling_service.capabilities.discovery.effects.catalogue import is_answer
from scaling_service.capabilities.discovery.effects.sizes import Range
from scaling_service.capabilities.discovery.laws.candidates import DAMPINGS, FREQUENCIES_HZ, SHAPES
from scaling_service.capabilities.discovery.search.findings import NamedEffect
from scaling_service.numerics.multibody.laws import Array

CARRIES = 0.1
"""Share from which an effect carries the gap: of what all on markers, or all on forces, explain, or of
what was left when it was tried, on what did not fit it (chosen: as much as a companion must explain)."""


def estimate_probability(named: NamedEffect) -> float:
    """At most how probable it is that there is something, as likely as not before.

    The calibration of p-values of Sellke, Bayarri & Berger 2001, Am Stat 55:62: no prior of sizes speaks
    more for an effect.
    """
    p = min(max(named.p_family, 1e-300), 1.0)
    return 1.0 / (1.0 - math.e * p * math.log(p)) if p < 1.0 / math.e else 0.5


def estimate_sign_probability(values: Array, covariance: Array) -> float | None:
    """How probable it is that all of it, in the found proportions, points the way that was found.

    None where no number has a deviation. Numbers (k,) and covariance (k, k) count in deviations.
    """
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = sd > 0.0
    if not known.any():
        return None
    z, spread = values[known] / sd[known], covariance[np.ix_(known, known)] / np.outer(sd[known], sd[known])
    length = float(z @ spread @ z)
    return float(scipy.special.ndtr(z @ z / math.sqrt(length))) if length > 0.0 else 0.5


def list_bounds(named: NamedEffect) -> Mapping[str, Range]:
    """By its name in the results, what the search lets a number be."""
    found = {c.name: Range(c.low, c.high) for c in named.candidate.columns}
    if named.candidate.oscillation is not None:
        found |= {n: Range(*ends) for n, ends in zip(SHAPES, (FREQUENCIES_HZ, DAMPINGS), strict=True)}
    return found


def find_carrying(named: Sequence[NamedEffect]) -> Iterator[bool]:
    """Which effects carry the gap: the first question's answers, the largest, and those beside it."""
    sums: dict[str, float] = {}
    for n in named:
        sums[n.candidate.seen_in] = sums.get(n.candidate.seen_in, 0.0) + n.fitted.gain
    most = {sort: max(n.fitted.gain for n in named if n.candidate.seen_in == sort) for sort in sums}
    for n in named:
        sort, gain = n.candidate.seen_in, n.fitted.gain
        large = gain >= min(CARRIES * sums[sort], most[sort]) or n.held_out.gain >= CARRIES
        yield large or is_answer(n.candidate.kind)
