"""Estimated effects put into a model, or taken out of a recording."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import scipy

from scaling_service.capabilities.discovery.laws import candidates, loads, spots
from scaling_service.capabilities.discovery.laws.profiles import make_law
from scaling_service.capabilities.discovery.observations.wrench import find_middle_of_pressure
from scaling_service.core.arrays import Array
from scaling_service.model import body
from scaling_service.model.forces import GroundForces
from scaling_service.model.inertia import gather_inertias, with_inertias
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.motion import TENSOR, Inertias
from scaling_service.numerics.wrench import GRAVITY

_LOADED_COLUMNS = 4
"""Of a carried load: its mass and its first moments."""


def with_effects(model: body.BodyModel, effects: Iterable[candidates.Estimate], trial: str) -> body.BodyModel:
    """The model as it is in one trial: effects that hold there put into it.

    Later columns go nearer to the trunk, so that a turn about y goes before one about x
    (``free_axis``).
    """
    for effect in effects:
        if effect.candidate.holds_in(trial):
            for column, size in reversed(effect.columns):
                model = _with_column(model, column, size)
            if isinstance(effect.candidate.change, candidates.FreeMotion):
                model = _with_freedom(model, effect.candidate.change, name_freedom(effect.candidate))
    return model


def name_freedom(candidate: candidates.Candidate) -> str:
    """The name of the coordinate that a missing degree of freedom becomes."""
    return f"{candidate.where[0]}_{candidate.note.replace(' ', '_')}"


def _with_column(model: body.BodyModel, column: candidates.Column, size: float) -> body.BodyModel:
    for part in column.parts:
        if isinstance(part.spot, spots.SizeSpot):
            model = part.spot.resize(model, part.gain * size)
        elif isinstance(part.spot, spots.JointSpot | spots.MarkerSpot):
            model = part.spot.put(model, make_law(part.profile, part.gain * size))
    return model


def _with_freedom(model: body.BodyModel, free: candidates.FreeMotion, name: str) -> body.BodyModel:
    """A coordinate of its own for a motion that the model locked."""
    joint = body.Joint(free.kind, free.axis, body.Law.of(name))
    model = spots.put_joint(model, free.segment, free.at, joint)
    return replace(model, coordinates=(*model.coordinates, body.Coordinate(name=name, kind=free.kind)))


def changes_markers(candidate: candidates.Candidate) -> bool:
    """Whether an effect is a fault of the recorded markers."""
    scaled = any(isinstance(part.spot, spots.VolumeSpot) for part in candidate.parts)
    return scaled or isinstance(candidate.change, candidates.Exchange)


def changes_forces(candidate: candidates.Candidate) -> bool:
    """Whether an effect is a fault of the recorded forces."""
    return any(isinstance(column.load, loads.Late | loads.PlateFault) for column in candidate.columns)


def correct_trial(trial: Trial, effects: Sequence[candidates.Estimate]) -> Trial:
    """The recording freed of the faults that are its own: its scale, exchanged labels."""
    markers = trial.markers
    for effect in effects:
        change = effect.candidate.change
        if effect.candidate.holds_in(trial.name):
            for column, size in effect.columns:
                if any(isinstance(part.spot, spots.VolumeSpot) for part in column.parts):
                    markers = markers / (1.0 + size)
            if isinstance(change, candidates.Exchange):
                pair = [trial.index(change.first), trial.index(change.second)]
                inside = np.flatnonzero((trial.times >= change.start_s) & (trial.times <= change.end_s))
                markers = markers.copy()
                markers[inside[:, None], pair] = markers[inside[:, None], pair[::-1]]
    return trial if markers is trial.markers else replace(trial, markers=markers)


def with_inertial_changes(
    model: body.BodyModel, effects: Iterable[candidates.Estimate], trial: str = ""
) -> body.BodyModel:
    """The model with masses, centres and tensors changed."""
    declared = gather_inertias(model).parameters()
    numbers = declared.copy()
    changed = False
    for effect in effects:
        whole = effect.candidate.change
        if isinstance(whole, candidates.Reweighed):
            numbers += (whole.factor_in(trial) - 1.0) * declared
            changed = True
        # By segment; a carried load at a point has the tensor that its mass and first moments make.
        found = [
            (load.segment, size * np.array(load.change))
            for load, size in candidates.list_loads([effect], loads.Inertial)
        ]
        if effect.candidate.kind == "carried_load" and len(found) == _LOADED_COLUMNS and effect.size[0] > 0.0:
            mass, moment = float(effect.size[0]), effect.size[1:]
            tensor = ((moment @ moment) * np.eye(3) - np.outer(moment, moment)) / mass
            six = [tensor[i, j] for i, j in TENSOR]
            found = [(found[0][0], np.concatenate([effect.size, six]))]
        for segment, change in found:
            numbers[model.segment_names.index(segment)] += change
            changed = True
    return with_inertias(model, Inertias.of_parameters(numbers)) if changed else model


def tilt_gravity(effects: Iterable[candidates.Estimate]) -> Array:
    """The acceleration of gravity once the vertical leans, (3,), m/s2."""
    turn = np.zeros(3)
    for load, size in candidates.list_loads(effects, loads.Tilt):
        turn[load.axis] += size
    return GRAVITY + np.cross(turn, GRAVITY)


def correct_forces(
    ground: GroundForces, times: Array, effects: Iterable[candidates.Estimate]
) -> GroundForces:
    """The forces freed of the plates' own faults."""
    force, moment = ground.force.copy(), ground.moment.copy()
    late = 0.0
    for effect in effects:
        for column, size in effect.columns:
            load = column.load
            if isinstance(load, loads.Late):
                late += size
            elif isinstance(load, loads.PlateFault) and load.plate in ground.plates:
                k = ground.plates.index(load.plate)
                plate = loads.Plate(
                    force[:, k], moment[:, k], find_middle_of_pressure(ground, k), ground.readings[:, k]
                )
                force[:, k], moment[:, k] = load.correct(plate, size)
    if late:
        force, moment = (_shift_earlier(values, times, late) for values in (force, moment))
    return ground.change(force=force, moment=moment)


def _shift_earlier(values: Array, times: Array, late: float) -> Array:
    """Values (n, k, 3) as they were ``late`` seconds later, held at the end of what is known."""
    known = np.isfinite(values).all(axis=(1, 2))
    if known.sum() < 4:
        return values
    spline = scipy.interpolate.CubicSpline(times[known], values[known])
    moved: Array = spline(np.clip(times + late, times[known][0], times[known][-1]))
    moved[~known] = np.nan
    return moved
