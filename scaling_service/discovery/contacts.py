"""Something touches a segment and no plate measures it.

The force may take any course, so the force part of the disagreement says nothing by itself. What speaks for
a contact is its moment: about the point where it acts there is none. A foot's contact wanders over its sole,
any other contact a little; so much the moment may differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.discovery.candidates import Candidate, Contact
from scaling_service.discovery.evidence import stretches_of
from scaling_service.discovery.freedoms import above
from scaling_service.discovery.judging import Fitted
from scaling_service.discovery.weighed import Weighed
from scaling_service.kernels.laws import Array

KIND = "external_contact"
WANDER_M = {"foot": 0.06, "other": 0.02}
"""m; how far a contact wanders on its segment, one standard deviation. A sole is 0.25 m long (uniform: 0.07); a
hand's grip stays within some 2 cm (both chosen)."""

_FEET = ("calcn", "toes", "foot", "talus")
_STRONG = 4.0  # chosen: of the level of the disagreement elsewhere, from which a contact is looked for
_SHORTEST_S = 0.1  # chosen: a shorter one is a knock
_ROUNDS = 4
_LEAST_SHARE = 1.0 / 3.0
"""Of the moment about the segment that may be left (chosen: with more, any force would be called a contact)."""


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """A contact that was looked at.

    Parameters
    ----------
    candidate : Candidate
    fitted : Fitted
    gain_share : float
        Of the trial's whitened square that it takes off.
    wrench : ndarray, shape (n, 6), N and N m
        On the body, moment about the ground origin; zero outside its span.
    """

    candidate: Candidate
    fitted: Fitted
    gain_share: float
    wrench: Array


def touches(weighed: Sequence[Weighed], stretch_s: float) -> list[Touch]:
    """Every segment in every trial, where something stands out."""
    found = []
    level = _level(weighed)
    for item in weighed:
        span = _span(item, level)
        if span is not None:
            for segment in _reachable(item):
                touch = _touch(item, segment, span, level, stretch_s)
                if touch is not None:
                    found.append(touch)
    return found


def _level(weighed: Sequence[Weighed]) -> float:
    """Whitened square per number that the disagreement has where it is quietest, at least one."""
    quiet = [
        float(np.median(np.square(item.gap[item.usable] / item.floor).mean(axis=1)))
        for item in weighed
        if item.usable.any()
    ]
    return max(1.0, min(quiet, default=1.0))


def _span(item: Weighed, level: float) -> slice | None:
    """The stretch of time in which the force disagrees much more than elsewhere."""
    strength = np.square(item.gap[:, :3] / item.floor[:3]).mean(axis=1)
    usual = float(np.median(strength[item.usable])) if item.usable.any() else 0.0
    quiet = min(usual, _STRONG * level)
    excess = np.where(item.usable, strength - _STRONG * max(quiet, 1.0), 0.0)
    total = np.concatenate([[0.0], np.cumsum(excess)])
    low = np.minimum.accumulate(total)
    stop = int(np.argmax(total - low))
    start = int(np.flatnonzero(total[: stop + 1] == low[stop])[-1])
    long_enough = stop > start and item.times[stop - 1] - item.times[start] >= _SHORTEST_S
    return slice(start, stop) if long_enough and total[stop] > total[start] else None


def _reachable(item: Weighed) -> list[str]:
    """Segments with markers or mass, the lightest parts of a foot left to the foot."""
    shown = {item.model.marker(m).segment for m in item.item.markers}
    return [s.name for s in item.model.segments if s.name in shown]


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    point: Array
    left: Array
    force: Array


def _touch(item: Weighed, segment: str, span: slice, level: float, stretch_s: float) -> Touch | None:
    rows = np.arange(span.start, span.stop)[item.usable[span]]
    if len(rows) < 10:
        return None
    wander = WANDER_M["foot" if segment.startswith(_FEET) else "other"]
    fit = _point(item, segment, rows, wander, level)
    gap = np.square(item.gap[rows] / item.floor)
    gain = float(gap.sum() - fit.left.sum())
    chance = float(fit.left.sum())
    about = _about(item, segment, rows)
    before = np.square(about / item.floor[3:]).sum()
    p = _p(item, segment, rows, wander, level, stretch_s)
    fitted = Fitted(np.zeros(0), np.zeros((0, 0)), gain, chance, p, 1.0)
    if fit.left.sum() > _LEAST_SHARE * before and before > 3.0 * level * len(rows) * 9.0:
        fitted = Fitted(np.zeros(0), np.zeros((0, 0)), gain, chance, 1.0, 1.0)
    x, y, z = (float(v) for v in fit.point)
    change = Contact(segment, float(item.times[span.start]), float(item.times[span.stop - 1]), (x, y, z))
    candidate = Candidate(KIND, (segment,), (), trial=item.name, change=change)
    square = np.square(item.gap[item.usable] / item.floor).sum()
    return Touch(candidate, fitted, gain / float(square), wrench_of(item, change))


