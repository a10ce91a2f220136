"""Sums over stretches of the ground wrench, and effects put into forces, masses and gravity."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from scaling_service.capabilities.discovery.evidence.score import Evidence, Layout, Stretch, stretches_of
from scaling_service.capabilities.discovery.evidence.watched import Watched
from scaling_service.capabilities.discovery.evidence.weighed import Footing, Weighed
from scaling_service.capabilities.discovery.laws.additions import Sized
from scaling_service.capabilities.discovery.laws.at_once import each
from scaling_service.capabilities.discovery.laws.loads import (
    Inertial,
    Late,
    Load,
    PlateBias,
    PlateGain,
    PlateShift,
    PlateTurn,
    Tilt,
    Wobbling,
    columns_of,
)
from scaling_service.capabilities.discovery.search.candidates import Candidate
from scaling_service.model.body import BodyModel
from scaling_service.model.forces import GroundForces
from scaling_service.model.inertia import inertias_of, with_inertias
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.mechanism import Inertias
from scaling_service.numerics.multibody.rigid import rotation_about
from scaling_service.numerics.wrench.ground_wrench import GRAVITY

_FEWEST = 5  # frames of a stretch; chosen: fewer say nothing of a stretch of half a second
_UNIT = np.eye(3)
_RATE = 4.0  # frames looked at per period of the filter; chosen: products of what passes it need two
_DRAWS = 4  # of noise; chosen: its products' own spread grows by an eighth
_CARRIED = 4
"""Columns of a carried load: its mass and its first moments."""


def gather_forces(
    weighed: Sequence[Weighed],
    nuisances: Sequence[Candidate],
    candidates: Sequence[Candidate],
    stretch_s: float,
    *,
    together: bool,
) -> Evidence:
    """As ``gather``, of the wrench and not of the markers.

    Columns are made of the motion that leaves the gap, so noise of the markers is in both, and its products
    do not vanish on average: a mass on a spring would seem to swing where nothing but cameras' noise is.
    What they come to is told by noise drawn once more and taken off (the corrected score of errors in
    variables: Nakamura 1990, Biometrika 77:127).
    """
    every = [*nuisances, *candidates]
    columns = [column for candidate in every for column in candidate.columns]
    count = sum(len(candidate.columns) for candidate in nuisances)
    edges = np.cumsum([count, *(len(candidate.columns) for candidate in candidates)])
    layout = Layout(len(columns), (), count, None if together else edges)
    loads = [column.load for column in columns]

    def whitened(item: Weighed, shaken: Weighed | None = None) -> _White:
        here = [c.holds_in(item.name) for c in every for _ in c.columns]
        active = [load if on else None for load, on in zip(loads, here, strict=True)]
        return _whitened(shaken or item, active, item.floor, _thin(item))

    def by_chance(drawn: tuple[Weighed, _White, Weighed]) -> list[Stretch]:
        item, own, shaken = drawn
        other = whitened(item, shaken)
        strays = _White(other.columns - own.columns, other.gap - own.gap)
        return list(_stretches(item, strays, layout, stretch_s))

    made = each(whitened, weighed)
    shaken = each(lambda item: list(item.shaken(_DRAWS)), weighed)
    draws = [(item, own, s) for item, own, some in zip(weighed, made, shaken, strict=True) for s in some]
    chances = iter(each(by_chance, draws))
    stretches: list[Stretch] = []
    raw = np.zeros(len(columns))
    for item, own in zip(weighed, made, strict=True):
        plain = list(_stretches(item, own, layout, stretch_s))
        drawn = [next(chances) for _ in range(_DRAWS)]
        stretches += [_less(found, chance) for found, *chance in zip(plain, *drawn, strict=True)]
        for used in _parts(item, stretch_s):
            raw += _thin(item) * np.square(own.columns[used]).sum(axis=(0, 1))
    spans = tuple(slice(a, b) for a, b in pairwise(edges.tolist()))
    return Evidence(tuple(stretches), raw, count, spans)


class _White(NamedTuple):
    """Columns (n, 6, n_columns) and gap (n, 6), in floors, in the frames that are looked at."""

    columns: Array
    gap: Array


def _thin(item: Weighed) -> int:
    """Every how many frames to look at."""
    return max(1, int(item.item.trial.rate_hz / (_RATE * item.cutoff_hz)))


def _parts(item: Weighed, stretch_s: float) -> Iterator[NDArray[np.intp]]:
    """Of each stretch the frames that count, as numbers among those looked at."""
    thin = _thin(item)
    for rows in stretches_of(item.item, stretch_s):
        used = np.flatnonzero(item.usable[rows]) + rows.start
        if len(used) >= _FEWEST:
            yield used[used % thin == 0] // thin


def _whitened(item: Weighed, loads: Sequence[Load | None], floor: Array, thin: int) -> _White:
    """Columns, zero where there is no load, and gap about the trunk's origin, where ``thin`` divides."""
    known = {load: k for k, load in enumerate(dict.fromkeys(load for load in loads if load is not None))}
    raw = np.zeros((len(item.times), 6, len(known) + 1))
    raw[:, :, :-1] = columns_of(list(known), item)
    made = item.smoothed(raw)[::thin]
    made[:, 3:] -= np.cross(item.about[::thin, None], made[:, :3].transpose(0, 2, 1)).transpose(0, 2, 1)
    made /= floor[:, None]
    columns = made[:, :, [-1 if load is None else known[load] for load in loads]]
    return _White(columns, item.gap[::thin] / floor)


