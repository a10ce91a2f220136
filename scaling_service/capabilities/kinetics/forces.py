"""The ground's forces on each foot of one recording, on the markers' clock and in the session's axes."""

from __future__ import annotations

import re
from collections import abc
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scaling_service.capabilities.subject.preparing import Loaded
from scaling_service.core import errors
from scaling_service.core.arrays import Array
from scaling_service.core.names import say_name
from scaling_service.files.forces import read_forces
from scaling_service.model import forces as model_forces
from scaling_service.model.body import BodyModel
from scaling_service.model.subject import Subject
from scaling_service.model.trial import Repair, Trial
from scaling_service.recording import plates as recording_plates
from scaling_service.recording import plates_feet
from scaling_service.recording.faults import repair_forces
from scaling_service.recording.orientation import Orientation

LARGEST_FREE_MOMENT = 100.0
"""N m, median over loaded samples (chosen: a standing foot twists the floor by up to some 20 N m; the same
number in N mm is a thousand times larger)."""

_FOOT = re.compile("calcn|foot", re.IGNORECASE)
_COMPANY = ("toes", "talus", "hallux")
"""Segments of OpenSim's models that belong to the foot of the same side."""

FEWEST = 2
"""Markers that show where a foot is and how it points."""


@dataclass(frozen=True, slots=True, eq=False)
class TrialForces:
    """What the ground does to the feet in one recording."""

    source: Path  # the file that the forces came from
    ground: model_forces.GroundForces  # at the markers' times, filtered
    contacts: plates_feet.FootContacts
    loads: model_forces.SegmentLoads

    @property
    def repairs(self) -> tuple[Repair, ...]:
        """Everything that was decided on the way."""
        return (*self.ground.repairs, *self.contacts.repairs)


def read_trial_forces(
    recording: Path, plates: model_forces.PlateRecording | errors.TrialUnusable | None, named: Path | None
) -> tuple[Path, model_forces.GroundForces] | None:
    """The forces of one recording as they stand: of the file named under ``forces:``, else of its own plates.

    ``plates``: what was read of the recording's own; ``named``: the file of forces that is named for it.
    None where the recording has no plates and no file is named.
    """
    if named is not None:
        with _blame_file(named):
            # Refuse moments that are not in N m.
            forces = read_forces(named)
            centre = forces.centre_of_pressure()
            loaded = np.isfinite(centre).all(axis=2) & forces.known
            about = forces.moment - np.cross(centre, forces.force)
            free = np.abs(np.einsum("nka,ka->nk", np.where(loaded[..., None], about, 0.0), forces.normals))
            for k, plate in enumerate(forces.plates):
                if loaded[:, k].any() and np.median(free[loaded[:, k], k]) > LARGEST_FREE_MOMENT:
                    raise errors.TrialUnusable(
                        f"{say_name(plate)} is twisted by {np.median(free[loaded[:, k], k]):.0f} N m, "
                        "as no foot can",
                        file=forces.name,
                        field=f"{plate}, moment",
                        remedy="Give points in m and moments in N m",
                    )
            return named, forces
    if plates is None:
        return None
    with _blame_file(recording):
        return recording, recording_plates.compute_ground_forces(plates)


def bring_forces(
    source: Path, forces: model_forces.GroundForces, trial: Trial, axes: Orientation, *, cutoff_hz: float
) -> model_forces.GroundForces:
    """Forces as read in the session's axes, filtered, at a trial's times; refused where no plate bears."""
    with _blame_file(source):
        # A C3D file that states a wrong unit of length for its markers states it for its plates, too.
        corrected = [r for r in trial.repairs if r.what == "unit" and r.where == trial.name]
        if source.suffix.lower() == ".c3d" and corrected:
            raise errors.TrialUnusable(
                f"the places of its plates are not sure: {corrected[0].detail}",
                file=source,
                field="POINT:UNITS",
                remedy="State the right unit of length in the recording and export it again",
            )
        ground = recording_plates.synchronise(
            turn_forces(source, forces, axes), trial.times, cutoff_hz=cutoff_hz
        )
        if not ground.in_contact().any():
            raise errors.TrialUnusable(
                f"no plate bears more than {np.nanmax(np.abs(ground.pressing), initial=0.0):.3g} N while "
                "markers are recorded",
                file=ground.name,
                field="forces",
                remedy="Give forces in N, of a person who stands on the plates",
            )
    return ground


def prepare_forces(
    source: Path,
    forces: model_forces.GroundForces,
    trial: Trial,
    feet: abc.Mapping[str, Array],
    axes: Orientation,
    *,
    cutoff_hz: float,
) -> TrialForces:
    """Turn, filter and resample forces, and give each contact to a foot.

    ``forces`` as read; ``trial`` in the session's axes; ``feet`` with the markers on each, (n_frames,
    n_markers, 3). Refuses forces and markers that do not belong together.
    """
    ground = bring_forces(source, forces, trial, axes, cutoff_hz=cutoff_hz)
    with _blame_file(source):
        contacts = plates_feet.assign_plates(ground, feet)
        loads = plates_feet.assign_foot_loads(ground, contacts, {foot: foot for foot in feet})
    return TrialForces(source, ground, contacts, loads)


