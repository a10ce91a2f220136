"""What the search starts from: a model of the person, recordings as they were measured, and their forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from scaling_service.capabilities.discovery.checks import check_fits, check_lengths
from scaling_service.capabilities.discovery.evidence.fit import SearchTrial
from scaling_service.capabilities.discovery.observations.wrench import ContactAssignment, Step, choose_band_hz
from scaling_service.capabilities.discovery.options import DiscoverSettings
from scaling_service.capabilities.dynamics.start import scale_model, with_inertia
from scaling_service.capabilities.dynamics.unmeasured import describe_unmeasured
from scaling_service.capabilities.dynamics.weight import FAR_OFF, NOTICED
from scaling_service.capabilities.kinetics.forces import (
    TrialForces,
    assign_forces,
    bring_forces,
    find_feet,
    read_movement_forces,
    read_trial_forces,
)
from scaling_service.capabilities.shared.names import OWN
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.preparing import Loaded
from scaling_service.core.arrays import Mask
from scaling_service.core.errors import ModelRefused, TrialUnusable
from scaling_service.core.names import say_names
from scaling_service.core.progress import Progress
from scaling_service.core.text import list_few
from scaling_service.model.body import BodyModel
from scaling_service.model.forces import GroundForces
from scaling_service.model.inertia import sum_mass
from scaling_service.model.poses import pose_neutral_frames
from scaling_service.model.results import Calibration
from scaling_service.model.subject import Subject
from scaling_service.numerics.signals.filters import find_runs
from scaling_service.numerics.signals.splines import MIN_SAMPLES
from scaling_service.numerics.wrench import GRAVITY
from scaling_service.recording import plates_feet
from scaling_service.recording.exchanged import without_exchanges
from scaling_service.recording.faults import FAULTS, OF_PLATES

NOT_TRIED = "effects of forces, masses and gravity were not tried"

_NOTED = (
    "two_feet", "over_edge", "no_foot", "pressure_astray", "turned_plate", "force_sign", "not_recorded",
    *FAULTS,
)  # fmt: skip
"""Repairs of forces that bear on what the search may say."""

_OWN_INERTIA = "stature or mass is not given: the model's own inertia was taken"

PLAIN_METHODS = ("MB", "EB")
"""Scalings that fit no marker's place, and so take up least of what is looked for: markers, images."""


def read_ground_forces(loaded: Loaded, model: BodyModel) -> tuple[dict[str, TrialForces], tuple[str, ...]]:
    """Forces of all movements that have some, by their stems, and notes on what could not be used.

    ``model``: the person's, with mass. Refuses forces that are there and cannot be used (InputError).
    """
    read = read_movement_forces(loaded.session.subject, loaded.plates)
    if not read:
        return {}, (f"no recording has forces: {NOT_TRIED}",)
    lacking = _describe_lack(model, loaded.session.subject.mass_kg)
    if lacking:
        return {}, (f"{lacking}: {NOT_TRIED}",)
    found, unusable = assign_forces(loaded, read, lambda trial: choose_band_hz(trial.rate_hz))
    recorded = {path.stem for path in read}
    without = [trial.name for trial in loaded.session.dynamic if trial.name not in recorded]
    notes = [f"{list_few(without)}: no forces, so only markers were compared"] if without else []
    declared, own = loaded.session.subject.mass_kg, sum_mass(model)
    if declared is not None and abs(own - declared) > NOTICED * declared:
        notes.append(
            f"the model's segments weigh {own:.1f} kg together, {declared:.1f} kg are declared: one of its "
            "segments, or all of them, do not have this person's mass"
        )
    return found, (
        *notes,
        *unusable,
        *(
            f"{name}: {plates_feet.say_where(repair.what, repair.where)} {repair.detail}"
            for name, forces in found.items()
            for repair in forces.repairs
            if repair.what in _NOTED
        ),
    )