def _less(found: Stretch, chance: Sequence[Stretch]) -> Stretch:
    """Sums without what noise alone makes, on average, of what it is in on both sides."""
    return replace(
        found,
        scores=found.scores - np.mean([c.scores for c in chance], axis=0),
        cross=found.cross - np.mean([c.cross for c in chance], axis=0),
        own=found.own - np.mean([c.own for c in chance], axis=0),
    )


def _stretches(item: Weighed, white: _White, layout: Layout, stretch_s: float) -> Iterator[Stretch]:
    """Sums of frames that stand for several ones each."""
    thin = _thin(item)
    for used in _parts(item, stretch_s):
        made, gap = white.columns[used], white.gap[used]
        flat = np.ascontiguousarray(made.reshape(-1, layout.count).T)
        yield Stretch(
            item.name,
            item.role,
            thin * (flat @ gap.ravel()),
            thin * (flat[: layout.nuisances] @ flat.T),
            thin * layout.own(flat),
            thin * float(np.square(gap).sum()),
            float(thin * gap.size),
        )


def weigh(item: Watched, model: BodyModel, footing: Footing, effects: Sequence[Sized]) -> Weighed:
    """Bring a followed trial and its forces together, effects of known size taken into account."""
    here = [s for s in effects if s.candidate.holds_in(item.name)]
    ground = corrected_forces(footing.ground, item.trial.times, here)
    swinging = tuple(
        (column.load, size) for s in here for column, size in s.columns if isinstance(column.load, Wobbling)
    )
    return Weighed(
        item,
        weighty(model, here),
        replace(footing, ground=ground),
        gravity_of(here),
        footing.cutoff_hz,
        swinging,
    )


def weighty(model: BodyModel, effects: Iterable[Sized]) -> BodyModel:
    """The model with masses, centres and tensors changed."""
    numbers = inertias_of(model).parameters()
    changed = False
    for effect in effects:
        for segment, change in _changes(effect):
            numbers[model.segment_names.index(segment)] += change
            changed = True
    return with_inertias(model, Inertias.of_parameters(numbers)) if changed else model


def _changes(effect: Sized) -> list[tuple[str, Array]]:
    found = [
        (column.load.segment, size * np.array(column.load.change))
        for column, size in effect.columns
        if isinstance(column.load, Inertial)
    ]
    if effect.candidate.kind == "carried_load" and len(found) == _CARRIED and effect.size[0] > 0.0:
        mass, moment = float(effect.size[0]), effect.size[1:]
        tensor = ((moment @ moment) * np.eye(3) - np.outer(moment, moment)) / mass
        six = [tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2]]
        found.append((found[0][0], np.concatenate([np.zeros(4), six])))
    return found


def gravity_of(effects: Iterable[Sized]) -> Array:
    """The acceleration of gravity once the vertical leans, (3,), m/s2."""
    turn = np.zeros(3)
    for effect in effects:
        for column, size in effect.columns:
            if isinstance(column.load, Tilt):
                turn[column.load.axis] += size
    return GRAVITY + np.cross(turn, GRAVITY)


def corrected_forces(ground: GroundForces, times: Array, effects: Iterable[Sized]) -> GroundForces:
    """The forces freed of the plates' own faults."""
    force, moment = ground.force.copy(), ground.moment.copy()
    late = 0.0
    for effect in effects:
        for column, size in effect.columns:
            load = column.load
            if isinstance(load, Late):
                late += size
            elif (
                isinstance(load, PlateShift | PlateBias | PlateGain | PlateTurn)
                and load.plate in ground.plates
            ):
                k = ground.plates.index(load.plate)
                own = _Plate(force[:, k], moment[:, k], _middle(ground, k), ground.readings[:, k])
                force[:, k], moment[:, k] = _mended(load, size, own)
    if late:
        force, moment = (_earlier(values, times, late) for values in (force, moment))
    return ground.changed(force=force, moment=moment)


def _middle(ground: GroundForces, k: int) -> Array:
    centres = ground.centre_of_pressure()[:, k]
    known = np.isfinite(centres).all(axis=1)
    return np.asarray(centres[known].mean(axis=0) if known.any() else ground.surfaces[k])


class _Plate(NamedTuple):
    """One plate: force and moment about the ground origin (n, 3), its middle (3,), its readings (n,)."""

    force: Array
    moment: Array
    middle: Array
    read: Array


def _mended(load: Load, size: float, plate: _Plate) -> tuple[Array, Array]:
    """One plate's force and moment about the ground origin, freed of one fault."""
    force, moment, middle, read = plate
    if isinstance(load, PlateShift):
        return force, moment + np.cross(size * _UNIT[load.axis], force)
    if isinstance(load, PlateGain):
        return force / (1.0 + size), moment / (1.0 + size)
    if isinstance(load, PlateBias):
        if load.component >= _UNIT.shape[0]:
            return force, moment - np.outer(size * read, _UNIT[load.component - 3])
        added = np.outer(size * read, _UNIT[load.component])
        return force - added, moment - np.cross(middle, added)
    assert isinstance(load, PlateTurn)
    turn = rotation_about(_UNIT[load.axis], size)
    about = moment - np.cross(middle, force)
    turned = force @ turn.T
    return turned, about @ turn.T + np.cross(middle, turned)


def _earlier(values: Array, times: Array, late: float) -> Array:
    """Values (n, k, 3) as they were ``late`` seconds later, held at the end of what is known."""
    known = np.isfinite(values).all(axis=(1, 2))
    if known.sum() < 4:
        return values
    spline = CubicSpline(times[known], values[known])
    moved: Array = spline(np.clip(times + late, times[known][0], times[known][-1]))
    moved[~known] = np.nan
    return moved
