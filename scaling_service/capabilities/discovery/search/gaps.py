"""How far simulation and measurement are apart, before and after, beside what is ordinary for people."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from scaling_service.capabilities.discovery import result as documents
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.observations.tracked import MotionFit, Role
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS, WrenchFit
from scaling_service.capabilities.discovery.search.findings import UNITS, Observable, classify_place
from scaling_service.capabilities.discovery.search.yardstick import Yardstick
from scaling_service.core.arrays import Array
from scaling_service.core.names import say_name

_NORMAL_95 = 1.96
_CORRELATED = (
    0.3  # share of a residual's variance that a coordinate explains, from which it is reported (chosen)
)
_NOT_KNOWN = (math.nan, math.nan)
_FEWEST = 5  # frames of a block that are told as a time

PARTS: Mapping[Observable, tuple[str, slice]] = {
    "marker": ("markers_mm", slice(None)),
    "force": ("force_N", slice(0, 3)),
    "moment": ("moment_Nm", slice(3, 6)),
}
"""Of a gap's fields: what it is of, and its places."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Tally:
    """Squares of residuals (n_blocks, n_places), frames they are sums over, and trials of the blocks."""

    places: tuple[str, ...]
    square: Array
    frames: Array
    trials: tuple[str, ...]
    starts: tuple[float, ...]

    def rms(self, columns: slice | list[int]) -> float:
        """Of some places together."""
        return float(np.sqrt(self.square[:, columns].sum() / max(self.frames[:, columns].sum(), 1.0)))


def _tally(fit: Fit, chosen: Collection[str], *, forces: bool) -> _Tally | None:
    """Of all places over some trials; None where nothing is observed."""
    items: Sequence[MotionFit | WrenchFit] = fit.wrenches if forces else fit.tracked
    names = COMPONENTS if forces else tuple(dict.fromkeys(m for item in fit.tracked for m in item.markers))
    rows, trials, starts = [], [], []
    for item in items:
        if item.name not in chosen:
            continue
        square, seen = np.zeros((len(item.times), len(names))), np.zeros((len(item.times), len(names)))
        if isinstance(item, WrenchFit):
            seen[item.usable] = 1.0
            square[item.usable] = np.square(item.residuals[item.usable])
        else:
            at = [names.index(m) for m in item.markers]
            seen[:, at] = item.seen
            square[:, at] = np.nan_to_num(np.square(item.residuals).sum(axis=2))
        for part in item.blocks(fit.settings.block_s):
            if seen[part].any():
                rows.append((square[part].sum(axis=0), seen[part].sum(axis=0)))
                trials.append(item.name)
                starts.append(float(item.times[part.start]))
    if not rows:
        return None
    square, frames = (np.array(x) for x in zip(*rows, strict=True))
    return _Tally(places=names, square=square, frames=frames, trials=tuple(trials), starts=tuple(starts))


def _list_floors(yardstick: Yardstick, tally: _Tally) -> Array:
    """Squares of what is ordinary, and of what that leaves, (2, n_blocks, n_places); NaN where not known."""
    rows = {
        trial: np.square([yardstick.levels[trial].get(place, _NOT_KNOWN) for place in tally.places]).T
        for trial in dict.fromkeys(tally.trials)
    }
    return np.stack([rows[trial] for trial in tally.trials], axis=1)


def measure_gap(before: Fit, after: Fit, role: Role, yardstick: Yardstick) -> documents.GapDocument:
    """Levels of all observables and places of the trials of a role."""
    levels: dict[str, documents.LevelDocument] = {}
    places, whitened, trials = {}, [], [item.name for item in before.tracked if item.role == role]
    for observable, (name, part) in PARTS.items():
        old, new = (_tally(fit, trials, forces=observable != "marker") for fit in (before, after))
        if old is None or new is None:
            continue
        floor, left = _list_floors(yardstick, old)
        every = old.square, old.frames, new.square, new.frames, floor * old.frames, left * old.frames
        unit, factor = UNITS[observable]
        levels[name] = documents.LevelDocument(**_measure([[x[:, part] for x in every]], factor))
        for k in range(len(old.places))[part]:
            level = _measure([[x[:, k : k + 1] for x in every]], factor)
            places[old.places[k]] = documents.PlaceLevelDocument(**level, unit=unit)
        scale = 1.0 / np.where(floor > 0.0, floor, np.nan)
        counted = np.where(np.isfinite(scale), old.frames, 0.0)
        squares = old.square * scale, counted, new.square * scale, counted, counted, left * counted * scale
        whitened.append([x[:, part] for x in squares])
    return documents.GapDocument(
        whitened=documents.LevelDocument(**_measure(whitened, 1.0)) if whitened else None,
        places=places,
        **{name: levels.get(name) for name, _ in PARTS.values()},
    )


def _measure(parts: Sequence[Sequence[Array]], factor: float) -> dict[str, float]:
    """RMS of places together, times a factor: a distance for markers, per component for wrenches.

    ``parts``: each with squares and frames before and after, and squares of what is ordinary and of what that
    leaves, (n_blocks, n_places).
    """
    sums = np.sum([[np.nansum(x) for x in part] for part in parts], axis=0)
    frames, later = np.maximum(sums[[1, 3]], 1.0)
    before, after, floor, ceiling = np.sqrt(sums[[0, 2, 4, 5]] / [frames, later, frames, frames]).tolist()
    low, high = _estimate_interval(
        *(np.concatenate([np.nansum(part[k], axis=1) for part in parts]) for k in (2, 3))
    )
    found = {"before": before, "after": after, "floor": floor, "ceiling": ceiling, "low": low, "high": high}
    return {name: factor * value for name, value in found.items()}