def read_standing_forces(
    loaded: Loaded, model: BodyModel, cutoff_hz: float
) -> tuple[ContactAssignment | None, tuple[str, ...]]:
    """The ground's forces while the person stands, if the plates bear all of the weight, and notes.

    Which foot stands where does not matter: the plates together weigh the person, and place the weight.
    """
    static, axes = loaded.session.static, loaded.orientation
    path = loaded.session.subject.static
    if static is None or path is None or axes is None:
        return None, ()
    try:
        read = read_trial_forces(path, loaded.plates.get(path), loaded.session.subject.forces.get(path.name))
        if read is None:
            return None, ()
        ground = bring_forces(*read, static, axes, cutoff_hz=choose_band_hz(static.rate_hz))
    except TrialUnusable as error:
        return None, (f"{static.name}: its forces are left out: {error.problem}",)
    borne = np.nan_to_num(ground.force[:, :, 1]).sum(axis=1) / -GRAVITY[1]
    mass = sum_mass(model)
    usable = ground.known.all(axis=1) & (borne > mass / FAR_OFF) & (borne < mass * FAR_OFF)
    if usable.any():
        return ContactAssignment(ground, usable, cutoff_hz), ()
    return None, (
        f"{static.name}: its forces are left out: the plates bear {np.median(borne):.1f} of {mass:.1f} kg",
    )


def _describe_lack(model: BodyModel, mass_kg: float | None) -> str:
    """What a model lacks to answer the forces on a person of this mass; empty where it has all."""
    try:
        find_feet(model)
    except ModelRefused:
        return f"model '{model.name}' ends above its feet, so the ground's forces act on nothing"
    mass = sum_mass(model)
    if mass_kg is not None and 0.0 < mass < mass_kg / FAR_OFF:
        return (
            f"model '{model.name}' weighs {mass:.1f} of the person's {mass_kg:.1f} kg, so it cannot answer "
            "the forces on the whole person; use a model of the whole body"
        )
    return "" if mass > 0.0 else f"model '{model.name}' has no mass"


def find_usable_frames(ground: GroundForces, contacts: plates_feet.FootContacts) -> Mask:
    """Frames in which the plates should show all that the ground does, shape (n,).

    A foot that steps beside the plates, or over the edge of one, is no finding. A foot that never meets a
    plate while the other one always does has lost its plate, and that is one: such frames stay.
    """
    loaded = ground.in_contact()
    stray = (loaded & (contacts.foot == plates_feet.NOBODY)).any(axis=1)
    bears = np.stack([(contacts.foot == k).any(axis=1) for k in range(len(contacts.feet))], axis=1)
    beside = contacts.on_floor & ~bears
    # Without the frames in which a foot comes down and rolls off
    step = float(np.median(np.diff(ground.times))) if len(ground.times) > 1 else 0.0
    for k in range(len(contacts.feet)):
        for start, stop in find_runs(beside[:, k]).tolist():
            beside[start:stop, k] = (stop - start) * step > 2 * plates_feet.BRIEF_S
    for k in range(len(contacts.feet)):
        others = np.delete(beside, k, axis=1)
        if not bears[:, k].any() and not others.any():
            beside[:, k] = False
    partly = contacts.over_edge.any(axis=1)
    return np.asarray(ground.known.all(axis=1) & ~stray & ~partly & ~beside.any(axis=1))


def find_steps(forces: TrialForces, model: BodyModel) -> tuple[Step, ...]:
    """Steps of one foot that is alone on one plate, all of it."""
    contacts, feet, found = forces.contacts, find_feet(model), []
    frames_of = pose_neutral_frames(model)
    right = np.array([frames_of[foot][1][2] for foot in feet])
    outward = np.where(right < right.mean(), -1.0, 1.0)
    shared = {repair.where for repair in forces.repairs if repair.what == "two_feet"}
    last = len(contacts.foot) - 1
    for k, (foot, segments) in enumerate(feet.items()):
        own = contacts.foot == contacts.feet.index(foot)
        lone = own.sum(axis=1) == 1
        for at, plate in enumerate(forces.ground.plates):
            for start, stop in find_runs(own[:, at]).tolist():
                frames = slice(start, stop)
                whole = start > 0 and stop <= last
                clean = lone[frames].all() and not contacts.over_edge[frames, k].any()
                if clean and plate not in shared and stop - start >= MIN_SAMPLES:
                    found.append(
                        Step(
                            plate=plate,
                            segments=segments,
                            outward=float(outward[k]),
                            frames=frames,
                            whole=whole,
                        )
                    )
    return tuple(found)


