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

from scaling_service.discovery.candidates import Contact
from scaling_service.discovery.contact_times import edges, lasts_throughout, together
from scaling_service.discovery.evidence import stretches_of
from scaling_service.discovery.freedoms import above
from scaling_service.discovery.judging import Fitted
from scaling_service.discovery.weighed import Weighed
from scaling_service.kernels.laws import Array

WANDER_M = {"foot": 0.06, "other": 0.02}
"""m; how far a contact wanders on its segment, one standard deviation. A sole is 0.25 m long (uniform: 0.07);
a hand's grip stays within some 2 cm (both chosen)."""

FEET = ("calcn", "toes", "foot", "talus")
"""What names of segments of a foot begin with."""
_HANDS = ("hand", "radius", "forearm")
"""What may hold on to something throughout; anything else touched all the time is a fault of a plate."""

_STRONG = 4.0  # chosen: of the level of the disagreement elsewhere, from which a contact is looked for
_SHORTEST_S = 0.1  # chosen: a shorter one is a knock
_LEAST_SHARE = 0.2
"""Of the whole disagreement that may be left where a foot is known to rest beside the plates (chosen)."""

_STILL_M_S, _LOW_M, _NEAR_M = 0.2, 0.1, 0.15
"""A resting foot is slower, lies lower above the lowest marker, and bears on a plate when pressure is nearer
(chosen: a swinging foot moves at 1 to 4 m/s; a shoe is 0.3 m long)."""