def wrench_of(item: Weighed, contact: Contact) -> Array:
    """What the contact must be so that nothing is left, (n, 6), moment about the ground origin."""
    inside = (item.times >= contact.start_s - 1e-9) & (item.times <= contact.end_s + 1e-9) & item.usable
    wander = WANDER_M["foot" if contact.segment.startswith(_FEET) else "other"]
    rows = np.flatnonzero(inside)
    found = np.zeros((len(item.times), 6))
    if len(rows):
        force, moment, _ = _solved(item, contact.segment, rows, np.array(contact.point), wander, 1.0)
        found[rows] = np.concatenate([force, moment], axis=1)
    return found


def _about(item: Weighed, segment: str, rows: NDArray[np.intp]) -> Array:
    """Moment of the disagreement about a segment's origin, (n, 3)."""
    origin, _ = item.segment_frame(segment)
    arm = origin[rows] - item.about[rows]
    return np.asarray(item.gap[rows, 3:] - np.cross(arm, item.gap[rows, :3]))


def _point(item: Weighed, segment: str, rows: NDArray[np.intp], wander: float, level: float) -> _Fit:
    """The point of the segment about which the disagreement has least moment."""
    point = np.zeros(3)
    _, axes = item.segment_frame(segment)
    for _ in range(_ROUNDS):
        force = item.gap[rows, :3]
        # moment of p x f in ground: -[f]x R' p, linear in p
        lever = -_crossing(force) @ axes[rows].transpose(0, 2, 1)
        weight = _weights(item, rows, force, wander, level)
        normal = np.einsum("nak,nab,nbl->kl", lever, weight, lever)
        target = np.einsum("nak,nab,nb->k", lever, weight, _about(item, segment, rows))
        ridge = 1e-6 * np.trace(normal) * np.eye(3)
        point = np.linalg.solve(normal + ridge, target)
    force, _, left = _solved(item, segment, rows, point, wander, level)
    return _Fit(point, left, force)


def _solved(
    item: Weighed, segment: str, rows: NDArray[np.intp], point: Array, wander: float, level: float
) -> tuple[Array, Array, Array]:
    """Force on the body, its moment about the ground origin, and the whitened square left, (n,)."""
    origin, axes = item.segment_frame(segment)
    force = -item.gap[rows, :3]
    place = origin[rows] + np.einsum("njk,j->nk", axes[rows], point)
    left = item.gap[rows, 3:] - np.cross(place - item.about[rows], item.gap[rows, :3])
    weight = _weights(item, rows, force, wander, level)
    square = np.einsum("na,nab,nb->n", left, weight, left) * level
    inside = _crossing(force) * wander
    spread = inside @ inside.transpose(0, 2, 1)
    wandering = np.einsum("nab,nbc,nc->na", spread, weight, left)
    moment = np.cross(place, force) - wandering
    return force, moment, square


def _weights(item: Weighed, rows: NDArray[np.intp], force: Array, wander: float, level: float) -> Array:
    """Inverse covariance of the moment left, (n, 3, 3): its floor and the wandering of the point."""
    inside = _crossing(force) * wander
    covariance = inside @ inside.transpose(0, 2, 1) + level * np.diag(item.floor[3:] ** 2)
    return np.asarray(np.linalg.inv(covariance))


def _crossing(vectors: Array) -> Array:
    """The matrices (n, 3, 3) of the cross product with vectors (n, 3)."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)


def _p(
    item: Weighed, segment: str, rows: NDArray[np.intp], wander: float, level: float, stretch_s: float
) -> float:
    """How likely chance leaves as little moment about one point, stretch by stretch."""
    inside = [rows[(rows >= s.start) & (rows < s.stop)] for s in stretches_of(item.item, stretch_s)]
    parts = [part for part in inside if len(part) >= 5]
    if len(parts) < 4:
        return _short_p(item, segment, rows, wander, level)
    ratios = []
    for known, new in ((parts[0::2], parts[1::2]), (parts[1::2], parts[0::2])):
        point = _point(item, segment, np.concatenate(known), wander, level).point
        for part in new:
            _, _, left = _solved(item, segment, part, point, wander, level)
            gap = np.square(item.gap[part] / item.floor).sum()
            ratios.append(np.log((gap - left.sum()).clip(1e-12) / max(float(left.sum()), 1e-12)))
    return above(np.array(ratios))


def _short_p(item: Weighed, segment: str, rows: NDArray[np.intp], wander: float, level: float) -> float:
    """For a contact too short for stretches: how far its force stands above the level elsewhere."""
    strength = float(np.square(item.gap[rows, :3] / item.floor[:3]).mean()) / level
    left = float(_point(item, segment, rows, wander, level).left.mean()) / 3.0 / level
    return float(np.exp(-0.5 * min(max(strength - 3.0 * left, 0.0), 1e3)))
