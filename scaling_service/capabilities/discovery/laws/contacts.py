"""Something touches a segment and no plate measures it.

The force may take any course, so the force part of the disagreement says nothing by itself. What speaks for
a contact is its moment: about the point where it acts there is none. A foot's contact wanders over its sole,
any other contact a little; so much the moment may differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from scaling_service.capabilities.discovery.evidence.score import stretches_of
from scaling_service.capabilities.discovery.evidence.weighed import Weighed
from scaling_service.capabilities.discovery.laws.contact_points import (
    FEET,
    Fitting,
    Spell,
    costs,
    fitted_point,
    solved,
)
from scaling_service.capabilities.discovery.laws.contact_times import edges, lasts_throughout, together
from scaling_service.capabilities.discovery.laws.freedoms import above
from scaling_service.capabilities.discovery.search.candidates import Contact
from scaling_service.capabilities.discovery.search.comparing import no_worse
from scaling_service.capabilities.discovery.search.judging import Fitted
from scaling_service.numerics.multibody.laws import Array

_HANDS = ("hand", "radius", "forearm")
"""What may hold on to something throughout; anything else touched all the time is a fault of a plate."""

_STRONG = 4.0  # chosen: of the level of the disagreement elsewhere, from which a contact is looked for
_SHORTEST_S = 0.1  # chosen: a shorter one is a knock
_LEAST_SHARE = 0.2
"""Of the whole disagreement that may be left where a foot is known to rest beside the plates (chosen)."""

_STILL_M_S, _LOW_M, _NEAR_M = 0.2, 0.1, 0.15
"""A resting foot is slower, lies lower above the lowest marker, and bears on a plate when pressure is nearer
(chosen: a swinging foot moves at 1 to 4 m/s; a shoe is 0.3 m long)."""

_MAIN = 0.6  # chosen: of all that stands out in a trial, what one contact must hold
_QUIET = 0.1  # chosen: the quietest tenth of the frames
_FEWEST, _MANY = 5, 8  # frames of a stretch, and stretches, from which something is told (both chosen)
_PARTS = 10  # stretches that a contact should have at least (chosen: fewer can be sure of nothing)
_PICKED = 2.0 * _STRONG  # chosen: frames of four times the usual square and more have about eight times it
_MOSTLY = 0.8  # chosen: of a contact's frames, in which a foot must rest, and no plate's pressure be near
_COMMON = 0.7  # chosen: of the time that contacts in several trials cover, what they share if they are one
_ALIKE = 6.0
"""Twice the difference of log-likelihoods below which segments are not told apart (chosen: 1 in 20)."""
_LEVEL = 0.05  # chosen: the custom


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


def touches(weighed: Sequence[Weighed], stretch_s: float) -> list[Touch]:
    """The best segment of every trial in which the force stands out, and of all of them if all do alike."""
    level = _level(weighed)
    looked_at = [_spell(item, level) or _whole_trial(item) for item in weighed]
    spells = [spell for spell in looked_at if spell is not None]
    found = [_best([spell], (spell.item.name,), stretch_s) for spell in spells]
    if len(spells) == len(weighed) > 1 and _alike(spells):
        found.append(_best(spells, (), stretch_s))
    return [touch for touch in found if touch is not None]


def _alike(spells: Sequence[Spell]) -> bool:
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


def _spell(item: Weighed, level: float) -> Spell | None:
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
    return Spell(item, rows) if len(rows) >= _FEWEST else None


def _whole_trial(item: Weighed) -> Spell | None:
    """All frames, where the force disagrees even in the quietest."""
    rows = np.flatnonzero(item.usable)
    strength = np.square(item.gap[rows, :3] / item.floor[:3]).mean(axis=1)
    if len(rows) < _FEWEST or np.quantile(strength, _QUIET) < _STRONG:
        return None
    return Spell(item, rows, all_along=True)


def _reachable(item: Weighed) -> list[str]:
    """Segments that carry markers."""
    shown = {item.model.marker(m).segment for m in item.item.markers}
    return [s.name for s in item.model.segments if s.name in shown]


def _best(spells: Sequence[Spell], trials: tuple[str, ...], stretch_s: float) -> Touch | None:
    names = [n for n in _reachable(spells[0].item) if all(n in _reachable(s.item) for s in spells)]
    if not names:
        return None
    gap = sum(float(np.square(s.item.gap[s.rows] / s.item.floor).sum()) for s in spells)
    fits = {name: fitted_point(spells, name) for name in names}
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
    fitting = [s for s in spells if s.item.role == "fit"] or spells  # as all other effects are judged
    taken = [_taken(s, order[0], best.point) for s in fitting]
    gain, left = np.sum(taken, axis=0).tolist()
    fitted = Fitted(np.zeros(0), np.zeros((0, 0)), gain, left, p, 1.0)
    near = [n for n in order[1:] if _not_told_apart(_parts(spells, stretch_s), best, fits[n])]
    contact, *others = (_contact(spells, n, fits[n].point) for n in (order[0], *near))
    return Touch(contact, trials, fitted, (gap - best.left) / square, tuple(others))


def _taken(spell: Spell, segment: str, point: Array) -> tuple[float, float]:
    """Whitened squares that a contact takes off, and those that it leaves."""
    left = float(solved(spell.item, segment, spell.rows, point)[2].sum())
    return float(np.square(spell.item.gap[spell.rows] / spell.item.floor).sum()) - left, left


def _beside_plates(spell: Spell, foot: str) -> bool:
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


def _contact(spells: Sequence[Spell], segment: str, point: Array) -> Contact:
    x, y, z = (float(v) for v in point)
    if all(lasts_throughout(s.item, s.rows) for s in spells):
        start, end = min(float(s.item.times[0]) for s in spells), max(float(s.item.times[-1]) for s in spells)
    else:
        (start, _), (end, _) = together([edges(s.item, s.rows, s.item.gap[:, :3]) for s in spells])
    return Contact(segment, start, end, (x, y, z))


def _p(spells: Sequence[Spell], segment: str, stretch_s: float) -> float:
    """How likely chance leaves so little moment about one point, stretch by stretch."""
    parts = _parts(spells, stretch_s)
    if len(parts) < _MANY:
        return _brief_p(spells, segment)
    ratios = []
    for known, new in ((parts[0::2], parts[1::2]), (parts[1::2], parts[0::2])):
        point = fitted_point(known, segment).point
        for part in new:
            left = float(solved(part.item, segment, part.rows, point)[2].sum())
            gap = float(np.square(part.item.gap[part.rows] / part.item.floor).sum())
            ratios.append(np.log(max(gap - left, 1e-12) / max(left, 1e-12)))
    return above(np.array(ratios))


def _parts(spells: Sequence[Spell], stretch_s: float) -> list[Spell]:
    """The frames by stretches of time."""
    return [
        Spell(spell.item, rows)
        for spell in spells
        for s in stretches_of(spell.item.item, _length(spells, stretch_s))
        if len(rows := spell.rows[(spell.rows >= s.start) & (spell.rows < s.stop)]) >= _FEWEST
    ]


def _not_told_apart(parts: Sequence[Spell], best: Fitting, other: Fitting) -> bool:
    """Whether chance makes the difference: the moment's noise, or what differs from part to part.

    A few frames far apart make no part, and then nothing tells segments apart.
    """
    if not parts or other.misfit - best.misfit < _ALIKE:
        return True
    scale = max(best.left, 1e-12) / (3.0 * sum(len(part.rows) for part in parts))
    return no_worse(-costs(parts, best, scale), -costs(parts, other, scale), 0.0) > _LEVEL


def _length(spells: Sequence[Spell], stretch_s: float) -> float:
    """Shorter stretches for a short contact, yet longer than the filter's memory, s."""
    lasting = sum(float(np.ptp(s.item.times[s.rows])) for s in spells)
    memory = max(1.0 / s.item.cutoff_hz for s in spells)
    return min(stretch_s, max(memory, lasting / _PARTS))


def _brief_p(spells: Sequence[Spell], segment: str) -> float:
    """For contacts too brief for stretches: how far force and moment stand above what is left of the moment.

    Both are taken to be as many independent numbers as pass the filter. Frames were picked because their
    force stands out, so that much is no evidence.
    """
    left = fitted_point(spells, segment).left
    gap = sum(float(np.square(s.item.gap[s.rows] / s.item.floor).sum()) for s in spells)
    passed = sum(2.0 * s.item.cutoff_hz * len(s.rows) / s.item.item.trial.rate_hz for s in spells)
    own, others = 3.0 * passed, max(3.0 * passed - 3.0, 1.0)
    ratio = (gap - left) / own / max(left / others, 1e-12)
    return float(scipy.stats.f.sf(ratio / _PICKED, own, others))
