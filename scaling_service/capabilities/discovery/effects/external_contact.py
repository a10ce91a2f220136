"""Something touches a segment and no plate measures it.

The force may take any course, so the force part of the disagreement says nothing by itself. What speaks for
a contact is its moment: about the point where it acts there is none. A foot's contact wanders over its sole,
any other contact a little; so much the moment may differ.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import scipy

from scaling_service.capabilities.discovery.effects.catalogue import Effect
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate
from scaling_service.capabilities.discovery.evidence.statistics import (
    Fitted,
    HeldOut,
    assess_above_zero,
    assess_lead,
    find_best_span,
)
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Contact, Estimate
from scaling_service.capabilities.discovery.laws.contacts import (
    Fitting,
    Spell,
    compute_costs,
    find_edges,
    fit_edges,
    fit_point,
    is_throughout,
    join_edges,
)
from scaling_service.capabilities.discovery.observations.wrench import FEET, WrenchFit
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
_FEWEST, _MANY = 5, 8  # frames of a block, and blocks, from which something can be said (both chosen)
_PARTS = 10  # blocks that a contact should have at least (chosen: fewer can be sure of nothing)
_PICKED = 2.0 * _STRONG  # chosen: frames of four times the usual square and more have about eight times it
_MOSTLY = 0.8  # chosen: of a contact's frames, in which a foot must rest, and no plate's pressure be near
_COMMON = 0.7  # chosen: of the time that contacts in several trials cover, what they share if they are one
_ALIKE = 6.0
"""Twice the difference of log-likelihoods below which segments are not told apart (chosen: 1 in 20)."""

_LEVEL = 0.05  # chosen: the custom
KIND = "external_contact"


def find_contacts(fit: Fit) -> Iterator[ScoredCandidate]:
    """Those of :func:`find_touches` at segments where none is known already, in the same trials or in all."""
    known = [e.candidate for e in fit.effects if e.candidate.kind == KIND]
    for found in find_touches(fit.wrenches, fit.settings.block_s):
        own = found.candidate
        if not any(c.where == own.where and c.trials in ((), own.trials) for c in known):
            yield found


def find_touches(wrenches: Sequence[WrenchFit], block_s: float) -> list[ScoredCandidate]:
    """The best segment of every trial in which the force stands out, and of all of them if all do alike."""
    level = _measure_level(wrenches)
    looked_at = [_find_spell(item, level) or _span_trial(item) for item in wrenches]
    spells = [spell for spell in looked_at if spell is not None]
    found = [_find_best([spell], (spell.wrench.name,), block_s) for spell in spells]
    if len(spells) == len(wrenches) > 1 and _are_alike(spells):
        found.append(_find_best(spells, (), block_s))
    return [touch for touch in found if touch is not None]


def _are_alike(spells: Sequence[Spell]) -> bool:
    """Whether contacts last throughout their trials, or from and to the same times in all."""
    if all(is_throughout(s.wrench, s.rows) for s in spells):
        return True
    spans = np.array([s.wrench.times[s.rows[[0, -1]]] for s in spells])
    common = spans[:, 1].min() - spans[:, 0].max()
    return bool(common > _COMMON * (spans[:, 1].max() - spans[:, 0].min()))


def _measure_level(wrenches: Sequence[WrenchFit]) -> float:
    """Whitened square per number of the force where it disagrees least, at least one."""
    quiet = [
        float(np.quantile(np.square(item.residuals[item.usable, :3] / item.floor[:3]).mean(axis=1), _QUIET))
        for item in wrenches
        if item.usable.any()
    ]
    return max(1.0, min(quiet, default=1.0))


def _find_spell(item: WrenchFit, level: float) -> Spell | None:
    """The block of time in which the force disagrees much more than where it is quietest."""
    strength = np.square(item.residuals[:, :3] / item.floor[:3]).mean(axis=1)
    usual = float(np.median(strength[item.usable])) if item.usable.any() else 0.0
    allowed = _STRONG * max(level, min(usual, _STRONG * level))
    excess = np.where(item.usable, strength - allowed, 0.0)
    _, found = find_best_span(excess)
    start, stop = found.start, found.stop
    if stop <= start or item.times[stop - 1] - item.times[start] < _SHORTEST_S:
        return None
    if excess[start:stop].clip(0.0).sum() < _MAIN * excess.clip(0.0).sum():
        return None  # it stands out as much at other times
    rows = np.arange(start, stop)[item.usable[start:stop]]
    return Spell(item, rows) if len(rows) >= _FEWEST else None


def _span_trial(item: WrenchFit) -> Spell | None:
    """All frames, where the force disagrees even in the quietest."""
    rows = np.flatnonzero(item.usable)
    strength = np.square(item.residuals[rows, :3] / item.floor[:3]).mean(axis=1)
    if len(rows) < _FEWEST or np.quantile(strength, _QUIET) < _STRONG:
        return None
    return Spell(item, rows, all_along=True)


def _list_reachable(item: WrenchFit) -> list[str]:
    """Segments that carry markers."""
    shown = {item.model.marker(m).segment for m in item.tracked.markers}
    return [s.name for s in item.model.segments if s.name in shown]


def _find_best(spells: Sequence[Spell], trials: tuple[str, ...], block_s: float) -> ScoredCandidate | None:
    names = [
        n for n in _list_reachable(spells[0].wrench) if all(n in _list_reachable(s.wrench) for s in spells)
    ]
    if not names:
        return None
    gap = sum(s.square for s in spells)
    fits = {name: fit_point(spells, name) for name in names}
    beside = [n for n in names if n.startswith(FEET) and all(_stands_beside_plates(s, n) for s in spells)]
    likely = [n for n in beside if fits[n].left < _LEAST_SHARE * gap]
    if not likely and not any(s.all_along for s in spells):
        lasting = all(is_throughout(s.wrench, s.rows) for s in spells)
        free = [n for n in names if not any(_is_of_a_plate(s, fits[n]) for s in spells)]
        likely = [n for n in names if n.startswith(_HANDS)] if lasting else free
    if not likely:
        return None
    order = sorted(likely, key=lambda name: fits[name].misfit)
    best = fits[order[0]]
    square = sum(s.wrench.square for s in spells)
    p = _compute_p(spells, order[0], block_s)
    fitting = [s for s in spells if s.wrench.role == "fit"] or spells  # as all other effects are judged
    left = [s.left_about(order[0], best.point) for s in fitting]
    gain = float(np.sum([s.square - rest for s, rest in zip(fitting, left, strict=True)]))
    fitted = Fitted.of_any_course(gain, float(np.sum(left)), p)
    near = [n for n in order[1:] if _is_not_distinguished(_split_into_blocks(spells, block_s), best, fits[n])]
    made = [_make_candidate(_make_contact(spells, n, fits[n].point), trials) for n in (order[0], *near)]
    tried = HeldOut((gap - best.left) / square, p, folds=True)
    return ScoredCandidate(
        candidate=made[0], fitted=fitted, gains=None, held_out=tried, equivalents=tuple(made[1:])
    )


def _make_candidate(contact: Contact, trials: tuple[str, ...]) -> Candidate:
    return Candidate(kind=KIND, where=(contact.segment,), columns=(), trials=trials, change=contact)


def _stands_beside_plates(spell: Spell, foot: str) -> bool:
    """Whether a foot rests low and still most of the time, and no loaded plate's pressure is near it."""
    item, rows = spell.wrench, spell.rows
    on = [k for k, m in enumerate(item.tracked.markers) if item.model.marker(m).segment == foot]
    places = item.tracked.task.measured
    speed = np.linalg.norm(np.gradient(places[:, on], item.times, axis=0), axis=2)
    lowest = np.nanmin(places[..., 1])
    still = (speed < _STILL_M_S) & (places[:, on, 1] < lowest + _LOW_M)
    if still[rows].any(axis=1).mean() < _MOSTLY:
        return False
    return _measure_bearing_share(spell, foot) < 1.0 - _MOSTLY


