"""Recordings freed of the faults that are their own: labels back in place, scale, clocks, plates."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws.apply import correct_forces, correct_trial
from scaling_service.capabilities.discovery.laws.candidates import Contact, Estimate, Exchange
from scaling_service.capabilities.discovery.laws.loads import Late, PlateFault
from scaling_service.capabilities.discovery.laws.spots import VolumeSpot
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS
from scaling_service.capabilities.discovery.start import Prepared
from scaling_service.capabilities.kinetics.forces import read_trial_forces, turn_forces
from scaling_service.files.sto import Table, write_sto
from scaling_service.files.trc import write_trc
from scaling_service.model.forces import GroundForces

FOLDER = "corrected"

_NOTE = (
    f"{FOLDER}/ holds all recordings without the faults found in them: mm, N, X forward, Y up, Z right, "
    "under the model's marker names"
)


def write_corrected(folder: Path, fit: Fit, prepared: Prepared) -> tuple[str, ...]:
    """Write all recordings, corrected, into ``corrected/`` where any of them was at fault; tells of it.

    One set in one system of axes, so that it can be used in place of the given one.
    """
    effects = fit.effects
    if not any(_of_markers(effect) or _of_forces(effect) for effect in effects):
        return ()
    place = folder / FOLDER
    place.mkdir()
    session = prepared.loaded.session
    static = () if session.static is None else (session.static,)
    for trial in (*static, *session.dynamic):
        write_trc(place / f"{trial.name}.trc", correct_trial(trial, effects))
    for path in (*prepared.subject.calibration, *prepared.subject.evaluation):
        if path.stem in prepared.forces:
            ground = _as_recorded(path, prepared)
            here = [e for e in effects if e.candidate.holds_in(path.stem)]
            corrected = correct_forces(ground, ground.times, here)
            write_sto(place / f"{path.stem}_forces.mot", tabulate_forces(path.stem, corrected))
    return (_NOTE,)


def _of_markers(effect: Estimate) -> bool:
    scaled = any(isinstance(p.spot, VolumeSpot) for c in effect.candidate.columns for p in c.parts)
    return scaled or isinstance(effect.candidate.change, Exchange)


def _of_forces(effect: Estimate) -> bool:
    return any(isinstance(column.load, Late | PlateFault) for column in effect.candidate.columns)


def _as_recorded(path: Path, prepared: Prepared) -> GroundForces:
    """The forces in the session's axes, at their own rate, not filtered."""
    plates = prepared.loaded.plates.get(path)
    read = read_trial_forces(path, plates, prepared.subject.forces.get(path.name))
    axes = prepared.loaded.orientation
    assert read is not None  # it was read before
    assert axes is not None
    return turn_forces(*read, axes)


def tabulate_forces(name: str, ground: GroundForces) -> Table:
    """Forces as OpenSim names them: for each plate force, point and free moment, (n, 9).

    Where a plate is not loaded the point is one of its surface.
    """
    pressed = ground.centre_of_pressure()
    point = np.where(np.isfinite(pressed), pressed, ground.surfaces)
    free = ground.moment - np.cross(point, ground.force)
    names = ["time"]
    for k in range(1, len(ground.plates) + 1):
        names += [f"ground_force_{k}_v{a}" for a in "xyz"] + [f"ground_force_{k}_p{a}" for a in "xyz"]
        names += [f"ground_torque_{k}_{a}" for a in "xyz"]
    columns = np.concatenate([ground.force, point, free], axis=2).reshape(len(ground.times), -1)
    return Table(
        name=name, columns=tuple(names), data=np.column_stack([ground.times, columns]), in_degrees=False
    )


def write_contacts(folder: Path, fit: Fit) -> tuple[str, ...]:
    """Write what a contact that no plate measured must have been, ``TRIAL_contact.sto``.

    Force on the body (N) and its moment about the origin of the ground (N m), zero outside the contact.
    Frames in which it cannot be known, such as the first and last tenths of a second, are left out.
    """
    written = []
    contacts = [e.candidate for e in fit.effects if isinstance(e.candidate.change, Contact)]
    for item in fit.wrenches:
        if item.touched is not None and any(contact.holds_in(item.name) for contact in contacts):
            table = Table(
                name=f"{item.name}_contact",
                columns=("time", *(f"contact_{component}" for component in COMPONENTS)),
                data=np.column_stack([item.times, item.touched])[item.usable],
                in_degrees=False,
            )
            write_sto(folder / f"{item.name}_contact.sto", table)
            written.append(f"{item.name}_contact.sto holds the force that was inferred")
    return tuple(written)