def leave_out_untold(recordings: Sequence[SearchTrial]) -> tuple[tuple[SearchTrial, ...], tuple[str, ...]]:
    """Recordings without the forces that faulty plates leave untold, and notes.

    A plate is the same in all recordings: a fault that its readings show in one may hide in others.
    """
    grounds = [r.contacts.ground for r in recordings if r.contacts is not None]
    repairs = (one for ground in grounds for one in ground.repairs if one.what in OF_PLATES)
    faulty = {one.where.split()[0] for one in repairs}
    if not faulty:
        return tuple(recordings), ()
    kept = []
    for r in recordings:
        if r.contacts is not None:
            ground = r.contacts.ground
            untold = ground.in_contact()[:, [name in faulty for name in ground.plates]].any(axis=1)
            steps = tuple(s for s in r.contacts.steps if s.plate not in faulty)
            r = replace(r, contacts=replace(r.contacts, usable=r.contacts.usable & ~untold, steps=steps))
        kept.append(r)
    return tuple(kept), (
        f"{say_names(sorted(faulty))}: what it bears is known in no recording, and was not compared",
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Prepared:
    """Everything that the search needs, in memory."""

    loaded: Loaded
    start: str  # the method that scaled the model, or ``none``
    model: BodyModel  # of the person's size, without parameters
    # calibration trials fit, evaluation trials are held out; all fit where there are only one kind
    recordings: tuple[SearchTrial, ...]
    forces: Mapping[str, TrialForces] = field(default_factory=dict)  # of the recordings that have some
    calibration: Calibration | None = None  # None for the given model
    notes: tuple[str, ...] = ()  # what could not be tried or decided, and why

    @property
    def subject(self) -> Subject:
        """Whose."""
        return self.loaded.session.subject

    @property
    def roles(self) -> Mapping[str, str]:
        """Recording to ``fit`` or ``held_out``."""
        return {r.trial.name: r.role for r in self.recordings}


def prepare(
    loaded: Loaded, chosen: DiscoverSettings, settings: Settings, progress: Progress | None = None
) -> Prepared:
    """Scale the model, read the forces, and refuse a model that does not follow the recordings at all.

    ``loaded``: recordings neither smoothed nor filled. Refuses whatever cannot be used of model, recordings
    and forces (InputError).
    """
    session, subject = loaded.session, loaded.session.subject
    check_lengths(session.dynamic)
    # A scaling that fits marker places would take exchanged labels for skin.
    sound, exchanged = without_exchanges(session)
    plain = PLAIN_METHODS[session.images is not None]
    start = scale_model(replace(loaded, session=sound), chosen.start or plain, settings, progress=progress)
    scaled = start.calibration is not None
    check_fits(start.model, session.dynamic, scaled=scaled)
    unknown = chosen.inertia is None and None in (subject.height_m, subject.mass_kg)
    model, _, decided = with_inertia(start.model, subject, OWN if unknown else chosen.inertia, scaled=scaled)
    forces, notes = read_ground_forces(loaded, model)
    fitting = {trial.name for trial in session.calibration or session.evaluation}
    contacts = {
        name: ContactAssignment(
            one.ground,
            find_usable_frames(one.ground, one.contacts),
            chosen.cutoff_hz,
            find_steps(one, model),
        )
        for name, one in forces.items()
    }
    used = tuple(
        SearchTrial(trial, "fit" if trial.name in fitting else "held_out", contacts.get(trial.name))
        for trial in session.dynamic
    )
    if session.static is not None and session.static.n_frames >= MIN_SAMPLES:  # a witness
        standing, said = read_standing_forces(loaded, model, chosen.cutoff_hz) if forces else (None, ())
        used, notes = (SearchTrial(session.static, "fit", standing), *used), (*notes, *said)
    used, left_out = leave_out_untold(used)
    unmeasured = [
        said
        for trial in session.dynamic
        if (own := forces.get(trial.name)) is not None
        for said in describe_unmeasured(model, trial, own.loads, own.contacts, chosen.cutoff_hz)
    ]
    of_inertia = (_OWN_INERTIA,) if unknown and scaled else decided
    notes = (
        *start.warnings,
        *(f"{said}: the model was scaled without them" for said in exchanged if scaled),
        *unmeasured,
        *(of_inertia if forces else ()),
        *notes,
        *left_out,
    )
    return Prepared(
        loaded=loaded,
        start=start.method,
        model=model,
        recordings=used,
        forces=forces,
        calibration=start.calibration,
        notes=tuple(dict.fromkeys(notes)),
    )
