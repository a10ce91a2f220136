"""Effects of known size put into a model, or taken out of a recording."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from scaling_service.capabilities.discovery.evidence.spots import (
    JointSpot,
    MarkerSpot,
    SizeSpot,
    VolumeSpot,
    put,
    put_joint,
)
from scaling_service.capabilities.discovery.laws.profiles import Constant, Following, term
from scaling_service.capabilities.discovery.search.candidates import (
    Candidate,
    Column,
    Exchange,
    FreeMotion,
    Masked,
)
from scaling_service.model.body import BodyModel, Coordinate, Joint, Law
from scaling_service.model.parameters import fold, free_scale
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.laws import Array


@dataclass(frozen=True, slots=True, eq=False)
class Sized:
    """A candidate with a value for each of its columns (SI)."""

    candidate: Candidate
    size: Array

    @property
    def columns(self) -> tuple[tuple[Column, float], ...]:
        """Columns with their values."""
        return tuple(zip(self.candidate.columns, self.size.tolist(), strict=True))


def with_effects(model: BodyModel, effects: Iterable[Sized], trial: str) -> BodyModel:
    """The model as it is in one trial: effects that hold there put into it.

    Later columns go nearer to the trunk, so that a turn about y goes before one about x
    (``free_axis``).
    """
    for effect in effects:
        if effect.candidate.holds_in(trial):
            for column, size in reversed(effect.columns):
                model = _with_column(model, column, size)
            if isinstance(effect.candidate.change, FreeMotion):
                model = _with_freedom(model, effect.candidate.change, freedom_name(effect.candidate))
    return model


def freedom_name(candidate: Candidate) -> str:
    """The name of the coordinate that a missing degree of freedom becomes."""
    return f"{candidate.where[0]}_{candidate.note.replace(' ', '_')}"


def _with_column(model: BodyModel, column: Column, size: float) -> BodyModel:
    for part in column.parts:
        if isinstance(part.spot, SizeSpot):
            name = part.spot.segment
            model = fold(free_scale(model, name, 0.9), {f"scale.{name}": 1.0 + part.gain * size})
        elif isinstance(part.spot, JointSpot | MarkerSpot) and isinstance(part.profile, Constant | Following):
            model = put(model, part.spot, Law((term(part.profile, part.gain * size),)))
    return model


def _with_freedom(model: BodyModel, free: FreeMotion, name: str) -> BodyModel:
    """A coordinate of its own for a motion that the model locked."""
    joint = Joint(free.kind, free.axis, Law.of(name))
    model = put_joint(model, free.segment, free.at, joint)
    return replace(model, coordinates=(*model.coordinates, Coordinate(name, free.kind)))


def corrected(trial: Trial, effects: Sequence[Sized]) -> Trial:
    """The recording freed of the faults that are its own: its scale, exchanged labels."""
    markers = trial.markers
    for effect in effects:
        if effect.candidate.holds_in(trial.name):
            for column, size in effect.columns:
                if any(isinstance(part.spot, VolumeSpot) for part in column.parts):
                    markers = markers / (1.0 + size)
            if isinstance(effect.candidate.change, Masked):
                markers = markers.copy()
                markers[:, trial.index(effect.candidate.change.marker)] = np.nan
            if isinstance(effect.candidate.change, Exchange):
                markers = _exchanged(trial, markers, effect.candidate.change)
    return trial if markers is trial.markers else replace(trial, markers=markers)


def _exchanged(trial: Trial, markers: Array, exchange: Exchange) -> Array:
    pair = [trial.index(exchange.first), trial.index(exchange.second)]
    inside = np.flatnonzero((trial.times >= exchange.start_s) & (trial.times <= exchange.end_s))
    markers = markers.copy()
    markers[inside[:, None], pair] = markers[inside[:, None], pair[::-1]]
    return markers
