"""What a black-box correction of the same number of numbers would reach, and what absorbing would.

The black box may add to any marker, or component of the wrench, a constant or a multiple of any coordinate,
wherever it helps most: it knows nothing of bodies. Absorbing lets the numbers that calibration frees (sizes,
knee axes, places of all markers) take up what they can.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scaling_service.capabilities.discovery.evidence.fitting import Account, Recording
from scaling_service.capabilities.discovery.evidence.score import Evidence, gather
from scaling_service.capabilities.discovery.evidence.spots import MarkerSpot
from scaling_service.capabilities.discovery.evidence.watched import Role
from scaling_service.capabilities.discovery.laws.additions import Sized
from scaling_service.capabilities.discovery.laws.profiles import ALWAYS, Following, Profile
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column, Part
from scaling_service.capabilities.discovery.search.catalogue import candidates
from scaling_service.capabilities.discovery.search.judging import fit_each, inverse_of
from scaling_service.capabilities.discovery.search.refining import SOON, refined
from scaling_service.numerics.multibody.laws import Array

_LOOKED_AT = 60  # single columns compared; chosen: far more than effects have numbers
_ABSORBING = ("marker_offset", "segment_length", "joint_axis_tilt")


def black_box(before: Account, scene: Scene, count: int, stretch_s: float) -> dict[Role, float]:
    """Share of the markers' squares that the best ``count`` columns leave, by role.

    Notes
    -----
    Columns are taken one after the other, each where it helps most beside those taken (orthogonal matching
    pursuit: Pati et al. 1993).
    """
    profiles: tuple[Profile, ...] = (ALWAYS, *(Following(c) for c in scene.moving))
    choice = [
        Candidate("black_box", (marker,), (Column("a", 1.0, (Part(MarkerSpot(marker, k), profile),)),))
        for marker in scene.markers
        for k in range(3)
        for profile in profiles
    ]
    known = [s.candidate for s in before.everything if s.candidate.columns and not s.candidate.of_forces]
    fitted = fit_each(gather(before.watched, known, choice, stretch_s, together=False), choice)
    order = sorted(range(len(choice)), key=lambda k: -fitted[k].gain)[:_LOOKED_AT]
    detail = gather(before.watched, known, [choice[k] for k in order], stretch_s, together=True)
    taken, size = _pursue(detail, count)
    left: dict[Role, float] = {}
    roles: tuple[Role, ...] = ("fit", "held_out")
    for role in roles:
        parts = [s for s in detail.stretches if s.role == role]
        square = sum(s.square for s in parts)
        gain = sum(2.0 * size @ s.scores[taken] - size @ s.own[np.ix_(taken, taken)] @ size for s in parts)
        left[role] = float(1.0 - gain / square) if square else 1.0
    return left


def _pursue(detail: Evidence, count: int) -> tuple[list[int], Array]:
    parts = [s for s in detail.stretches if s.role == "fit"]
    curvature, score = np.sum([s.own for s in parts], axis=0), np.sum([s.scores for s in parts], axis=0)
    taken = list(range(detail.nuisances))
    size = np.zeros(len(taken))
    for _ in range(count):
        rest = score - curvature[:, taken] @ size
        own = np.maximum(np.diag(curvature), 1e-300)
        gain = rest**2 / own
        gain[taken] = 0.0
        best = int(np.argmax(gain))
        if gain[best] <= 0.0:
            break
        taken.append(best)
        size = inverse_of(curvature[np.ix_(taken, taken)], detail.raw[taken])[0] @ score[taken]
    return taken, size


def absorbed(before: Account, recordings: Sequence[Recording], scene: Scene, stretch_s: float) -> Account:
    """The account in which what calibration can free takes up what it can."""
    taken = {s.candidate.name for s in before.everything}
    added = [
        Sized(c, np.zeros(len(c.columns)))
        for c in candidates(scene)
        if c.kind in _ABSORBING and not c.trials and c.name not in taken
    ]
    return refined(before, recordings, added, stretch_s, SOON)
