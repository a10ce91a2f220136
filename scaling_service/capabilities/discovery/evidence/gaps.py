"""How much of the gap between simulation and measurement closed, between its floor and its ceiling."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.evidence.watched import Role
from scaling_service.capabilities.discovery.search.findings import Gap, Level
from scaling_service.capabilities.discovery.search.tallies import Floors, Tally, marker_tally, wrench_tally
from scaling_service.numerics.multibody.laws import Array

_NORMAL_95 = 1.96
_MARKERS, _FORCES, _MOMENTS = "markers", "force", "moment"


def gap(
    before: Account,
    after: Account,
    role: Role,
    stretch_s: float,
    floors: Floors,
    *,
    ceiling: Mapping[str, float],
    absorbed: float,
) -> Gap:
    """Levels of all observables of the trials of a role.

    Parameters
    ----------
    floors : Floors
    ceiling : mapping
        Observable to the share of its squares that a black-box correction with as many numbers leaves.
    absorbed : float
        Whitened RMS where the calibration's parameters take up what they can instead.
    """
    pairs = {}
    markers = tuple(marker_tally(a, role, stretch_s, floors) for a in (before, after))
    wrenches = tuple(wrench_tally(a, role, stretch_s, floors) for a in (before, after))
    if markers[0] is not None and markers[1] is not None:
        pairs[_MARKERS] = markers[0], markers[1], slice(None)
    if wrenches[0] is not None and wrenches[1] is not None:
        pairs[_FORCES] = wrenches[0], wrenches[1], slice(0, 3)
        pairs[_MOMENTS] = wrenches[0], wrenches[1], slice(3, 6)
    levels, places = {}, {}
    for name, (old, new, part) in pairs.items():
        levels[name] = _level(old, new, part, ceiling.get(name, 1.0))
        for k in range(len(old.places))[part]:
            places[old.places[k]] = _level(old, new, slice(k, k + 1), float("nan"))
    if pairs:
        levels = {"whitened": _whitened(list(pairs.values()), ceiling), **levels}
    return Gap(levels, places, absorbed)


def _level(old: Tally, new: Tally, part: slice, left: float) -> Level:
    """RMS of places together: a distance for markers, per component for wrenches."""
    frames = _count(old, part)
    before, after = old.square[:, part].sum(axis=1), new.square[:, part].sum(axis=1)
    floor = old.floor[:, part].sum()
    low, high = _interval(after, _count(new, part))
    mean = float(before.sum() / frames.sum())
    return Level(
        mean**0.5,
        float((after.sum() / _count(new, part).sum()) ** 0.5),
        float((floor / frames.sum()) ** 0.5),
        (mean * left) ** 0.5,
        low,
        high,
    )


def _count(tally: Tally, part: slice) -> Array:
    return np.asarray(tally.frames[:, part].sum(axis=1))


def _interval(squares: Array, frames: Array) -> tuple[float, float]:
    """95 % interval of an RMS over stretches."""
    mean = squares.sum() / frames.sum()
    stray = squares - mean * frames
    count = len(squares)
    error = float(np.sqrt((stray**2).sum() * count / max(count - 1, 1)) / frames.sum())
    return max(mean - _NORMAL_95 * error, 0.0) ** 0.5, (mean + _NORMAL_95 * error) ** 0.5


def _whitened(pairs: list[tuple[Tally, Tally, slice]], ceiling: Mapping[str, float]) -> Level:
    """All residuals divided by their floors; the floor is one."""
    before, after, weight, blocks = 0.0, 0.0, 0.0, []
    best = 0.0
    for old, new, part in pairs:
        own = old.floor[:, part].sum(axis=0)
        scale = np.divide(old.frames[:, part].sum(axis=0), own, out=np.zeros_like(own), where=own > 0)
        squares = old.square[:, part] @ scale
        name = _MARKERS if part == slice(None) else _FORCES if part.start == 0 else _MOMENTS
        before += float(squares.sum())
        best += float(squares.sum()) * ceiling.get(name, 1.0)
        blocks.append((new.square[:, part] @ scale, _count(new, part)))
        after += float(blocks[-1][0].sum())
        weight += float(_count(old, part).sum())
    squares, frames = (np.concatenate([b[k] for b in blocks]) for k in (0, 1))
    low, high = _interval(squares, frames)
    return Level((before / weight) ** 0.5, (after / weight) ** 0.5, 1.0, (best / weight) ** 0.5, low, high)
