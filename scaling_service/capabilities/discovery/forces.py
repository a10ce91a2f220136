"""The ground's forces of those recordings that have some, for the search; why the others have none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.observations.wrench import ContactAssignment, band_hz
from scaling_service.capabilities.dynamics.forces import (
    TrialForces,
    feet_of,
    foot_markers,
    read_trial_forces,
    trial_forces,
)
from scaling_service.capabilities.subject.loading import Loaded
from scaling_service.core.errors import ModelRefused
from scaling_service.core.text import few
from scaling_service.model.body import BodyModel
from scaling_service.model.forces import GroundForces
from scaling_service.model.inertia import total_mass
from scaling_service.model.subject import Subject
from scaling_service.numerics.signals.filters import runs
from scaling_service.recording.plates_feet import BRIEF_S, NOBODY, FootContacts

NOT_TRIED = "effects of forces, masses and gravity were not tried"

_TOLD = ("two_feet", "no_foot", "force_sign", "not_recorded")
"""Repairs of forces that bear on what the search may say."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Footings:
    """Forces of the recordings that have them.

    Parameters
    ----------
    by_trial : mapping
        Stem of the recording to its forces.
    sources : mapping
        The same to what was read, with the repairs.
    notes : tuple of str
        What could not be used, and what follows from it.
    """

    by_trial: Mapping[str, ContactAssignment] = field(default_factory=dict)
    sources: Mapping[str, TrialForces] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def footings(loaded: Loaded, subject: Subject, model: BodyModel, cutoff_hz: float) -> Footings:
    """Read the forces of all movements.

    Parameters
    ----------
    loaded : Loaded
    subject : Subject
    model : BodyModel
        The person's, with mass.
    cutoff_hz : float
        Below which motion and forces are compared.

    Raises
    ------
    InputError
        Forces are there and cannot be used.
    """
    paths = {path.stem: path for path in (*subject.calibration, *subject.evaluation)}
    found = {
        name: read_trial_forces(path, loaded.plates.get(path), subject.forces.get(path.name))
        for name, path in paths.items()
    }
    read = {name: forces for name, forces in found.items() if forces is not None}
    if not read:
        return Footings(notes=(f"no recording has forces: {NOT_TRIED}",))
    lacking = _lacking(model)
    if lacking:
        return Footings(notes=(f"{lacking}: {NOT_TRIED}",))
    sources = {name: _turned(loaded, subject, name, *forces) for name, forces in read.items()}
    made = {
        name: ContactAssignment(forces.ground, usable_frames(forces.ground, forces.contacts), cutoff_hz)
        for name, forces in sources.items()
    }
    without = [name for name in paths if name not in read]
    notes = [f"{few(without)}: no forces, so only markers were compared"] if without else []
    return Footings(made, sources, (*notes, *_of_repairs(sources)))


def _lacking(model: BodyModel) -> str:
    """What a model lacks to answer forces; empty where it has all."""
    try:
        feet_of(model)
    except ModelRefused:
        return f"model '{model.name}' ends above its feet, so the ground's forces act on nothing"
    return "" if total_mass(model) > 0.0 else f"model '{model.name}' has no mass"


def _turned(loaded: Loaded, subject: Subject, name: str, source: Path, forces: GroundForces) -> TrialForces:
    session, axes = loaded.session, loaded.orientation
    assert axes is not None  # a session that was read has axes
    trial = next(trial for trial in session.dynamic if trial.name == name)
    feet = foot_markers(session.model, trial, subject.extra_markers)
    return trial_forces(source, forces, trial, feet, axes, cutoff_hz=band_hz(trial.rate_hz))


def usable_frames(ground: GroundForces, contacts: FootContacts) -> Mask:
    """Frames in which the plates should show all that the ground does, shape (n,).

    A foot that steps beside the plates is no finding. A foot that never meets a plate while the other one
    always does has lost its plate, and that is one: such frames stay.
    """
    loaded = ground.in_contact()
    stray = (loaded & (contacts.foot == NOBODY)).any(axis=1)
    bears = np.stack([(contacts.foot == k).any(axis=1) for k in range(len(contacts.feet))], axis=1)
    beside = _lasting(contacts.on_floor & ~bears, ground.times)
    for k in range(len(contacts.feet)):
        others = np.delete(beside, k, axis=1)
        if not bears[:, k].any() and not others.any():
            beside[:, k] = False
    return np.asarray(ground.known.all(axis=1) & ~stray & ~beside.any(axis=1))


def _lasting(beside: Mask, times: NDArray[np.float64]) -> Mask:
    """Without the frames in which a foot comes down and rolls off."""
    step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    found = np.zeros_like(beside)
    for k in range(beside.shape[1]):
        for start, stop in runs(beside[:, k]).tolist():
            found[start:stop, k] = (stop - start) * step > 2 * BRIEF_S
    return found


def _of_repairs(sources: Mapping[str, TrialForces]) -> tuple[str, ...]:
    return tuple(
        f"{name}: {repair.where} {repair.detail}"
        for name, forces in sources.items()
        for repair in forces.repairs
        if repair.what in _TOLD
    )
