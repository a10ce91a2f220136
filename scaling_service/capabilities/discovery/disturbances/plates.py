"""Disturbances of the plates: belts that give way, clocks that drift, amplifiers that saturate."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from scaling_service.capabilities.discovery.disturbances.disturbance import Disturbance, DisturbanceLaw
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate
from scaling_service.capabilities.discovery.evidence.statistics import p_above_zero
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column
from scaling_service.capabilities.discovery.laws.loads import Drifting, Late, Shear
from scaling_service.capabilities.discovery.observations.tracked import ROLES, Role
from scaling_service.capabilities.discovery.observations.wrench import WrenchFit
from scaling_service.numerics.multibody.laws import Array

_HORIZONTAL = {"x": 0, "z": 2}
_AT_LIMIT = 0.95  # of the highest reading, from which a filtered one may have been cut off (chosen)
_FLAT, _STANDS = 0.005, 0.6
"""By how much readings at the limit differ from their median, and the share of the highest that must differ
by no more (both chosen: it is 0.2 at the top of a parabola)."""
_FORWARD, _UP, _RIGHT = np.eye(3)


def dragging(fit: Fit) -> Iterator[Candidate]:
    """Every loaded plate, along each horizontal axis: its shear follows its own vertical force."""
    for plate in fit.scene.plates:
        for axis, k in _HORIZONTAL.items():
            columns = tuple(Column(what, 1.0, load=Shear(plate, k, what)) for what in Shear.FOLLOWS)
            yield Candidate("dragging", (plate,), columns, note=axis)


def _dragged(found: ScoredCandidate) -> tuple[tuple[str, ...], str]:
    (plate,), axis = found.candidate.where, found.candidate.note
    rate, share, added = found.fitted.size.tolist()
    law = (
        f"the force of {plate} along {axis} is off by {rate:.3g} s x the rate of its vertical force "
        f"+ {share:.3g} x that force + {added:.3g} N while it is loaded"
    )
    return (plate, f"f{axis}"), law.replace("+ -", "- ")


def drifting_clock(fit: Fit) -> Iterator[Candidate]:
    """All forces together, in step with the cameras at first, seconds later no more."""
    if fit.scene.plates:
        columns = (Column("delay", 1.0, load=Late()), Column("drift", 1.0, load=Drifting()))
        yield Candidate("drifting_clock", ("forces",), columns)


def _drifted(found: ScoredCandidate) -> tuple[tuple[str, ...], str]:
    at_first, more = (1e3 * found.fitted.size).tolist()
    law = f"the forces come {at_first:.3g} ms late at first and {more:.3g} ms later every second"
    return found.candidate.where, law


def saturating(fit: Fit) -> Iterator[Disturbance]:
    """Every plate whose vertical force stops at a limit, an amplifier's or a converter's.

    It is what a missing vertical force of any course explains, wherever the reading is highest.
    """
    plates = dict.fromkeys(plate for item in fit.wrenches for plate in item.contacts.ground.plates)
    for plate in plates:
        fitting, held = (_spells(fit, plate, role) for role in ROLES)
        limit = _limit(fit, plate)
        if limit is not None and len(fitting) and (fitting[:, 2] > 0.0).all():
            gain, chance = fitting[:, 0].sum(), fitting[:, 1].sum()
            law = f"the vertical force of {plate} stops at {limit:.0f} N: more is missing there"
            p = _by_chance(fitting)
            held_out = _by_chance(held) if len(held) else p
            yield Disturbance((plate, "fy"), law, float(gain - 2.0 * chance), p, held_out, "wrench")


def _limit(fit: Fit, plate: str) -> float | None:
    """Where the force stands still when it is highest, N, the median of all trials; None if it does not."""
    forces = [item.plate(plate)[:, 1] for item in fit.wrenches]
    highest = [force[force > _AT_LIMIT * force.max()] for force in forces if force.max() > 0.0]
    if not highest:
        return None
    limits = [float(np.median(each)) for each in highest]
    at = sum(int((np.abs(f - limit) < _FLAT * limit).sum()) for f, limit in zip(highest, limits, strict=True))
    return float(np.median(limits)) if at > _STANDS * sum(map(len, highest)) else None


def _by_chance(spells: Array) -> float:
    return p_above_zero(np.log(np.maximum(spells[:, 0], 1e-300) / np.maximum(spells[:, 1], 1e-300)))


def _spells(fit: Fit, plate: str, role: Role) -> Array:
    """Gain, gain by chance and missing force (N) of every spell at the limit, (n_spells, 3)."""
    items = [item for item in fit.wrenches if item.role == role and plate in item.contacts.ground.plates]
    return np.array([row for item in items for row in _of_trial(item, plate)]).reshape(-1, 3)


def _of_trial(item: WrenchFit, plate: str) -> Iterator[tuple[float, float, float]]:
    force = item.plate(plate)[:, 1]
    if not force[item.usable].max(initial=0.0) > 0.0:
        return
    highest = force > _AT_LIMIT * force[item.usable].max()
    reach = int(np.ceil(0.5 / item.cutoff_hz * item.tracked.trial.rate_hz))  # of the filter
    spells = cast("Array", ndimage.label(ndimage.binary_dilation(highest, iterations=max(reach, 1)))[0])
    gap, along = item.residuals / item.floor, _vertical(item, (spells > 0) & item.usable) / item.floor
    size = np.square(along).sum(axis=1)
    missing = -(gap * along).sum(axis=1) / size
    gains = missing**2 * size
    others = (np.square(gap).sum(axis=1) - gains) / (gap.shape[1] - 1)
    for k in range(1, int(spells.max(initial=0)) + 1):
        rows = (spells == k) & item.usable
        if rows.any():
            yield float(gains[rows].sum()), float(others[rows].sum()), float(missing[rows].mean())


def _vertical(item: WrenchFit, rows: NDArray[np.bool_]) -> Array:
    """A vertical force of 1 N, moment about the trunk's origin, (n, 6).

    It acts where the moments of these frames say: where one channel is cut off, that is no foot's place.
    """
    force, moment = item.residuals[rows, 1], item.residuals[rows, 3:]
    about = moment + np.cross(item.about[rows], _UP) * force[:, None]
    arms = np.stack([np.cross(_FORWARD, _UP), np.cross(_RIGHT, _UP)], axis=1) / item.floor[3:, None]
    lever = (force[:, None, None] * arms).reshape(-1, 2)
    x, z = np.linalg.lstsq(lever, (about / item.floor[3:]).ravel())[0]
    place = np.array([x, 0.0, z]) - item.about
    return np.concatenate([np.broadcast_to(_UP, place.shape), np.cross(place, _UP)], axis=1)


LAWS = (
    DisturbanceLaw(dragging, _dragged),
    DisturbanceLaw(drifting_clock, _drifted),
    DisturbanceLaw(search=saturating),
)
