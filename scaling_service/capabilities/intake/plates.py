"""Who stands on which force plate, and what a plate reads while nobody does."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.intake.static import clusters_of
from scaling_service.documents.arrays import PlateEntry
from scaling_service.model.forces import CONTACT_N, GroundForces
from scaling_service.model.trial import Array, Trial
from scaling_service.numerics.least_squares.masks import ever, seen
from scaling_service.numerics.signals.filters import runs

NEAR_M = 0.25
"""Chosen: pressure farther than this over the floor from every marker of a foot is not that foot's (a foot's
length from heel to toes, for feet that bear few markers)."""

BESIDE_M = 0.1
"""Chosen: soles reach this far from the markers."""

OFFSET_N = 10.0
"""Chosen: plates at rest read less; what they read shifts the centre of pressure by millimetres only."""

STEADY = 0.3
"""Chosen: an offset changes by less than this share of itself; somebody or something on the plate moves."""

BRIEF_S = 0.05  # chosen: briefer loads are knocks
RESTS_M_S = 0.3  # chosen: a standing foot stays below, skin included; a swinging one reaches 3 to 4
_BOTH = 0.3  # chosen: share of a contact that a foot must be there
_FEWEST = 10  # frames that tell an offset

_FEET: Mapping[str, str] = {"r": "right foot", "l": "left foot"}


def describe_plates(
    entries: list[PlateEntry], forces: GroundForces, trial: Trial, kinds: tuple[int, ...]
) -> list[PlateEntry]:
    """Plates with type, place, who stood on them and when, and their offset.

    ``forces``: at the times of the trial, in its axes. ``trial``: X forward, Y up, Z right, m. ``kinds``:
    types of the plates; empty for forces of tables.
    """
    feet = _feet(trial)
    centre, pressing = forces.centre_of_pressure(), forces.pressing
    described = []
    for k, entry in enumerate(entries):
        place = forces.surfaces[k] if entry.corners_m is None else np.mean(entry.corners_m, axis=0)
        away = {side: _distance(foot, centre[:, k]) for side, foot in feet.items()}
        nearest = np.min(list(away.values()), axis=0) if away else np.array([])
        stands = {side: (distance < NEAR_M) & (distance == nearest) for side, distance in away.items()}
        near = [distance < NEAR_M for distance in away.values()]
        if entry.corners_m is not None:
            corners = np.asarray(entry.corners_m)
            near += [_over(foot, corners) for foot in feet.values()]
            stands = {
                side: stands[side] | _rests(foot, corners, trial.rate_hz) for side, foot in feet.items()
            }
        offset = _offset(pressing[:, k], ~np.any(near, axis=0)) if feet else None
        loaded = pressing[:, k] > CONTACT_N + abs(offset or 0.0)
        described.append(
            entry.model_copy(
                update={
                    "kind": kinds[k] if k < len(kinds) else None,
                    "centre_m": [round(float(v), 3) for v in place],
                    "loaded_by": _loads(loaded, stands, trial) if feet else [],
                    "offset_N": offset,
                }
            )
        )
    return described


def _feet(trial: Trial) -> dict[str, Array]:
    """Side to the places of its foot's markers over the floor, (n, m, 2); else those of the shank's."""
    clusters = clusters_of(trial.labels)
    found = {}
    for side in _FEET:
        on = [*clusters.get(f"calcn_{side}", []), *clusters.get(f"toes_{side}", [])]
        on = on or clusters.get(f"tibia_{side}", [])
        if on:
            found[side] = np.stack([trial.position(label)[:, [0, 2]] for label in on], axis=1)
    return found


def _distance(foot: Array, centre: Array) -> Array:
    """From the pressure to the nearest marker of a foot over the floor, m; infinite where there is none."""
    away = np.linalg.norm(foot - centre[:, None, [0, 2]], axis=2)
    return np.asarray(np.where(np.isfinite(away), away, np.inf).min(axis=1))


def _over(foot: Array, corners: Array) -> NDArray[np.bool_]:
    """Frames in which a marker of a foot is over a plate or beside it."""
    low, high = (f(corners[:, [0, 2]], axis=0) for f in (np.min, np.max))
    with np.errstate(invalid="ignore"):
        return np.asarray(((foot > low - BESIDE_M) & (foot < high + BESIDE_M)).all(axis=2).any(axis=1))


def _rests(foot: Array, corners: Array, rate_hz: float) -> NDArray[np.bool_]:
    """Frames in which the middle of a foot is over a plate and hardly moves."""
    known = seen(foot)
    middle = np.where(known[..., None], foot, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)[:, None]
    low, high = (f(corners[:, [0, 2]], axis=0) for f in (np.min, np.max))
    over = ever(known.T) & ((middle > low) & (middle < high)).all(axis=1)
    if len(middle) < 2:
        return np.asarray(over)
    speed = np.linalg.norm(np.gradient(middle, axis=0), axis=1) * rate_hz
    return np.asarray(over & (speed < RESTS_M_S))


def _loads(loaded: NDArray[np.bool_], stands: Mapping[str, NDArray[np.bool_]], trial: Trial) -> list[str]:
    """Each contact with who makes it."""
    told = []
    for start, stop in runs(loaded):
        if stop - start < BRIEF_S * trial.rate_hz:
            continue
        who = [_FEET[side] for side, on in stands.items() if on[start:stop].mean() > _BOTH] or ["nobody"]
        told.append(f"{' and '.join(who)} {trial.times[start]:.2f}–{trial.times[stop - 1]:.2f} s")
    return told


def _offset(pressing: Array, alone: NDArray[np.bool_]) -> float | None:
    """The steady reading while no foot is near, N; None where there is no such time or it is not steady."""
    rows = alone & np.isfinite(pressing)
    if rows.sum() < _FEWEST:
        return None
    low, middle, high = np.quantile(pressing[rows], [0.25, 0.5, 0.75])
    steady = high - low <= max(STEADY * abs(middle), 0.25 * CONTACT_N)
    return round(float(middle), 1) if steady else None