def _is_of_a_plate(spell: Spell, fitting: Fitting) -> bool:
    """Whether a plate presses at a point, or under a foot, for more than a moment: then it is at fault."""
    if fitting.segment.startswith(FEET) and _measure_bearing_share(spell, fitting.segment) >= 1.0 - _MOSTLY:
        return True
    origin, axes = (places[spell.rows] for places in spell.wrench.segment_frame(fitting.segment))
    away = _find_pressure(spell) - (origin + axes @ fitting.point)[:, None]
    return _share_near(away) >= 1.0 - _MOSTLY


def _measure_bearing_share(spell: Spell, foot: str) -> float:
    """In which share of frames a plate's pressure is near a foot, seen from above."""
    item = spell.wrench
    on = [k for k, m in enumerate(item.tracked.markers) if item.model.marker(m).segment == foot]
    centre = np.nanmean(item.tracked.task.measured[spell.rows][:, on], axis=1)
    return _share_near((_find_pressure(spell) - centre[:, None])[..., [0, 2]])


def _find_pressure(spell: Spell) -> Array:
    return spell.wrench.contacts.ground.centre_of_pressure()[spell.rows]


def _share_near(away: Array) -> float:
    apart = np.nan_to_num(np.linalg.norm(away, axis=2), nan=np.inf)
    return float((apart.min(axis=1) < _NEAR_M).mean())


def _make_contact(spells: Sequence[Spell], segment: str, point: Array) -> Contact:
    x, y, z = (float(v) for v in point)
    if all(is_throughout(s.wrench, s.rows) for s in spells):
        start, end = (
            min(float(s.wrench.times[0]) for s in spells),
            max(float(s.wrench.times[-1]) for s in spells),
        )
    else:
        (start, _), (end, _) = join_edges(
            [fit_edges(s.wrench, s.rows, s.wrench.residuals[:, :3]) for s in spells]
        )
    return Contact(segment, start, end, (x, y, z))