_SKIN_M = 0.08  # chosen: flesh and sole reach so far beyond markers and the centre of mass
_MAIN = 0.6  # chosen: of all that stands out in a trial, what one contact must hold
_QUIET = 0.1  # chosen: the quietest tenth of the frames
_FEWEST, _MANY = 5, 4  # frames of a stretch, and stretches, from which something is told
_PARTS = 10  # stretches that a contact should have at least (chosen: fewer can be sure of nothing)
_MOSTLY = 0.8  # chosen: of a contact's frames, in which a foot must rest, and no plate's pressure be near
_COMMON = 0.7  # chosen: of the time that contacts in several trials cover, what they share if they are one
_ALIKE = 6.0
"""Twice the difference of log-likelihoods below which segments are not told apart (chosen: 1 in 20)."""


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """A contact that was looked at.

    Parameters
    ----------
    contact : Contact
    trials : tuple of str
        Those in which it is; all of them unless given.
    fitted : Fitted
    gain_share : float
        Of the trials' whitened squares that it takes off.
    others : tuple of Contact
        At segments where it would explain nearly as much.
    """

    contact: Contact
    trials: tuple[str, ...]
    fitted: Fitted
    gain_share: float
    others: tuple[Contact, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Spell:
    """The frames of one trial in which something may touch; ``all_along`` if no frame is quieter."""

    item: Weighed
    rows: NDArray[np.intp]
    all_along: bool = False


def touches(weighed: Sequence[Weighed], stretch_s: float) -> list[Touch]:
    """The best segment of every trial in which the force stands out, and of all of them if all do alike."""
    level = _level(weighed)
    looked_at = [_spell(item, level) or _whole_trial(item) for item in weighed]
    spells = [spell for spell in looked_at if spell is not None]
    found = [_best([spell], (spell.item.name,), stretch_s) for spell in spells]
    if len(spells) == len(weighed) > 1 and _alike(spells):
        found.append(_best(spells, (), stretch_s))
    return [touch for touch in found if touch is not None]


def _alike(spells: Sequence[_Spell]) -> bool:
    """Whether contacts last throughout their trials, or from and to the same times in all."""
    if all(lasts_throughout(s.item, s.rows) for s in spells):
        return True
    spans = np.array([s.item.times[s.rows[[0, -1]]] for s in spells])
    common = spans[:, 1].min() - spans[:, 0].max()
    return bool(common > _COMMON * (spans[:, 1].max() - spans[:, 0].min()))


def _level(weighed: Sequence[Weighed]) -> float:
    """Whitened square per number of the force where it disagrees least, at least one."""
    quiet = [
        float(np.quantile(np.square(item.gap[item.usable, :3] / item.floor[:3]).mean(axis=1), _QUIET))
        for item in weighed
        if item.usable.any()
    ]
    return max(1.0, min(quiet, default=1.0))


def _spell(item: Weighed, level: float) -> _Spell | None:
    """The stretch of time in which the force disagrees much more than where it is quietest."""
    strength = np.square(item.gap[:, :3] / item.floor[:3]).mean(axis=1)
    usual = float(np.median(strength[item.usable])) if item.usable.any() else 0.0
    allowed = _STRONG * max(level, min(usual, _STRONG * level))
    excess = np.where(item.usable, strength - allowed, 0.0)
    total = np.concatenate([[0.0], np.cumsum(excess)])
    low = np.minimum.accumulate(total)
    stop = int(np.argmax(total - low))
    start = int(np.flatnonzero(total[: stop + 1] == low[stop])[-1])
    if stop <= start or item.times[stop - 1] - item.times[start] < _SHORTEST_S:
        return None
    if excess[start:stop].clip(0.0).sum() < _MAIN * excess.clip(0.0).sum():
        return None  # it stands out as much at other times
    rows = np.arange(start, stop)[item.usable[start:stop]]
    return _Spell(item, rows) if len(rows) >= _FEWEST else None


def _whole_trial(item: Weighed) -> _Spell | None:
    """All frames, where the force disagrees even in the quietest."""
    rows = np.flatnonzero(item.usable)
    strength = np.square(item.gap[rows, :3] / item.floor[:3]).mean(axis=1)
    if len(rows) < _FEWEST or np.quantile(strength, _QUIET) < _STRONG:
        return None
    return _Spell(item, rows, all_along=True)


def _reachable(item: Weighed) -> list[str]:
    """Segments that carry markers."""
    shown = {item.model.marker(m).segment for m in item.item.markers}
    return [s.name for s in item.model.segments if s.name in shown]


def _best(spells: Sequence[_Spell], trials: tuple[str, ...], stretch_s: float) -> Touch | None:
    names = [n for n in _reachable(spells[0].item) if all(n in _reachable(s.item) for s in spells)]
    if not names:
        return None
    gap = sum(float(np.square(s.item.gap[s.rows] / s.item.floor).sum()) for s in spells)
    fits = {name: _point(spells, name) for name in names}
    beside = [n for n in names if n.startswith(FEET) and all(_beside_plates(s, n) for s in spells)]
    likely = [n for n in beside if fits[n].left < _LEAST_SHARE * gap]
    if not likely and not any(s.all_along for s in spells):
        lasting = all(lasts_throughout(s.item, s.rows) for s in spells)
        likely = [n for n in names if n.startswith(_HANDS)] if lasting else names
    if not likely:
        return None
    order = sorted(likely, key=lambda name: fits[name].misfit)
    best = fits[order[0]]
    square = sum(float(np.square(s.item.gap[s.item.usable] / s.item.floor).sum()) for s in spells)
    p = _p(spells, order[0], stretch_s)
    fitted = Fitted(np.zeros(0), np.zeros((0, 0)), gap - best.left, best.left, p, 1.0)
    near = [n for n in order[1:] if fits[n].misfit - best.misfit < _ALIKE]
    contact, *others = (_contact(spells, n, fits[n].point) for n in (order[0], *near))
    return Touch(contact, trials, fitted, (gap - best.left) / square, tuple(others))


def _beside_plates(spell: _Spell, foot: str) -> bool:
    """Whether a foot rests low and still most of the time, and no loaded plate's pressure is near it."""
    item, rows = spell.item, spell.rows
    on = [k for k, m in enumerate(item.item.markers) if item.model.marker(m).segment == foot]
    places = item.item.task.measured
    speed = np.linalg.norm(np.gradient(places[:, on], item.times, axis=0), axis=2)
    lowest = np.nanmin(places[..., 1])
    still = (speed < _STILL_M_S) & (places[:, on, 1] < lowest + _LOW_M)
    if still[rows].any(axis=1).mean() < _MOSTLY:
        return False
    centre = np.nanmean(places[:, on], axis=1)[:, None]
    pressed = item.footing.ground.centre_of_pressure()
    apart = np.linalg.norm((pressed - centre)[..., [0, 2]], axis=2)
    near = np.nan_to_num(apart, nan=np.inf)[rows].min(axis=1) < _NEAR_M
    return bool(near.mean() < 1.0 - _MOSTLY)


def _contact(spells: Sequence[_Spell], segment: str, point: Array) -> Contact:
    x, y, z = (float(v) for v in point)
    if all(lasts_throughout(s.item, s.rows) for s in spells):
        start, end = min(float(s.item.times[0]) for s in spells), max(float(s.item.times[-1]) for s in spells)
    else:
        (start, _), (end, _) = together([edges(s.item, s.rows, s.item.gap[:, :3]) for s in spells])
    return Contact(segment, start, end, (x, y, z))


def wrench_of(item: Weighed, contact: Contact) -> Array:
    """What the contact must be so that nothing is left, (n, 6), moment about the ground origin."""
    inside = (item.times >= contact.start_s - 1e-9) & (item.times <= contact.end_s + 1e-9) & item.usable
    rows = np.flatnonzero(inside)
    found = np.zeros((len(item.times), 6))
    if len(rows):
        force, moment, _ = _solved(item, contact.segment, rows, np.array(contact.point))
        found[rows] = np.concatenate([force, moment], axis=1)
    return found


def _about(item: Weighed, segment: str, rows: NDArray[np.intp]) -> Array:
    """Moment of the disagreement about a segment's origin, (n, 3)."""
    origin, _ = item.segment_frame(segment)
    arm = origin[rows] - item.about[rows]
    return np.asarray(item.gap[rows, 3:] - np.cross(arm, item.gap[rows, :3]))


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """The best point of a segment, what is left, and twice the negative logarithm of its likelihood."""

    point: Array
    left: float
    misfit: float


def _point(spells: Sequence[_Spell], segment: str) -> _Fit:
    """The point of the segment about which the disagreement has least moment."""
    wander = _wander(segment)
    normal, target, spread, count = np.zeros((3, 3)), np.zeros(3), 0.0, 0
    for spell in spells:
        item, rows = spell.item, spell.rows
        force = item.gap[rows, :3]
        lever = -_crossing(force) @ item.segment_frame(segment)[1][rows].transpose(0, 2, 1)
        weight = _weights(item, force, wander)
        normal += np.einsum("nak,nab,nbl->kl", lever, weight, lever)
        target += np.einsum("nak,nab,nb->k", lever, weight, _about(item, segment, rows))
        spread -= float(np.linalg.slogdet(weight)[1].sum())
        count += 3 * len(rows)
    point = np.linalg.solve(normal + 1e-9 * np.trace(normal) * np.eye(3), target)
    low, high = _extent(spells[0].item, segment)
    point = np.clip(point, low, high)
    left = sum(float(_solved(s.item, segment, s.rows, point)[2].sum()) for s in spells)
    # frames are not independent: the likelihood counts one of them for each period of the filter
    share = float(np.median(np.diff(spells[0].item.times))) * 2.0 * spells[0].item.cutoff_hz
    misfit = min(1.0, share) * (count * np.log(max(left, 1e-12) / count) + spread)
    return _Fit(point, left, misfit)


def _extent(item: Weighed, segment: str) -> tuple[Array, Array]:
    """Corners of the box (in the segment's frame, m) in which something could touch it, each (3,)."""
    own = [np.array(m.nominal) for m in item.model.markers if m.segment == segment]
    places = np.array([*own, np.array(item.model.segment(segment).com)])
    return places.min(axis=0) - _SKIN_M, places.max(axis=0) + _SKIN_M


def _wander(segment: str) -> float:
    return WANDER_M["foot" if segment.startswith(FEET) else "other"]


def _solved(item: Weighed, segment: str, rows: NDArray[np.intp], point: Array) -> tuple[Array, Array, Array]:
    """Force on the body, its moment about the ground origin, and the whitened square left, (n,)."""
    origin, axes = item.segment_frame(segment)
    force, wander = -item.gap[rows, :3], _wander(segment)
    place = origin[rows] + np.einsum("njk,j->nk", axes[rows], point)
    left = item.gap[rows, 3:] - np.cross(place - item.about[rows], item.gap[rows, :3])
    weight = _weights(item, force, wander)
    square = np.einsum("na,nab,nb->n", left, weight, left)
    inside = _crossing(force) * wander
    spread = inside @ inside.transpose(0, 2, 1)
    wandering = np.einsum("nab,nbc,nc->na", spread, weight, left)
    return force, np.cross(place, force) - wandering, square


def _weights(item: Weighed, force: Array, wander: float) -> Array:
    """Inverse covariance of the moment left, (n, 3, 3): its floor and the wandering of the point."""
    inside = _crossing(force) * wander
    return np.asarray(np.linalg.inv(inside @ inside.transpose(0, 2, 1) + np.diag(item.floor[3:] ** 2)))


def _crossing(vectors: Array) -> Array:
    """The matrices (n, 3, 3) of the cross product with vectors (n, 3)."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)


def _p(spells: Sequence[_Spell], segment: str, stretch_s: float) -> float:
    """How likely chance leaves so little moment about one point, stretch by stretch."""
    parts = [
        _Spell(spell.item, rows)
        for spell in spells
        for s in stretches_of(spell.item.item, _length(spells, stretch_s))
        if len(rows := spell.rows[(spell.rows >= s.start) & (spell.rows < s.stop)]) >= _FEWEST
    ]
    if len(parts) < _MANY:
        return _short_p(spells, segment)
    ratios = []
    for known, new in ((parts[0::2], parts[1::2]), (parts[1::2], parts[0::2])):
        point = _point(known, segment).point
        for part in new:
            left = float(_solved(part.item, segment, part.rows, point)[2].sum())
            gap = float(np.square(part.item.gap[part.rows] / part.item.floor).sum())
            ratios.append(np.log(max(gap - left, 1e-12) / max(left, 1e-12)))
    return above(np.array(ratios))


def _length(spells: Sequence[_Spell], stretch_s: float) -> float:
    """Shorter stretches for a short contact, yet longer than the filter's memory, s."""
    lasting = sum(float(np.ptp(s.item.times[s.rows])) for s in spells)
    memory = max(1.0 / s.item.cutoff_hz for s in spells)
    return min(stretch_s, max(memory, lasting / _PARTS))


def _short_p(spells: Sequence[_Spell], segment: str) -> float:
    """For contacts too short for stretches: how far the force stands above what is left of the moment."""
    fit = _point(spells, segment)
    count = 3.0 * sum(len(s.rows) for s in spells)
    force = sum(float(np.square(s.item.gap[s.rows, :3] / s.item.floor[:3]).sum()) for s in spells) / count
    return float(np.exp(-0.5 * min(max(force - 3.0 * fit.left / count, 0.0), 1e3)))