@contextmanager
def _blame_file(file: Path) -> abc.Iterator[None]:
    """Let errors name the whole path of the file, also where they name it by its bare name."""
    try:
        yield
    except errors.InputError as error:
        if error.file in (None, file.name, file.stem):
            error.file = str(file)
        raise


def turn_forces(
    source: Path, forces: model_forces.GroundForces, axes: Orientation
) -> model_forces.GroundForces:
    """Forces in our axes, their plates' own faults repaired or noted.

    Those of MOT and STO files stand Y up and must be in the axes of the markers.
    """
    if source.suffix.lower() != ".c3d" and axes.up != "+y":
        raise errors.InputError(
            f"forces of MOT and STO files are Y up, but the markers' laboratory has {axes.up} up",
            file=source,
            field="forces",
            remedy="Export the markers in the same axes as the forces, or use the plates of a C3D file",
        )
    return repair_forces(recording_plates.orient_forces(axes, forces))


def find_feet(model: BodyModel) -> dict[str, tuple[str, ...]]:
    """The segments that bear loads, each with those that stand on the floor with it; two feet at least."""
    feet = {
        name: tuple(
            s for s in model.segment_names if s == name or s in {_FOOT.sub(other, name) for other in _COMPANY}
        )
        for name in model.segment_names
        if _FOOT.search(name)
    }
    if not feet:
        raise errors.ModelRefused(
            f"model '{model.name}' has no feet, so the ground's forces act on nothing",
            field="model",
            remedy="Use a model of the whole body, such as full_body_35dof, or one whose feet are called "
            "calcn_r and calcn_l",
        )
    if len(feet) == 1:
        raise errors.ModelRefused(
            f"model '{model.name}' has one foot, but the ground bears a person by both",
            field="model",
            remedy="Use a model of the whole body; the planar squat is for `consistent`",
        )
    return feet


def find_foot_markers(model: BodyModel, trial: Trial, extra: abc.Mapping[str, str]) -> dict[str, Array]:
    """Markers on each foot, (n_frames, n_markers, 3), m; enough to tell which plate it stands on.

    ``extra`` are further labels of the recordings, and the segment that each sits on.
    """
    sits = {m.name: m.segment for m in model.markers} | dict(extra)
    found = {}
    for foot, segments in find_feet(model).items():
        labels = [label for label in trial.shown_labels if sits.get(label) in segments]
        if len(labels) < FEWEST:
            raise errors.TrialUnusable(
                f"foot '{foot}' shows {' and '.join(labels) or 'no marker'}; heel and toe at least are "
                "needed to tell which plate it stands on",
                file=trial.name,
                field=foot,
                remedy=f"Name further labels on '{foot}' under `extra_markers:` in the subject file",
            )
        found[foot] = np.stack([trial.position(label) for label in labels], axis=1)
    return found


Plates = abc.Mapping[Path, model_forces.PlateRecording | errors.TrialUnusable | None]
"""Recording to what was read of its plates."""

ReadForces = dict[Path, tuple[Path, model_forces.GroundForces]]
"""Recording to the file that its forces came from, and these as they stand."""


def gather_movement_forces(subject: Subject, plates: Plates) -> ReadForces:
    """The forces of those movements that have some; refused where none has."""
    read = read_movement_forces(subject, plates)
    if not read:
        raise errors.TrialUnusable(
            "no movement has forces: neither plates in its C3D file nor a file of forces",
            field="forces",
            remedy="Name each trial's file of forces under `forces:`, or record with force plates",
        )
    return read


def read_movement_forces(subject: Subject, plates: Plates) -> ReadForces:
    """The forces of those movements that have some."""
    moving = dict.fromkeys((*subject.calibration, *subject.evaluation))
    found = {
        path: read_trial_forces(path, plates.get(path), subject.forces.get(path.name)) for path in moving
    }
    return {path: forces for path, forces in found.items() if forces is not None}


def assign_forces(
    loaded: Loaded, read: ReadForces, cutoff_hz: abc.Callable[[Trial], float]
) -> tuple[dict[str, TrialForces], tuple[str, ...]]:
    """By each movement's stem, its forces in the session's axes, filtered and given to its feet.

    And whose forces cannot be used, and why, in words; TrialUnusable where that is so of all.
    """
    session, axes = loaded.session, loaded.orientation
    assert axes is not None  # a session that was read has axes
    trials = {trial.name: trial for trial in session.dynamic}
    found: dict[str, TrialForces] = {}
    unusable: dict[str, errors.TrialUnusable] = {}
    for path, (source, forces) in read.items():
        trial = trials[path.stem]
        try:
            feet = find_foot_markers(session.model, trial, session.subject.extra_markers)
            found[path.stem] = prepare_forces(source, forces, trial, feet, axes, cutoff_hz=cutoff_hz(trial))
        except errors.TrialUnusable as error:
            unusable[path.stem] = error
    if unusable and not found:
        raise next(iter(unusable.values()))
    said = (f"{name}: its forces are left out: {error.problem}" for name, error in unusable.items())
    return found, tuple(said)