def _estimate_interval(squares: Array, frames: Array) -> tuple[float, float]:
    """95 % interval of an RMS over blocks."""
    total = max(float(frames.sum()), 1.0)
    mean = float(squares.sum()) / total
    stray, count = squares - mean * frames, len(squares)
    error = float(np.sqrt((stray**2).sum() * count / max(count - 1, 1)) / total)
    return max(mean - _NORMAL_95 * error, 0.0) ** 0.5, (mean + _NORMAL_95 * error) ** 0.5


def rms_by_place(fit: Fit, trials: Collection[str], *, forces: bool) -> dict[str, float]:
    """Of every marker, or component of the wrench, over some trials; SI."""
    tally = _tally(fit, trials, forces=forces)
    if tally is None:
        return {}
    square, frames = tally.square.sum(axis=0), tally.frames.sum(axis=0)
    known = frames > 0.0
    rms = np.sqrt(square[known] / frames[known])
    return dict(zip(np.array(tally.places)[known].tolist(), rms.tolist(), strict=True))


def list_shown(where: Sequence[str], fit: Fit) -> list[str]:
    """The markers at a place: of an effect of markers these, of a joint or segment those that it carries."""
    of = [s.name for s in fit.model.segments if s.name in where or s.joint_name in where]
    markers = [m.name for m in fit.model.markers if m.name in where or m.segment in of]
    return markers or [m.name for m in fit.model.markers]


def list_disagreements(fit: Fit, yardstick: Yardstick) -> tuple[documents.DisagreementDocument, ...]:
    """All places, the largest share of what stands above the ordinary first."""
    every = [item.name for item in fit.tracked]
    tallies = [t for forces in (False, True) if (t := _tally(fit, every, forces=forces)) is not None]
    found, floors = [], {}
    for tally in tallies:
        squares = _list_floors(yardstick, tally)[0] * tally.frames
        for k, place in enumerate(tally.places):
            if tally.frames[:, k].any():
                floors[place] = float(np.sqrt(np.nansum(squares[:, k]) / tally.frames[:, k].sum()))
                found.append((place, tally, k))
    unit = {place: UNITS[classify_place(place)][1] for place in floors}
    ratio = {p: unit[p] * tally.rms([k]) / max(unit[p] * floors[p], 1e-9) for p, tally, k in found}
    above = {place: max(times**2 - 1.0, 0.0) for place, times in ratio.items()}
    total = max(sum(above.values()), 1e-12)
    found.sort(key=lambda one: (-above[one[0]], -ratio[one[0]]))
    return tuple(
        _describe_place(tally, k, floors[p], above[p] / total, yardstick.freedom.get(p, 0.0), fit)
        for p, tally, k in found
    )


def _describe_place(
    tally: _Tally, k: int, floor: float, share: float, freedom: float, fit: Fit
) -> documents.DisagreementDocument:
    place, rms = tally.places[k], tally.rms([k])
    observable = classify_place(place)
    unit, factor = UNITS[observable]
    frames, per_trial = tally.frames[:, k], {}
    for trial in dict.fromkeys(tally.trials):
        rows = [n for n, t in enumerate(tally.trials) if t == trial]
        if frames[rows].any():
            per_trial[trial] = factor * float(np.sqrt(tally.square[rows, k].sum() / frames[rows].sum()))
    mean = np.where(frames >= _FEWEST, tally.square[:, k] / np.maximum(frames, 1.0), 0.0)
    most = int(np.argmax(mean))
    return documents.DisagreementDocument(
        where=place,
        observable=observable,
        unit=unit,
        rms=factor * rms,
        floor=factor * floor,
        share=share,
        p=float(scipy.stats.chi2.sf(freedom * (rms / max(floor, 1e-12)) ** 2, freedom)),
        trials=per_trial,
        when=f"{tally.trials[most]}, from {tally.starts[most]:.1f} s on",
        along=describe_course(fit, place),
    )


def describe_course(fit: Fit, place: str) -> str:
    """The coordinate that a place's residual follows best, and how; empty where it follows none."""
    best, said = _CORRELATED, ""
    names = fit.model.coordinate_names
    for axis in range(1 if place in COMPONENTS else 3):
        values, coordinates = _list_series(fit, place, axis)
        if len(values) < _FEWEST:
            continue
        values = values - values.mean()
        centred = coordinates - coordinates.mean(axis=0)
        spread = np.square(centred).sum(axis=0)
        slope = np.divide(centred.T @ values, spread, out=np.zeros(len(spread)), where=spread > 0.0)
        share = slope**2 * spread / max(float(values @ values), 1e-300)
        k = int(np.argmax(share))
        if share[k] > best:
            best = float(share[k])
            where = "" if place in COMPONENTS else f" (seen along {'xyz'[axis]} of the room)"
            said = f"{say_name(names[k])}{where}: {best:.0%} of its variance"
    return said


def _list_series(fit: Fit, place: str, axis: int) -> tuple[Array, Array]:
    """Residuals of a place (n,) and coordinates (n, any) over all recordings."""
    values, coordinates = [], []
    count = len(fit.model.coordinates)
    for item in fit.tracked:
        wrench = next((w for w in fit.wrenches if w.name == item.name), None)
        if place in COMPONENTS and wrench is not None:
            known = wrench.usable
            values.append(wrench.residuals[known, COMPONENTS.index(place)])
        elif place in item.markers:
            at = item.markers.index(place)
            known = item.seen[:, at]
            values.append(item.residuals[known, at, axis])
        else:
            continue
        coordinates.append(item.q[known, :count])
    if not values:
        return np.zeros(0), np.zeros((0, count))
    return np.concatenate(values), np.concatenate(coordinates)
