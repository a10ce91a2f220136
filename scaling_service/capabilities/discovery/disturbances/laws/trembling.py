"""Markers that tremble with time itself: a camera whose mount shakes, a lamp that flickers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy

from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.evidence.watched import Watched
from scaling_service.capabilities.discovery.search.findings import Foreign
from scaling_service.numerics.multibody.laws import Array

_SLOWEST_HZ = 6.0  # chosen: above what people do (Winter 2009, sec. 3.4.3)
_FASTEST = 0.45  # of the frame rate
_NEAR = (1.5, 15.0)  # widths of a line between which other frequencies are its neighbours (chosen)
_SHARE = 0.25  # of the strongest line: half its amplitude, more than a pose hands on to a neighbour (chosen)


def found(now: Account) -> Iterator[Foreign]:
    """One line in the spectrum of what is left of the markers, over all trials that are to fit."""
    items = [item for item in now.watched if item.role == "fit"]
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
    yield Foreign(where, law, float(whole[k] - 2.0 * usual), p, p)


def _grid(items: Sequence[Watched]) -> tuple[Array, float]:
    """Frequencies (Hz), five to a line of the longest trial, and the width of such a line."""
    width = 1.0 / max(float(np.ptp(item.trial.times)) for item in items)
    fastest = _FASTEST * min(item.trial.rate_hz for item in items)
    return np.arange(_SLOWEST_HZ, fastest, width / 5.0), width


def _power(item: Watched, markers: Sequence[str], frequencies: Array) -> Array:
    """What a wave of each frequency takes off each marker's whitened squares, (n_frequencies, n_markers)."""
    at = [item.markers.index(m) for m in markers]
    left = np.nan_to_num(item.residuals[:, at] / item.floor[at][:, None])
    seen = item.seen[:, at].sum(axis=0).clip(1)
    wave = np.exp(-2j * np.pi * np.outer(frequencies, item.trial.times))
    lines = np.square(np.abs(np.tensordot(wave, left, axes=1)))
    return np.asarray(2.0 * lines.sum(axis=2) / seen)
