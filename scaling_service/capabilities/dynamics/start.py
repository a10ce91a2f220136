"""What dynamics starts from: a model of the person with mass, its motions, and the forces on its feet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from scaling_service.capabilities.dynamics.settings import DEFAULT_TABLE, ForceSettings
from scaling_service.capabilities.kinetics import forces as kinetics_forces
from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.capabilities.scaling import run as scaling
from scaling_service.capabilities.shared import names
from scaling_service.capabilities.shared import settings as shared_settings
from scaling_service.capabilities.subject.preparing import Loaded
from scaling_service.capabilities.subject.provenance import record_provenance
from scaling_service.core.errors import SubjectInvalid
from scaling_service.core.options import Options
from scaling_service.core.progress import Progress
from scaling_service.core.text import list_few
from scaling_service.model import subject as subjects
from scaling_service.model.anatomy import inertia_planar
from scaling_service.model.anatomy.inertia import apply_inertia_table
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import BUILTIN_NAMES
from scaling_service.model.results import Calibration, Motion


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Prepared:
    """Everything that dynamics needs, in memory."""

    loaded: Loaded
    start: str  # the method that scaled the model, or ``AS_IT_IS``
    inertia: str  # a table's name, or ``model``
    model: BodyModel  # of the person's size and mass
    motions: Mapping[str, Motion]  # of the trials with forces, by their stems
    forces: Mapping[str, kinetics_forces.TrialForces]  # of the same trials, at the times of their motions
    calibration: Calibration | None = None  # how the model was scaled; None for the given model
    warnings: tuple[str, ...] = ()

    @property
    def subject(self) -> subjects.Subject:
        """Whose recordings these are."""
        return self.loaded.session.subject

    @property
    def height_m(self) -> float:
        """The person's stature, zero where it is not known."""
        return self.subject.height_m or 0.0


def prepare(
    loaded: Loaded,
    chosen: ForceSettings = ForceSettings(),
    settings: shared_settings.Settings = shared_settings.UNSMOOTHED,
    *,
    progress: Progress | None = None,
) -> Prepared:
    """Give the forces of a subject's recordings to its feet, scale its model, and track the markers."""
    session, known = loaded.session, loaded.session.subject
    with loaded.blame_files():
        read = kinetics_forces.gather_movement_forces(known, loaded.plates)
        if known.height_m is None:
            raise SubjectInvalid(
                "residuals are reported as shares of body weight times height, and no height is given",
                field="subject.height_m",
                remedy="Give the person's stature in m",
            )
        kinetics_forces.find_feet(session.model)
        forces, unusable = kinetics_forces.assign_forces(loaded, read, lambda _: chosen.cutoff_hz)
        start = scale_model(loaded, chosen.start, settings, progress=progress)
        model, inertia, notes = with_inertia(
            start.model, known, chosen.inertia, scaled=start.calibration is not None
        )
        trials = [trial for trial in session.dynamic if trial.name in forces]
        motions = {t.name: start.motions.get(t.name) or inverse_kinematics(start.model, t) for t in trials}
    without = {path.stem: None for path in (*known.calibration, *known.evaluation) if path not in read}
    left_out = [f"{list_few(list(without))}: no forces, so no dynamics"] if without else []
    return Prepared(
        loaded=loaded,
        start=start.method,
        inertia=inertia,
        model=model,
        motions=motions,
        forces=forces,
        calibration=start.calibration,
        warnings=(*start.warnings, *notes, *left_out, *unusable),
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Start:
    """A model of the person's size, and how it came about."""

    method: str  # that scaled it, or ``AS_IT_IS``
    model: BodyModel
    calibration: Calibration | None  # None for the given model
    motions: Mapping[str, Motion]  # those that scaling found, by trial
    warnings: tuple[str, ...]


def choose_rigid(session: subjects.Session) -> str:
    """The scaling whose markers are fixed on their segments and near, for what moves bodies itself."""
    return "EB_am" if session.images is not None else "MB_am"


def scale_model(
    loaded: Loaded,
    method: str | None,
    settings: shared_settings.Settings,
    *,
    progress: Progress | None = None,
) -> Start:
    """Scale the model by a method; by the joint posterior unless another is given."""
    session = loaded.session
    chosen = method or "MAP"
    if chosen == names.AS_IT_IS:
        return Start(
            method=chosen, model=session.model, calibration=None, motions={}, warnings=session.warnings
        )
    results = scaling.run(loaded, (chosen,), settings, progress=progress)
    found = results.scalings[chosen]
    warnings = dict.fromkeys((*session.warnings, *results.warnings, *found.calibration.warnings))
    return Start(
        method=chosen,
        model=found.calibration.model,
        calibration=found.calibration,
        motions=found.motions,
        warnings=tuple(warnings),
    )


def with_inertia(
    model: BodyModel, subject: subjects.Subject, inertia: str | None, *, scaled: bool
) -> tuple[BodyModel, str, tuple[str, ...]]:
    """The model of the person's size with the inertia that was asked for, its name, and what was decided.

    Unless a table's name or ``OWN`` is given: ``DEFAULT_TABLE`` for a built-in model that was scaled to the
    person, else the model's own.
    """
    names.check_inertia(inertia)
    chosen = inertia or (DEFAULT_TABLE if scaled and subject.model in BUILTIN_NAMES else names.OWN)
    if chosen == names.OWN:
        return model, names.OWN, ()
    if subject.height_m is None or subject.mass_kg is None:
        lacking = "mass_kg" if subject.mass_kg is None else "height_m"
        raise SubjectInvalid(
            f"inertial tables need the person's {lacking.split('_')[0]}",
            field=f"subject.{lacking}",
            remedy=f"Give it, or keep the model's own inertia (inertia: {names.OWN})",
        )
    apply = inertia_planar.apply_to_squat if subject.model == inertia_planar.SQUAT else apply_inertia_table
    result = apply(model, chosen, sex=subject.sex, height_m=subject.height_m, mass_kg=subject.mass_kg)
    return result.model, chosen, result.notes


def record_dynamics_provenance(
    prepared: Prepared, settings: shared_settings.Settings, **chosen: Options
) -> dict[str, Any]:
    """What is needed to get results again, and what they started from; ``chosen`` stand by their names."""
    resolved = settings.resolved() | {name: options.resolved() for name, options in chosen.items()}
    trials = prepared.loaded.session.dynamic
    origin = record_provenance(prepared.loaded, trials, resolved, settings.seed)
    return origin | {"start": prepared.start, "inertia": prepared.inertia}