def _compute_p(spells: Sequence[Spell], segment: str, block_s: float) -> float:
    """How likely chance leaves so little moment about one point, block by block."""
    parts = _split_into_blocks(spells, block_s)
    if len(parts) < _MANY:
        return _compute_brief_p(spells, segment)
    ratios = []
    for known, new in ((parts[0::2], parts[1::2]), (parts[1::2], parts[0::2])):
        point = fit_point(known, segment).point
        for part in new:
            left = part.left_about(segment, point)
            ratios.append(np.log(max(part.square - left, 1e-12) / max(left, 1e-12)))
    return assess_above_zero(np.array(ratios))


def _split_into_blocks(spells: Sequence[Spell], block_s: float) -> list[Spell]:
    """The frames by blocks of time."""
    return [
        Spell(spell.wrench, rows)
        for spell in spells
        for s in spell.wrench.blocks(_choose_block_length(spells, block_s))
        if len(rows := spell.rows[(spell.rows >= s.start) & (spell.rows < s.stop)]) >= _FEWEST
    ]


def _is_not_distinguished(parts: Sequence[Spell], best: Fitting, other: Fitting) -> bool:
    """Whether chance makes the difference: the moment's noise, or what differs from part to part.

    A few frames far apart make no part, and then nothing tells segments apart.
    """
    if not parts or other.misfit - best.misfit < _ALIKE:
        return True
    scale = max(best.left, 1e-12) / (3.0 * sum(len(part.rows) for part in parts))
    return assess_lead(-compute_costs(parts, best, scale), -compute_costs(parts, other, scale), 0.0) > _LEVEL


def _choose_block_length(spells: Sequence[Spell], block_s: float) -> float:
    """Shorter blocks for a short contact, yet longer than the filter's memory, s."""
    lasting = sum(float(np.ptp(s.wrench.times[s.rows])) for s in spells)
    memory = max(1.0 / s.wrench.cutoff_hz for s in spells)
    return float(min(block_s, max(memory, lasting / _PARTS)))


def _compute_brief_p(spells: Sequence[Spell], segment: str) -> float:
    """For contacts too brief for blocks: how far force and moment stand above what is left of the moment.

    Both are taken to be as many independent numbers as pass the filter. Frames were picked because their
    force stands out, so that much is no evidence.
    """
    left = fit_point(spells, segment).left
    gap = sum(s.square for s in spells)
    passed = sum(2.0 * s.wrench.cutoff_hz * len(s.rows) / s.wrench.tracked.trial.rate_hz for s in spells)
    own, others = 3.0 * passed, max(3.0 * passed - 3.0, 1.0)
    ratio = (gap - left) / own / max(left / others, 1e-12)
    return float(scipy.stats.f.sf(ratio / _PICKED, own, others))


def _describe_contact(effect: Estimate, after: Fit) -> Mapping[str, float]:
    """From when to when, where on the segment, and how strong."""
    contact = effect.candidate.change
    assert isinstance(contact, Contact)
    point = dict(zip(("x_mm", "y_mm", "z_mm"), (1e3 * v for v in contact.point), strict=True))
    rms, _ = _measure_rms(_list_touched(effect, after), contact)
    return {"start_s": contact.start_s, "end_s": contact.end_s, "rms_N": rms, **point}


def _estimate_contact_spreads(effect: Estimate, after: Fit) -> Mapping[str, float]:
    """Of its beginning, end and strength, where it has both of the former."""
    contact = effect.candidate.change
    assert isinstance(contact, Contact)
    here = _list_touched(effect, after)
    edges = find_edges(here, contact)
    if edges is None:
        return {}
    (_, of_start), (_, of_end) = edges
    rms, of_noise = _measure_rms(here, contact)
    # The mean square over an interval that is longer by a share is smaller by that share; a force that grows
    # and fades slowly hides at both ends.
    of_interval = 0.5 * rms * (of_start + of_end) / (contact.end_s - contact.start_s)
    return {"start_s": of_start, "end_s": of_end, "rms_N": float(np.hypot(of_noise, of_interval))}


def _list_touched(effect: Estimate, after: Fit) -> list[WrenchFit]:
    shown = [item for item in after.wrenches if effect.candidate.holds_in(item.name)]
    return [item for item in shown if item.touched is not None]


def _measure_rms(here: Sequence[WrenchFit], contact: Contact) -> tuple[float, float]:
    """RMS of the force inferred, free of what noise adds to it, and what noise makes of it, N."""
    squares, noise, independent = [], [], 0.0
    for item in here:
        assert item.touched is not None
        inside = (item.times >= contact.start_s) & (item.times <= contact.end_s) & item.usable
        squares.append(np.square(item.touched[inside, :3]).sum(axis=1))
        noise.append(np.full(int(inside.sum()), np.square(item.floor[:3]).sum()))
        independent += inside.sum() * 2.0 * item.cutoff_hz / item.tracked.trial.rate_hz
    if independent < 1.0:
        return float("nan"), float("nan")
    added = float(np.concatenate(noise).mean())
    rms = np.sqrt(max(float(np.concatenate(squares).mean()) - added, 0.0))
    return float(rms), float(np.sqrt(added / 3.0 / independent))


EFFECTS = (
    Effect(
        kind=KIND,
        meaning="something touches the segment that no plate measures",
        search=find_contacts,
        seen_in="wrench",
        details=_describe_contact,
        spreads=_estimate_contact_spreads,
    ),
)
