"""A plate whose vertical force stops at a limit: an amplifier or a converter at the end of its range."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.evidence.watched import Role
from scaling_service.capabilities.discovery.evidence.weighed import Weighed
from scaling_service.capabilities.discovery.laws.freedoms import above
from scaling_service.capabilities.discovery.search.findings import Foreign
from scaling_service.numerics.multibody.laws import Array

_AT_LIMIT = 0.95  # of the highest reading, from which a filtered one may have been cut off (chosen)
_FLAT, _STANDS = 0.005, 0.6
"""By how much readings at the limit differ from their median, and the share of the highest that must differ
by no more (both chosen: it is 0.2 at the top of a parabola)."""
_FORWARD, _UP, _RIGHT = np.eye(3)


def found(now: Account) -> Iterator[Foreign]:
    """Every plate: what a missing vertical force of any course explains, wherever the reading is highest."""
    plates = dict.fromkeys(plate for item in now.weighed for plate in item.footing.ground.plates)
    for plate in plates:
        fit, held = (_spells(now, plate, role) for role in ("fit", "held_out"))
        limit = _limit(now, plate)
        if limit is not None and len(fit) and (fit[:, 2] > 0.0).all():
            gain, chance = fit[:, 0].sum(), fit[:, 1].sum()
            law = f"the vertical force of {plate} stops at {limit:.0f} N: more is missing there"
            p = _by_chance(fit)
            unseen = _by_chance(held) if len(held) else p
            yield Foreign((plate, "fy"), law, float(gain - 2.0 * chance), p, unseen, of_forces=True)


def _limit(now: Account, plate: str) -> float | None:
    """Where the force stands still when it is highest, N, the median of all trials; None if it does not."""
    forces = [item.plate(plate)[:, 1] for item in now.weighed]
    highest = [force[force > _AT_LIMIT * force.max()] for force in forces if force.max() > 0.0]
    if not highest:
        return None
    limits = [float(np.median(each)) for each in highest]
    at = sum(int((np.abs(f - limit) < _FLAT * limit).sum()) for f, limit in zip(highest, limits, strict=True))
    return float(np.median(limits)) if at > _STANDS * sum(map(len, highest)) else None


def _by_chance(spells: Array) -> float:
    return above(np.log(np.maximum(spells[:, 0], 1e-300) / np.maximum(spells[:, 1], 1e-300)))


def _spells(now: Account, plate: str, role: Role) -> Array:
    """Gain, gain by chance and missing force (N) of every spell at the limit, (n_spells, 3)."""
    items = [item for item in now.weighed if item.role == role and plate in item.footing.ground.plates]
    return np.array([row for item in items for row in _of_trial(item, plate)]).reshape(-1, 3)


def _of_trial(item: Weighed, plate: str) -> Iterator[tuple[float, float, float]]:
    force = item.plate(plate)[:, 1]
    if not force[item.usable].max(initial=0.0) > 0.0:
        return
    highest = force > _AT_LIMIT * force[item.usable].max()
    reach = int(np.ceil(0.5 / item.cutoff_hz * item.item.trial.rate_hz))  # of the filter
    spells = cast("Array", ndimage.label(ndimage.binary_dilation(highest, iterations=max(reach, 1)))[0])
    gap, along = item.gap / item.floor, _vertical(item, (spells > 0) & item.usable) / item.floor
    size = np.square(along).sum(axis=1)
    missing = -(gap * along).sum(axis=1) / size
    gains = missing**2 * size
    others = (np.square(gap).sum(axis=1) - gains) / (gap.shape[1] - 1)
    for k in range(1, int(spells.max(initial=0)) + 1):
        rows = (spells == k) & item.usable
        if rows.any():
            yield float(gains[rows].sum()), float(others[rows].sum()), float(missing[rows].mean())


def _vertical(item: Weighed, rows: NDArray[np.bool_]) -> Array:
    """A vertical force of 1 N, moment about the trunk's origin, (n, 6).

    It acts where the moments of these frames say: where one channel is cut off, that is no foot's place.
    """
    force, moment = item.gap[rows, 1], item.gap[rows, 3:]
    about = moment + np.cross(item.about[rows], _UP) * force[:, None]
    arms = np.stack([np.cross(_FORWARD, _UP), np.cross(_RIGHT, _UP)], axis=1) / item.floor[3:, None]
    lever = (force[:, None, None] * arms).reshape(-1, 2)
    x, z = np.linalg.lstsq(lever, (about / item.floor[3:]).ravel())[0]
    place = np.array([x, 0.0, z]) - item.about
    return np.concatenate([np.broadcast_to(_UP, place.shape), np.cross(place, _UP)], axis=1)
