"""Which ordinary movement would tell effects apart that these recordings do not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate
from scaling_service.capabilities.discovery.laws.loads import compute_columns
from scaling_service.capabilities.discovery.laws.spots import Generators
from scaling_service.capabilities.discovery.observations.performed import (
    MOVEMENTS,
    perform_movement,
    perform_on_plates,
)
from scaling_service.capabilities.discovery.ordinary.body import make_clusters
from scaling_service.capabilities.discovery.ordinary.columns import Base
from scaling_service.capabilities.discovery.ordinary.forces import NOISE
from scaling_service.capabilities.discovery.ordinary.sums import Look
from scaling_service.core.arrays import Array

_NEAREST = 6  # others that are looked at (chosen: the rest are further off)
_NULL = 1e-9  # of a column's own square, so that two may be the same


def find_separating_movement(effect: Estimate, others: Sequence[Candidate], fit: Fit) -> str:
    """The movement in which the nearest of the others leaves most of the effect unexplained, or ``""``."""
    every = [c for c in (effect.candidate, *others[:_NEAREST]) if c.columns]
    if len(every) < 2 or not effect.candidate.columns or not fit.tracked:
        return ""
    best = (fit.settings.separating, "")
    for movement in MOVEMENTS:
        show = _show_markers if effect.candidate.seen_in == "markers" else _show_forces
        shown = show(every, fit, movement)
        if shown is not None:
            left = _compute_left(effect.size, shown)
            if left > best[0]:
                best = left, movement
    return best[1]


def _show_markers(every: Sequence[Candidate], fit: Fit, movement: str) -> list[Array] | None:
    """What each candidate's numbers do to the markers, in deviations of skin, (any, k) each."""
    item = perform_movement(fit.tracked[0], movement)
    if item is None:
        return None
    base = Base()
    for candidate in every:
        base.include(candidate)
    white = Look.of(item, base, Generators.of(item, base.spots), make_clusters(item)).whiten({})
    found = []
    for candidate in every:
        moved = [white.spread_over_spots(base, column) for column in base.expand(candidate).T]
        shown = [np.matmul(m[:, None], white.columns)[:, 0].ravel() for m in moved]
        found.append(np.sqrt(white.look.weight) * np.stack(shown, axis=1))
    return found


def _show_forces(every: Sequence[Candidate], fit: Fit, movement: str) -> list[Array] | None:
    """What each candidate's numbers do to the wrench, in deviations of what is ordinary, (any, k) each."""
    made = (perform_on_plates(item, movement) for item in fit.wrenches)
    item = next((one for one in made if one is not None), None)
    if item is None:
        return None
    thin = max(1, round(item.tracked.trial.rate_hz / item.cutoff_hz))  # numbers that are new
    found = []
    for candidate in every:
        columns = item.filter(compute_columns([c.load for c in candidate.columns if c.load], item))
        columns[:, 3:] -= np.cross(item.about[:, None], columns[:, :3].transpose(0, 2, 1)).transpose(0, 2, 1)
        seen = columns[item.usable][::thin] / NOISE[:, None]
        found.append(seen.reshape(-1, columns.shape[2]))
    return found


def _compute_left(size: Array, shown: Sequence[Array]) -> float:
    """Square of the first candidate, of that size, that the best of the others cannot explain."""
    own, *rest = shown
    signal, left = own @ size, []
    for columns in rest:
        inverse = np.linalg.pinv(columns.T @ columns, rcond=_NULL, hermitian=True)
        along = columns.T @ signal
        left.append(float(signal @ signal - along @ inverse @ along))
    return min(left)
