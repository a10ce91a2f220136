"""Markers that jump from one place on their segment to another in the course of a recording."""

from __future__ import annotations

import math

import numpy as np

from scaling_service.capabilities.discovery.laws.spots import MarkerSpot
from scaling_service.capabilities.discovery.ordinary.body import RESTUCK_M
from scaling_service.capabilities.discovery.ordinary.sums import White, score_course
from scaling_service.capabilities.discovery.search.markers import BodyTable
from scaling_service.core.arrays import Array
from scaling_service.model.people import read_people
from scaling_service.model.places import tell_landmarks

_SLOW = 5  # order up to which polynomials are what wanders slowly (chosen)
_JUMP_M = 0.025  # half of what is met of a marker's offset (``effect_sizes.yaml``)
_LATE_S = 0.05  # SD by which a marker may come late, as its speed shows (chosen: a few frames)

Jump = tuple[float, str, str, float, float]
"""Log odds, the marker, the recording, the time (s) and the size (m)."""


def list_jumps(body: BodyTable, odds: float) -> list[Jump]:
    """Of every marker and recording the likeliest that has the odds, the likeliest first.

    It has them beside others that go astray, too, which draw the pose: one that comes late makes its
    neighbour seem to jump.
    """
    model, people = body.fit.model, read_people()
    told = tell_landmarks(model)
    # A head nods, and shoulders shrug
    still = {
        m.name for m in model.markers if not people.girdle_sd(model.bone_of(m.segment), told.get(m.name))
    }
    placed = still & {spot.marker for spot in body.base.spots if isinstance(spot, MarkerSpot)}
    found = []
    for k, (white, left) in enumerate(body.left):
        shown = [m for m in white.look.item.markers if m in placed]
        for marker in shown:
            if _score_jump(body, white, left, marker, len(shown))[0] > odds:
                beside = white.look.whiten(body.loose, {**body.strays, marker: 1.0})
                rest = beside.subtract(body.base, body.estimate(k))
                found.append(_score_jump(body, beside, rest, marker, len(shown)))
    return sorted((jump for jump in found if jump[0] > odds), reverse=True)


def _score_jump(body: BodyTable, white: White, left: Array, marker: str, places: int) -> Jump:
    """The likeliest of a marker in a recording, against wandering, however lively or slowly, and coming late.

    ``left``: residuals (n, 3 m) less everything that lasts.
    """
    item, weight = white.look.item, white.look.weight
    # From each frame on, about the mean of the whole, which is the marker's place
    after = np.tri(len(left)).T[1:]
    after -= after.mean(axis=1, keepdims=True)
    slowly: Array = np.asarray(
        np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, len(left)), _SLOW).T[1:], dtype=float
    )
    columns = white.columns[:, [body.base.spots.index(MarkerSpot(marker, axis)) for axis in range(3)]]
    scores = weight * after @ np.matmul(columns, left[:, :, None])[:, :, 0]
    each = weight * np.matmul(columns, columns.transpose(0, 2, 1))
    inverse = np.linalg.inv(np.eye(3) / _JUMP_M**2 + np.einsum("sn,nij->sij", np.square(after), each))
    gains = np.einsum("si,sij,sj->s", scores, inverse, scores) + np.linalg.slogdet(inverse)[1]
    k = int(np.argmax(gains))
    step = after[k : k + 1]
    bayes, size = score_course(white, left, columns, step, _JUMP_M)
    if bayes > 0.0:
        speed = item.speeds[white.look.rows, item.markers.index(marker)].T
        rivals = (slowly, _JUMP_M), (step, RESTUCK_M), (speed, _LATE_S)
        bayes -= max(0.0, *(score_course(white, left, columns, *rival)[0] for rival in rivals))
    at = item.times[white.look.rows[k + 1]]
    return bayes - math.log(len(after) * places), marker, item.name, float(at), size
