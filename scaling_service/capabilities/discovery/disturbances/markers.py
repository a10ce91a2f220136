"""Disturbances of the markers: a volume bent or warped, a late marker, feet that slip, shaken cameras."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np
import scipy

from scaling_service.capabilities.discovery.disturbances.disturbance import Disturbance, DisturbanceLaw
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate
from scaling_service.capabilities.discovery.evidence.statistics import explain, try_held_out
from scaling_service.capabilities.discovery.evidence.sums import Evidence, select_fitting_blocks
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column, Part
from scaling_service.capabilities.discovery.laws.profiles import HighPassed, Passing, Standing, is_stance
from scaling_service.capabilities.discovery.laws.spots import (
    LETTERS,
    BentSpot,
    JointSpot,
    MarkerSpot,
    Spot,
    VolumeSpot,
    WarpedSpot,
)
from scaling_service.capabilities.discovery.observations.tracked import TrackedTrial
from scaling_service.numerics.multibody.laws import Array

_UNIT = np.eye(3)
_SMOOTHED = 2.0  # acceleration over half the square of a delay; chosen: 0.5 is a delay alone
_SMOOTHED_HZ = (0.7, 1.4, 2.8)  # cut-offs; chosen: octaves below what smoothing of movements should leave
_EVERY = 50  # of places looked at for a size that is reported (chosen: thousands are left)
_SLOWEST_HZ = 6.0  # chosen: above what people do (Winter 2009, sec. 3.4.3)
_FASTEST = 0.45  # of the frame rate
_NEAR = (1.5, 15.0)  # widths of a line between which other frequencies are its neighbours (chosen)
_SHARE = 0.25  # of the strongest line: half its amplitude, more than a pose hands on to a neighbour (chosen)


def propose_bent_volume(fit: Fit) -> Iterator[Candidate]:
    """All markers pushed away from a middle, or towards it, with the cube of their distance: a lens."""
    seen = np.concatenate([item.task.measured.reshape(-1, 3) for item in fit.tracked])
    x, y, z = np.nanmean(seen, axis=0).tolist()
    spots: list[Spot] = [VolumeSpot(), *(BentSpot((x, y, z), toward) for toward in (None, 0, 1, 2))]
    columns = tuple(Column(name=str(spot), unit=1.0, parts=(Part(spot),)) for spot in spots)
    yield Candidate(kind="bent_volume", where=("markers",), columns=columns)


def _describe_bent(found: ScoredCandidate) -> tuple[tuple[str, ...], str]:
    way = "away from" if found.fitted.size[1] > 0.0 else "towards"
    law = f"the measured volume is bent: markers are pushed {way} its middle by the cube of the distance"
    return found.candidate.where, law


def propose_warped_volume(fit: Fit) -> Iterator[Candidate]:
    """All markers displaced by one smooth function of where they are in the room, up to second order."""
    x, y, z = np.nanmean(_list_seen_places(fit), axis=0).tolist()
    products = [(k,) for k in range(3)] + list(combinations_with_replacement(range(3), 2))
    spots = [WarpedSpot((x, y, z), factors, axis) for factors in products for axis in range(3)]
    columns = tuple(Column(name=str(spot), unit=1.0, parts=(Part(spot),)) for spot in spots)
    yield Candidate(kind="warped_volume", where=("markers",), columns=columns)


def _list_seen_places(fit: Fit) -> Array:
    return np.concatenate([item.task.measured.reshape(-1, 3) for item in fit.tracked])


def _judge_warped(fit: Fit, evidence: Evidence, index: int, candidate: Candidate) -> Disturbance:
    """Judged by the blocks between those that it was fitted to.

    It has more numbers than there may be blocks of time to tell their spread from. Held-out trials are among
    those blocks: where nobody was in those to fit, they say nothing of the room.
    """
    fitting = select_fitting_blocks(evidence.blocks, candidate)
    every = [replace(block, role="fit") for block in evidence.blocks]
    between, anywhere = (
        try_held_out(replace(evidence, blocks=tuple(blocks)), index, candidate) for blocks in (fitting, every)
    )
    gain = between.gain * sum(block.square for block in fitting)
    most = _measure_furthest(candidate, explain(evidence, index, fitting).size, _list_seen_places(fit))
    law = f"the measured volume is warped: by position in the room alone, by up to {1e3 * most:.2g} mm"
    return Disturbance(where=candidate.where, law=law, expected=gain, p=between.p, held_out=anywhere.p)


def _measure_furthest(warped: Candidate, size: Array, seen: Array) -> float:
    """How far the field moves a marker, beyond what a rigid body does, 95 % of the time, m."""
    places = seen[np.isfinite(seen).all(axis=1)][::_EVERY]
    moved = np.zeros_like(places)
    spots = [column.parts[0].spot for column in warped.columns]
    for s, spot in zip(size.tolist(), spots, strict=True):
        assert isinstance(spot, WarpedSpot)
        moved += s * spot.field(places[:, :, None])[:, :, 0]
    away = places - places.mean(axis=0)
    turns = np.concatenate(
        [np.cross(_UNIT, away[:, None]).transpose(0, 2, 1), np.tile(_UNIT, (len(away), 1, 1))], 2
    )
    rigid = turns.reshape(-1, 6)
    left = (moved.ravel() - rigid @ np.linalg.lstsq(rigid, moved.ravel())[0]).reshape(-1, 3)
    return float(np.quantile(np.linalg.norm(left, axis=1), 0.95))


def propose_late_markers(fit: Fit) -> Iterator[Candidate]:
    """Markers displaced along their paths: by velocity and acceleration, as what is late or smoothed is."""
    for segment in fit.scene.bearing:
        for group in fit.scene.groups_on(segment.name):
            columns = tuple(_follow_paths(group, order) for order in (1, 2))
            yield Candidate(kind="late_marker", where=group, columns=columns)


def _follow_paths(markers: Sequence[str], order: int) -> Column:
    parts = tuple(Part(MarkerSpot(m, k), Passing(m, order, k)) for m in markers for k in range(3))
    return Column(name=f"rate {order}", unit=1.0, parts=parts)


def _describe_late(found: ScoredCandidate) -> tuple[tuple[str, ...], str]:
    markers, (speed, bend) = found.candidate.where, found.fitted.size.tolist()
    said, one = ", ".join(markers), len(markers) == 1
    if bend > _SMOOTHED * speed**2:
        verb = "is" if one else "are"
        return markers, f"{said} {verb} smoother than the others: off along the acceleration"
    way, verb = "late" if speed < 0.0 else "early", "comes" if one else "come"
    return markers, f"{said} {verb} {abs(1e3 * speed):.2g} ms {way}: off along the own path"


def propose_smoothed_markers(fit: Fit) -> Iterator[Candidate]:
    """Markers that lack what is fast in their own paths: filtered unlike the others, or filled over gaps."""
    for segment in fit.scene.bearing:
        for group in fit.scene.groups_on(segment.name):
            for frequency in _SMOOTHED_HZ:
                parts = tuple(
                    Part(MarkerSpot(m, k), HighPassed(m, frequency, k)) for m in group for k in range(3)
                )
                yield Candidate(
                    kind="smoothed_marker",
                    where=group,
                    columns=(Column(name="share", unit=1.0, parts=parts),),
                    note=str(frequency),
                )


def _describe_smoothed(found: ScoredCandidate) -> tuple[tuple[str, ...], str]:
    markers, (share,) = found.candidate.where, found.fitted.size.tolist()
    verb = ("lack" if share < 0.0 else "exaggerate") + ("s" if len(markers) == 1 else "")
    fast = f"{abs(share):.0%} of what is faster than {found.candidate.note} Hz in the own path"
    return markers, f"{', '.join(markers)} {verb} {fast}"


def propose_slipping(fit: Fit) -> Iterator[Candidate]:
    """Markers of every segment that comes to stand again and again: they creep while it does, in a shoe."""
    for segment in fit.scene.jointed:
        markers = fit.scene.on(segment.name)
        if markers and all(is_stance(item, markers) for item in fit.tracked):
            spots = [JointSpot(segment.name, "after", "translation", k) for k in range(len(LETTERS))]
            parts = [(Part(spot, Standing(markers)),) for spot in spots]
            columns = tuple(
                Column(name=letter, unit=1.0, parts=part) for letter, part in zip(LETTERS, parts, strict=True)
            )
            yield Candidate(kind="slipping", where=markers, columns=columns, note=segment.name)


def _describe_slipped(found: ScoredCandidate) -> tuple[tuple[str, ...], str]:
    along = ", ".join(f"{1e3 * v:.3g}" for v in found.fitted.size.tolist())
    law = f"the markers of {found.candidate.note} creep by ({along}) mm/s along its axes while it stands"
    return found.candidate.where, law


def find_trembling(fit: Fit) -> Iterator[Disturbance]:
    """One line in the spectrum of what is left of the markers, over all trials that are to fit.

    Markers tremble with time itself where a camera's mount shakes or a lamp flickers.
    """
    items = [item for item in fit.tracked if item.role == "fit"]
    markers = tuple(m for m in items[0].markers if all(m in item.markers for item in items)) if items else ()
    if not markers:
        return
    frequencies, width = _make_frequency_grid(items)
    if len(frequencies) < 2 * int(_NEAR[1] / _NEAR[0]):
        return
    power = np.sum([_compute_power(item, markers, frequencies) for item in items], axis=0)
    whole = power.sum(axis=1)
    k = int(np.argmax(whole))
    away = np.abs(frequencies - frequencies[k]) / width
    near = (away > _NEAR[0]) & (away < _NEAR[1])
    usual, spread = float(whole[near].mean()), float(whole[near].var())
    if not usual > 0.0:
        return
    shape = usual**2 / max(spread, 1e-300)
    tried = np.ptp(frequencies) / width
    p = min(1.0, tried * float(scipy.stats.gamma.sf(shape * whole[k] / usual, shape)))
    shaking = [m for m, own in zip(markers, power[k].tolist(), strict=True) if own > _SHARE * power[k].max()]
    everywhere = len(shaking) > len(markers) / 2
    places = "markers" if everywhere else ", ".join(shaking)
    verb = "trembles" if len(shaking) == 1 else "tremble"
    law = f"{places} {verb} at {frequencies[k]:.3g} Hz, whatever the movement"
    where = ("markers",) if everywhere else tuple(shaking)
    yield Disturbance(where=where, law=law, expected=float(whole[k] - 2.0 * usual), p=p, held_out=p)


def _make_frequency_grid(items: Sequence[TrackedTrial]) -> tuple[Array, float]:
    """Frequencies (Hz), five to a line of the longest trial, and the width of such a line."""
    width = 1.0 / max(float(np.ptp(item.trial.times)) for item in items)
    fastest = _FASTEST * min(item.trial.rate_hz for item in items)
    return np.arange(_SLOWEST_HZ, fastest, width / 5.0), width


def _compute_power(item: TrackedTrial, markers: Sequence[str], frequencies: Array) -> Array:
    """What a wave of each frequency takes off each marker's whitened squares, (n_frequencies, n_markers)."""
    at = [item.markers.index(m) for m in markers]
    left = np.nan_to_num(item.residuals[:, at] / item.floor[at][:, None])
    seen = item.seen[:, at].sum(axis=0).clip(1)
    wave = np.exp(-2j * np.pi * np.outer(frequencies, item.trial.times))
    lines = np.square(np.abs(np.tensordot(wave, left, axes=1)))
    return np.asarray(2.0 * lines.sum(axis=2) / seen)


LAWS = (
    DisturbanceLaw(propose_bent_volume, _describe_bent),
    DisturbanceLaw(propose_warped_volume, judge=_judge_warped),
    DisturbanceLaw(propose_late_markers, _describe_late),
    DisturbanceLaw(propose_smoothed_markers, _describe_smoothed),
    DisturbanceLaw(propose_slipping, _describe_slipped),
    DisturbanceLaw(search=find_trembling),
)
