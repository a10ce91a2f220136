"""Disturbances of the markers: a bent volume, feet that slip, cameras that tremble."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy

from scaling_service.capabilities.discovery.disturbances.disturbance import Disturbance, DisturbanceLaw
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column, Part
from scaling_service.capabilities.discovery.laws.profiles import Standing, stands
from scaling_service.capabilities.discovery.laws.spots import LETTERS, BentSpot, JointSpot, Spot, VolumeSpot
from scaling_service.capabilities.discovery.observations.tracked import TrackedTrial
from scaling_service.numerics.multibody.laws import Array

_SLOWEST_HZ = 6.0  # chosen: above what people do (Winter 2009, sec. 3.4.3)
_FASTEST = 0.45  # of the frame rate
_NEAR = (1.5, 15.0)  # widths of a line between which other frequencies are its neighbours (chosen)
_SHARE = 0.25  # of the strongest line: half its amplitude, more than a pose hands on to a neighbour (chosen)


def bent_volume(fit: Fit) -> Iterator[Candidate]:
    """All markers pushed away from a middle, or towards it, with the cube of their distance: a lens."""
    seen = np.concatenate([item.task.measured.reshape(-1, 3) for item in fit.tracked])
    x, y, z = np.nanmean(seen, axis=0).tolist()
    spots: list[Spot] = [VolumeSpot(), *(BentSpot((x, y, z), toward) for toward in (None, 0, 1, 2))]
    columns = tuple(Column(str(spot), 1.0, (Part(spot),)) for spot in spots)
    yield Candidate("bent_volume", ("markers",), columns)


def _bent(found: ScoredCandidate) -> tuple[tuple[str, ...], str]:
    way = "away from" if found.fitted.size[1] > 0.0 else "towards"
    law = f"the measured volume is bent: markers are pushed {way} its middle by the cube of the distance"
    return found.candidate.where, law


def slipping(fit: Fit) -> Iterator[Candidate]:
    """Markers of every segment that comes to stand again and again: they creep while it does, in a shoe."""
    for segment in fit.scene.jointed:
        markers = fit.scene.on(segment.name)
        if markers and all(stands(item, markers) for item in fit.tracked):
            spots = [JointSpot(segment.name, "after", "translation", k) for k in range(len(LETTERS))]
            parts = [(Part(spot, Standing(markers)),) for spot in spots]
            columns = tuple(Column(letter, 1.0, part) for letter, part in zip(LETTERS, parts, strict=True))
            yield Candidate("slipping", markers, columns, note=segment.name)


def _slipped(found: ScoredCandidate) -> tuple[tuple[str, ...], str]:
    along = ", ".join(f"{1e3 * v:.3g}" for v in found.fitted.size.tolist())
    law = f"the markers of {found.candidate.note} creep by ({along}) mm/s along its axes while it stands"
    return found.candidate.where, law


def trembling(fit: Fit) -> Iterator[Disturbance]:
    """One line in the spectrum of what is left of the markers, over all trials that are to fit.

    Markers tremble with time itself where a camera's mount shakes or a lamp flickers.
    """
    items = [item for item in fit.tracked if item.role == "fit"]
    markers = tuple(m for m in items[0].markers if all(m in item.markers for item in items)) if items else ()
    if not markers:
        return
    frequencies, width = _grid(items)
    if len(frequencies) < 2 * int(_NEAR[1] / _NEAR[0]):
        return
    power = np.sum([_power(item, markers, frequencies) for item in items], axis=0)
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
    yield Disturbance(where, law, float(whole[k] - 2.0 * usual), p, p)


def _grid(items: Sequence[TrackedTrial]) -> tuple[Array, float]:
    """Frequencies (Hz), five to a line of the longest trial, and the width of such a line."""
    width = 1.0 / max(float(np.ptp(item.trial.times)) for item in items)
    fastest = _FASTEST * min(item.trial.rate_hz for item in items)
    return np.arange(_SLOWEST_HZ, fastest, width / 5.0), width


def _power(item: TrackedTrial, markers: Sequence[str], frequencies: Array) -> Array:
    """What a wave of each frequency takes off each marker's whitened squares, (n_frequencies, n_markers)."""
    at = [item.markers.index(m) for m in markers]
    left = np.nan_to_num(item.residuals[:, at] / item.floor[at][:, None])
    seen = item.seen[:, at].sum(axis=0).clip(1)
    wave = np.exp(-2j * np.pi * np.outer(frequencies, item.trial.times))
    lines = np.square(np.abs(np.tensordot(wave, left, axes=1)))
    return np.asarray(2.0 * lines.sum(axis=2) / seen)


LAWS = (
    DisturbanceLaw(bent_volume, _bent),
    DisturbanceLaw(slipping, _slipped),
    DisturbanceLaw(search=trembling),
)
