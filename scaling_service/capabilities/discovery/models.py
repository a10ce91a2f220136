"""The model with what was named in it, and as much of it as an OpenSim file can hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from scaling_service.capabilities.discovery.effects.joints import AXIS_TILT as TILT
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws.apply import with_effects, with_inertial_changes
from scaling_service.capabilities.discovery.laws.candidates import Estimate, FreeMotion, Part
from scaling_service.capabilities.discovery.laws.loads import Tilt, Wobbling
from scaling_service.capabilities.discovery.laws.profiles import Constant, Following
from scaling_service.capabilities.discovery.laws.spots import MarkerSpot, SizeSpot, VolumeSpot
from scaling_service.capabilities.discovery.start import Prepared
from scaling_service.core.errors import DependencyMissing, ModelRefused
from scaling_service.files.osim.joints import plan_joints
from scaling_service.files.osim.models import write_osim
from scaling_service.model.body import BodyModel, Law, Vector
from scaling_service.model.parameters import compose_tilts

_ANY_TRIAL = ""


def correct_model(fit: Fit) -> BodyModel:
    """The model with all that holds in every recording: shape, markers, masses."""
    return apply_everywhere(fit.model, _select_lasting(fit))


def make_own_models(fit: Fit) -> dict[str, BodyModel]:
    """The models of those recordings in which something holds that does not in the others."""
    own = {trial for s in fit.effects if _of_model(s) for trial in s.candidate.trials}
    return {
        trial: apply_everywhere(fit.model, [s for s in fit.effects if s.candidate.holds_in(trial)])
        for trial in sorted(own)
    }


def apply_everywhere(model: BodyModel, effects: Sequence[Estimate]) -> BodyModel:
    """A model with effects, whatever recordings they hold in."""
    everywhere = [replace(s, candidate=replace(s.candidate, trials=())) for s in effects]
    return with_inertial_changes(with_effects(model, everywhere, _ANY_TRIAL), everywhere)


def _select_lasting(fit: Fit) -> list[Estimate]:
    return [s for s in fit.effects if not s.candidate.trials]


def _of_model(effect: Estimate) -> bool:
    """Whether an effect changes the model rather than the recording."""
    parts = _list_parts(effect)
    return any(not isinstance(p.spot, VolumeSpot) for p in parts)


def _list_parts(effect: Estimate) -> list[Part]:
    return [part for column in effect.candidate.columns for part in column.parts]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class OsimPlan:
    """What of the corrected model goes into an OpenSim file, and how."""

    model: BodyModel  # without what OpenSim cannot hold
    left_out: tuple[str, ...] = ()  # what that is, in plain words
    amended: bool = False  # whether the model's own file can be changed: its muscles and meshes then stay
    # factors, tilts: sizes of segments and turns of joints against that file
    factors: Mapping[str, Vector] = field(default_factory=dict)
    tilts: Mapping[str, tuple[float, float]] = field(default_factory=dict)


def plan_osim(fit: Fit, prepared: Prepared) -> OsimPlan:
    """Leave out what OpenSim cannot hold, effect by effect."""
    kept: list[Estimate] = []
    left: list[str] = []
    for effect in _select_lasting(fit):
        reason = _describe_refusal(fit.model, [*kept, effect], effect)
        if reason:
            left.append(f"{effect.candidate.name}: {reason}")
        else:
            kept.append(effect)
    model = _hold_markers_still(apply_everywhere(fit.model, kept))
    if not _from_osim(prepared) or not all(map(_can_be_amended, kept)):
        return OsimPlan(model=model, left_out=tuple(left))
    return OsimPlan(
        model=model,
        left_out=tuple(left),
        amended=True,
        factors=_list_factors(prepared, kept),
        tilts=_list_tilts(prepared, kept),
    )


def _describe_refusal(model: BodyModel, kept: Sequence[Estimate], effect: Estimate) -> str:
    """Why an OpenSim file cannot hold an effect; empty where it can."""
    parts, loads = _list_parts(effect), [column.load for column in effect.candidate.columns]
    if any(isinstance(load, Tilt) for load in loads):
        return "turn the gravity of OpenSim's model by its numbers, which are in discovery.json"
    if any(isinstance(load, Wobbling) for load in loads):
        return "model files hold no oscillation; its numbers are in discovery.json"
    if any(isinstance(p.spot, MarkerSpot) and isinstance(p.profile, Following) for p in parts):
        return "OpenSim's markers do not move on their segments; model.json holds it"
    try:
        plan_joints(apply_everywhere(model, kept))
    except ModelRefused as error:
        return f"{error.problem}; model.json holds it"
    return ""


def _hold_markers_still(model: BodyModel) -> BodyModel:
    """The model with markers at the constant part of their places."""
    markers = []
    for marker in model.markers:
        x, y, z = map(Law.constant, marker.nominal)
        markers.append(replace(marker, laws=(x, y, z)))
    return model.with_markers(tuple(markers))


def _can_be_amended(effect: Estimate) -> bool:
    """Whether an effect is a change of sizes, axes, markers or masses, which a file can be given, or none."""
    if isinstance(effect.candidate.change, FreeMotion):
        return False
    if effect.candidate.kind == TILT:
        return True
    return all(
        isinstance(p.spot, MarkerSpot | SizeSpot | VolumeSpot) and isinstance(p.profile, Constant)
        for p in _list_parts(effect)
    )


def _list_factors(prepared: Prepared, kept: Sequence[Estimate]) -> dict[str, Vector]:
    known = dict(prepared.calibration.scale_factors) if prepared.calibration is not None else {}
    for effect in kept:
        for column, size in effect.columns:
            for part in column.parts:
                if isinstance(part.spot, SizeSpot):
                    x, y, z = known.get(part.spot.segment, (1.0, 1.0, 1.0))
                    by = 1.0 + part.gain * size
                    known[part.spot.segment] = (x * by, y * by, z * by)
    return known


def _list_tilts(prepared: Prepared, kept: Sequence[Estimate]) -> dict[str, tuple[float, float]]:
    known = dict(prepared.calibration.axis_tilts) if prepared.calibration is not None else {}
    for effect in kept:
        if effect.candidate.kind == TILT:
            turn = {column.name[0]: size for column, size in effect.columns}
            more = (turn.get("x", 0.0), turn.get("y", 0.0))
            joint = effect.candidate.where[0]
            known[joint] = compose_tilts(known.get(joint, (0.0, 0.0)), more)
    return known


def write_corrected_osim(path: Path, fit: Fit, prepared: Prepared) -> tuple[str, ...]:
    """Write ``model.osim`` with all that OpenSim can hold; says in plain sentences what it does not hold."""
    plan = plan_osim(fit, prepared)
    notes = tuple(f"model.osim is without {said}" for said in plan.left_out)
    try:
        return (*notes, *_write_osim(path, plan, prepared))
    except (DependencyMissing, ModelRefused) as error:
        return (*notes, f"model.osim was not written: {error}")


def _write_osim(path: Path, plan: OsimPlan, prepared: Prepared) -> tuple[str, ...]:
    """Change the file that the model came from; make a new one where that cannot hold what was found."""
    subject, setup = prepared.subject, prepared.loaded.session.scale_setup
    if plan.amended:
        with suppress(ModelRefused):
            write_osim(
                path,
                plan.model,
                source=Path(subject.model),
                factors=plan.factors,
                axis_tilts=plan.tilts,
                joint_moves={} if prepared.calibration is None else prepared.calibration.joint_moves,
                marker_set=subject.marker_set,
                preserve_mass_distribution=setup is None or setup.preserve_mass_distribution,
                inertia_from_model=True,
            )
            return ()
    write_osim(path, plan.model)
    if not _from_osim(prepared):
        return ()
    return (
        "model.osim was made anew, with joints, masses and markers only: the file that the model came from "
        "cannot be given what was found, so its muscles and meshes are left out",
    )


def _from_osim(prepared: Prepared) -> bool:
    return prepared.subject.model.lower().endswith(".osim")
