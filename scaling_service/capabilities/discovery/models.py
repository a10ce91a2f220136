"""The model with what was named in it, and as much of it as an OpenSim file can hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeGuard

from scaling_service.capabilities.discovery.effects.joints import AXIS_TILT as TILT
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws import candidates, spots
from scaling_service.capabilities.discovery.laws.apply import with_effects, with_inertial_changes
from scaling_service.capabilities.discovery.laws.loads import Tilt, Wobbling
from scaling_service.capabilities.discovery.start import Prepared
from scaling_service.capabilities.discovery.words import describe_place
from scaling_service.core.errors import DependencyMissing, ModelRefused
from scaling_service.files.osim.joints import plan_joints
from scaling_service.files.osim.models import write_osim
from scaling_service.model import body
from scaling_service.model.parameters import compose_tilts
from scaling_service.model.results import JointMove

_ANY_TRIAL = ""


def correct_model(fit: Fit) -> body.BodyModel:
    """The model with all that holds in every recording: shape, markers, masses."""
    return _apply_everywhere(fit.model, [s for s in fit.effects if not s.candidate.trials])


def make_own_models(fit: Fit) -> dict[str, body.BodyModel]:
    """The models of those recordings in which something of the model holds that does not in the others."""
    own = {
        trial
        for effect in fit.effects
        if any(not isinstance(part.spot, spots.VolumeSpot) for part in effect.candidate.parts)
        for trial in effect.candidate.trials
    }
    return {
        trial: _apply_everywhere(fit.model, [s for s in fit.effects if s.candidate.holds_in(trial)])
        for trial in sorted(own)
    }


def _apply_everywhere(model: body.BodyModel, effects: Sequence[candidates.Estimate]) -> body.BodyModel:
    """A model with effects, whatever recordings they hold in."""
    everywhere = [replace(s, candidate=replace(s.candidate, trials=())) for s in effects]
    return with_inertial_changes(with_effects(model, everywhere, _ANY_TRIAL), everywhere)


@dataclass(frozen=True, slots=True, eq=False)
class OsimPlan:
    """What of the corrected model goes into an OpenSim file, and how."""

    model: body.BodyModel  # without what OpenSim cannot hold
    left_out: tuple[str, ...]  # what that is, in plain words
    # of the model's own file, whose muscles and meshes then stay, for ``write_osim``; None to make it anew
    changes: Mapping[str, Any] | None


def plan_osim(fit: Fit, prepared: Prepared) -> OsimPlan:
    """Leave out what OpenSim cannot hold, effect by effect."""
    kept: list[candidates.Estimate] = []
    left: list[str] = []
    for effect in fit.effects:
        if not effect.candidate.trials:
            reason = _describe_refusal(fit.model, [*kept, effect], effect)
            if reason:
                left.append(f"{describe_place(effect.candidate)}: {reason}")
            else:
                kept.append(effect)
    model = _apply_everywhere(fit.model, kept)
    still = []
    for marker in model.markers:
        x, y, z = map(body.Law.constant, marker.nominal)
        still.append(replace(marker, laws=(x, y, z)))
    model = model.with_markers(tuple(still))
    amended = _from_osim(prepared) and all(map(_can_be_amended, kept))
    return OsimPlan(model, tuple(left), _list_changes(fit.model, prepared, kept) if amended else None)


def _describe_refusal(
    model: body.BodyModel, kept: Sequence[candidates.Estimate], effect: candidates.Estimate
) -> str:
    """Why an OpenSim file cannot hold an effect; empty where it can."""
    loads = [column.load for column in effect.candidate.columns]
    if any(isinstance(load, Tilt) for load in loads):
        return "turn the gravity of OpenSim's model by its numbers, which are in discovery.json"
    if any(isinstance(load, Wobbling) for load in loads):
        return "model files hold no oscillation; its numbers are in discovery.json"
    for part in effect.candidate.parts:
        if isinstance(part.spot, spots.MarkerSpot) and part.profile is not None:
            return "OpenSim's markers do not move on their segments; model.json holds it"
    try:
        plan_joints(_apply_everywhere(model, kept))
    except ModelRefused as error:
        return f"{error.problem}; model.json holds it"
    return ""


def _can_be_amended(effect: candidates.Estimate) -> bool:
    """Whether a file can be given an effect: a change of sizes, centres, axes, markers or masses, or none."""
    if isinstance(effect.candidate.change, candidates.FreeMotion):
        return False
    return effect.candidate.kind == TILT or all(
        part.profile is None and (not isinstance(part.spot, spots.JointSpot) or _is_centre(part.spot))
        for part in effect.candidate.parts
    )


def _is_centre(spot: spots.Spot) -> TypeGuard[spots.JointSpot]:
    return isinstance(spot, spots.JointSpot) and (spot.at, spot.kind) == ("start", "translation")


def _list_changes(
    model: body.BodyModel, prepared: Prepared, kept: Sequence[candidates.Estimate]
) -> dict[str, Any]:
    """What scaling did to the file, and the effects on top of that."""
    known, setup = prepared.calibration, prepared.loaded.session.scale_setup
    factors = {} if known is None else dict(known.scale_factors)
    tilts = {} if known is None else dict(known.axis_tilts)
    moves = {} if known is None else dict(known.joint_moves)
    for effect in kept:
        if effect.candidate.kind == TILT:
            turn = {column.name[0]: size for column, size in effect.columns}
            joint, more = effect.candidate.where[0], (turn.get("x", 0.0), turn.get("y", 0.0))
            tilts[joint] = compose_tilts(tilts.get(joint, (0.0, 0.0)), more)
            continue
        for spot, by in ((p.spot, p.gain * size) for column, size in effect.columns for p in column.parts):
            if isinstance(spot, spots.SizeSpot):
                own = factors.get(spot.segment, (1.0, 1.0, 1.0))
                factors[spot.segment] = body.to_vector(factor * (1.0 + by) for factor in own)
            elif _is_centre(spot):
                joint = model.segment(spot.segment).joint_name
                move = moves.get(joint, JointMove())
                shift = body.to_vector(x + by * (k == spot.axis) for k, x in enumerate(move.shift))
                moves[joint] = replace(move, shift=shift)
    return {
        "source": Path(prepared.subject.model),
        "factors": factors,
        "axis_tilts": tilts,
        "joint_moves": moves,
        "marker_set": prepared.subject.marker_set,
        "preserve_mass_distribution": setup is None or setup.preserve_mass_distribution,
        "inertia_from_model": True,
    }


def write_corrected_osim(path: Path, fit: Fit, prepared: Prepared) -> tuple[str, ...]:
    """Write ``model.osim`` with all that OpenSim can hold; says in plain sentences what it does not hold.

    The file that the model came from is changed; a new one is made where that cannot hold what was found.
    """
    plan = plan_osim(fit, prepared)
    notes = tuple(f"{path.name} is without {said}" for said in plan.left_out)
    try:
        if plan.changes is not None:
            with suppress(ModelRefused):
                write_osim(path, plan.model, **plan.changes)
                return notes
        write_osim(path, plan.model)
    except (DependencyMissing, ModelRefused) as error:
        return (*notes, f"{path.name} was not written: {error}")
    if not _from_osim(prepared):
        return notes
    return (
        *notes,
        f"{path.name} was made anew, with joints, masses and markers only: the file that the model came from "
        "cannot be given what was found, so its muscles and meshes are left out",
    )


def _from_osim(prepared: Prepared) -> bool:
    return prepared.subject.model.lower().endswith(".osim")
