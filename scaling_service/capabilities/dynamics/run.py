"""Inverse dynamics of a subject's recordings, from the subject file to results and a verdict in memory."""

from __future__ import annotations

import time
from collections import abc
from pathlib import Path
from types import MappingProxyType

import numpy as np

from scaling_service.capabilities.dynamics import result, start, words
from scaling_service.capabilities.dynamics import unmeasured as unweighed
from scaling_service.capabilities.dynamics import weight as weights
from scaling_service.capabilities.dynamics.inertia import identification
from scaling_service.capabilities.dynamics.inertia.evidence import ForceRecording
from scaling_service.capabilities.dynamics.inertia.parameters import InertialIdentification
from scaling_service.capabilities.dynamics.settings import DynamicsSettings
from scaling_service.capabilities.dynamics.uncertainty import total
from scaling_service.capabilities.kinetics import inverse_dynamics
from scaling_service.capabilities.kinetics.forces import TrialForces
from scaling_service.capabilities.shared import settings as shared_settings
from scaling_service.capabilities.subject import provenance
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.core import progress as progressing
from scaling_service.core.errors import TrialUnusable
from scaling_service.core.names import say_names
from scaling_service.core.text import list_few
from scaling_service.model.body import BodyModel
from scaling_service.model.inertia import sum_mass
from scaling_service.model.results import Motion
from scaling_service.model.subject import Subject
from scaling_service.recording.faults import FAULTS
from scaling_service.recording.plates_feet import say_where

_PREPARING = 0.3
"""Chosen: about the share of reading, scaling and inverse kinematics; the uncertainty takes the rest."""

_WARNED_OF = (
    "two_feet", "two_plates", "in_swing", "no_plate", "over_edge", "no_foot", "pressure_astray",
    "turned_plate", "force_sign", "not_recorded", *FAULTS,
)  # fmt: skip
"""Repairs of forces that a person should know of without opening the results."""

_WRONG_MASS = (
    "Give the right mass first: until then the residual is that of the mass, and says nothing else of "
    "the inertia or of the measurement."
)
_NOT_MEASURED = (
    "Inertial parameters are not to be calibrated by {}: the plates do not measure all that bears the "
    "person, or landings load them faster than the filter follows."
)


def dynamics(
    subject: Subject | str | Path,
    chosen: DynamicsSettings = DynamicsSettings(),
    settings: shared_settings.Settings = shared_settings.UNSMOOTHED,
    *,
    progress: progressing.Progress | None = None,
) -> result.DynamicsResults:
    """Joint forces and residuals of a subject's recordings, with their uncertainty (Muller et al. 2017).

    Parameters
    ----------
    subject : Subject or path
        A subject, or the subject file that describes it.
    chosen : DynamicsSettings
        Which scaling to start from, and what to do with the inertia.
    settings : Settings
        Markers are not smoothed unless it says so: motion and forces pass one filter.
    progress : callable, optional
        Called with what is being done and the share that is done, 0 to 1.

    Returns
    -------
    result.DynamicsResults
        Of every recording with forces: N and N m. ``verdict`` says what the residuals say of the model.

    Raises
    ------
    InputError
        Something in the subject file, the model, the recordings or their forces cannot be used.

    Examples
    --------
    >>> import scaling_service as ss
    >>> checked = ss.dynamics("plates/subject.json", ss.DynamicsSettings(start="none"))
    >>> checked.residuals.columns
    ('trial', 'fx_N', 'fy_N', 'fz_N', 'mx_Nm', 'my_Nm', 'mz_Nm')
    >>> round(checked.weight.plates_kg)
    67
    """
    clock = time.perf_counter()
    report = progress or progressing.show_nothing
    loaded = open_subject(subject, settings, facing=True)
    prepared = start.prepare(
        loaded, chosen, settings, progress=progressing.report_part(report, 0.0, _PREPARING)
    )
    trials: dict[str, result.TrialDynamics] = {}
    refused: dict[str, TrialUnusable] = {}
    with loaded.blame_files():
        for k, name in enumerate(prepared.motions):
            report(f"uncertainty of {name}", _PREPARING + (1.0 - _PREPARING) * k / len(prepared.motions))
            try:
                trials[name] = compute_trial_dynamics(prepared, name, chosen)
            except TrialUnusable as error:
                refused[name] = error
        if not trials:
            raise next(iter(refused.values()))
        weight = weights.weigh_motions(
            {name: (found.dynamics, found.frames) for name, found in trials.items()}
        )
        assert weight is not None  # a recording without a frame that counts is refused
        weight.check()
        inertial, notes = _identify(prepared, trials, chosen) if chosen.identify else (None, ())
    report("done", 1.0)
    verdict = write_verdict(trials, weight, refused)
    known = start.record_dynamics_provenance(prepared, settings, dynamics=chosen)
    for name, found in trials.items():
        known["repairs"][name] += provenance.repair_notes(found.forces.repairs)
    told = {name: _make_trial(found, prepared) for name, found in trials.items()}
    supported = [yes for trial in told.values() for yes in trial.calibration_supported]
    headline, tone = words.write_headline(supported, wrong_mass=weight.differs)
    document = result.DynamicsDocument(
        **known,
        headline=headline,
        tone=tone,
        mass_kg=sum_mass(prepared.model),
        weight=result.WeightDocument(
            declared_kg=weight.declared_kg,
            plates_kg=weight.plates_kg,
            sd_kg=weight.sd_kg,
            differs=weight.differs,
            by_trial_kg=dict(weight.by_trial),
        ),
        height_m=prepared.height_m,
        trials=told,
        verdict=verdict,
        inertial=None if inertial is None else _make_identification(inertial, prepared.model),
        warnings=[*prepared.warnings, *notes],
        files=[],
        wall_s=round(time.perf_counter() - clock, 3),
    )
    return result.DynamicsResults(
        prepared=prepared,
        trials=trials,
        weight=weight,
        verdict=verdict,
        document=document,
        inertial=inertial,
    )


def _make_trial(found: result.TrialDynamics, prepared: start.Prepared) -> result.TrialDynamicsDocument:
    residuals, uncertainty = found.residuals, found.uncertainty
    fitted = {trial.name for trial in prepared.loaded.session.calibration}
    kinds = {c.name: c.kind for c in prepared.model.coordinates}
    forces = found.dynamics.forces[found.frames]
    return result.TrialDynamicsDocument.model_validate(
        {
            "role": "calibration" if residuals.trial in fitted else "evaluation",
            "forces_from": found.forces.source.name,
            "frames": residuals.frames,
            "left_out": residuals.left_out,
            "residual_rms": residuals.rms,
            "dr": residuals.dr,
            "gates": residuals.gates,
            "joint_loads": {
                name: {
                    "unit": "N m" if kinds[name] == "rotation" else "N",
                    "peak": np.abs(forces[:, k]).max(),
                    "rms": np.sqrt((forces[:, k] ** 2).mean()),
                }
                for k, name in enumerate(found.dynamics.coordinates)
            },
            "reconstruction_error_mm": 1e3 * uncertainty.reconstruction_error_m,
            "uncertainty": uncertainty,
            "slopes_per_cm": uncertainty.slopes_per_cm,
            "r2": uncertainty.r2,
            "calibration_supported": found.calibration_supported.tolist(),
            "unmeasured": [one.sentence for one in found.unmeasured],
            "warnings": found.warnings,
        },
        from_attributes=True,
    )


def _make_identification(found: InertialIdentification, before: BodyModel) -> result.IdentificationDocument:
    ratio = found.relative_error(held_out=True)
    known = None if np.isnan(ratio) else ratio
    headline, tone = words.write_inertial_headline(len(found.combinations), known, found.components)
    return result.IdentificationDocument.model_validate(
        {
            "headline": headline,
            "tone": tone,
            "components": found.components,
            "total_mass_kg": (sum_mass(before), sum_mass(found.model)),
            "trials": {fit.trial: fit for fit in found.fits},
            "held_out_ratio": known,
            "combinations": found.combinations,
            "parameters": found.parameters,
            "warnings": found.warnings,
        },
        from_attributes=True,
    )


def _identify(
    prepared: start.Prepared, trials: abc.Mapping[str, result.TrialDynamics], chosen: DynamicsSettings
) -> tuple[InertialIdentification | None, tuple[str, ...]]:
    """Identify inertia from the calibration trials, and hold the evaluation trials out; None and why if not.

    A component of the wrench is used where the verdict supports it in one of the fitted trials. Where only
    evaluation trials have forces, the first of them is fitted.
    """
    fitted = [trial.name for trial in prepared.loaded.session.calibration if trial.name in trials]
    notes: tuple[str, ...] = ()
    if not fitted:
        fitted = [next(iter(trials))]
        notes = (f"no calibration trial has forces: inertia is identified from {fitted[0]}",)
    supported = np.any([trials[name].calibration_supported for name in fitted], axis=0)
    if not supported.any() and not chosen.despite_verdict:
        return None, (*notes, "inertia was not identified: the verdict is that it would fit noise")
    recordings = {name: ForceRecording(found.dynamics, found.frames) for name, found in trials.items()}
    identified = identification.identify_inertia(
        prepared.model,
        [recordings[name] for name in fitted],
        held_out=[recording for name, recording in recordings.items() if name not in fitted],
        supported=supported,
        settings=identification.IdentificationSettings(
            mass_known=not chosen.free_mass,
            symmetric=not chosen.sides_apart,
            despite_verdict=chosen.despite_verdict,
        ),
    )
    return identified, notes


def compute_trial_dynamics(
    prepared: start.Prepared, name: str, chosen: DynamicsSettings
) -> result.TrialDynamics:
    """Inverse dynamics, residuals and their uncertainty of the recording of this stem."""
    motion, forces = prepared.motions[name], prepared.forces[name]
    found = inverse_dynamics.solve_inverse_dynamics(
        prepared.model, motion, forces.loads, cutoff_hz=chosen.cutoff_hz
    )
    unmeasured = unweighed.find_unmeasured(found, forces.contacts, prepared.model)
    frames = inverse_dynamics.find_judged_frames(found, forces.contacts, chosen.cutoff_hz)
    weight = weights.weigh_motions({name: (found, frames)}) if (frames & found.known).any() else None
    if weight is not None:
        weight.check()
    frames &= ~unweighed.find_unmeasured_frames(unmeasured, found.motion.times)
    if unmeasured and not (frames & found.known).any():
        raise TrialUnusable(
            f"the plates measure no frame of it whole: {'; '.join(one.sentence for one in unmeasured)}",
            file=name,
            field="forces",
            remedy="Give the forces of all plates, or record without a chair or a hold",
        )
    residuals = inverse_dynamics.evaluate_residuals(found, prepared.height_m, frames=frames)
    recording = total.LoadedMotion(
        model=prepared.model,
        motion=motion,
        loads=forces.loads,
        height_m=prepared.height_m,
        frames=frames,
        cutoff_hz=chosen.cutoff_hz,
    )
    said = _warn(forces, motion, inverse_dynamics.find_trembling(found, prepared.model, frames))
    warnings = tuple(f"{name}: {warning}" for warning in said)
    return result.TrialDynamics(
        forces=forces,
        dynamics=found,
        frames=frames,
        residuals=residuals,
        recording=recording,
        uncertainty=total.propagate(recording),
        unmeasured=unmeasured,
        warnings=warnings,
    )


def _warn(forces: TrialForces, motion: Motion, shaking: list[str]) -> abc.Iterator[str]:
    """What a person should know of a recording."""
    for repair in forces.repairs:
        if repair.what in _WARNED_OF:
            frames = f" ({repair.frames} frames)" if repair.frames else ""
            yield f"{say_where(repair.what, repair.where)}: {repair.detail}{frames}"
    still = [name for name in motion.coordinates if name not in motion.estimated]
    if still:
        yield (
            f"no marker shows {say_names(still)}: they stand still, and what hangs on them moves as if stiff"
        )
    if shaking:
        yield (
            f"{say_names(shaking)} tremble faster than joints do: markers hardly determine them, "
            "nor the residual"
        )


def write_verdict(
    trials: abc.Mapping[str, result.TrialDynamics],
    weight: weights.Weight,
    refused: abc.Mapping[str, TrialUnusable] = MappingProxyType({}),
) -> str:
    """What was left out; whether mass and plates are right, inertia is to be calibrated, limits are kept."""
    said = [
        f"In {name} {'; '.join(one.sentence for one in found.unmeasured)}."
        for name, found in trials.items()
        if found.unmeasured
    ]
    whole = {name: found for name, found in trials.items() if not found.unmeasured}
    if len(whole) < len(trials):
        said.append(_NOT_MEASURED.format(list_few([name for name in trials if name not in whole])))
    if weight.differs:
        said.append(_WRONG_MASS)
    elif whole:
        said.append(_judge_calibration(whole))
    left_out = (f"{name} is left out: {error.problem}." for name, error in refused.items())
    broken = {
        name: [
            gate.name
            for gate in found.residuals.gates
            if gate.source == inverse_dynamics.HICKS and not gate.passed
        ]
        for name, found in trials.items()
    }
    failing = [name for name, limits in broken.items() if limits]
    if not failing:
        gates = "The residuals keep the limits of Hicks et al. 2015."
    else:
        worst = max(failing, key=lambda name: len(broken[name]))
        most = list_few(broken[worst])
        gates = f"The residuals break limits of Hicks et al. 2015 in {list_few(failing)} ({worst}: {most})."
    return " ".join([*weight.sentences, *left_out, *said, gates])


def _judge_calibration(trials: abc.Mapping[str, result.TrialDynamics]) -> str:
    if len(trials) == 1:
        return next(iter(trials.values())).uncertainty.verdict
    able: dict[str, list[str]] = {}
    for name, found in trials.items():
        components = ", ".join(np.array(inverse_dynamics.COMPONENTS)[found.calibration_supported])
        if components:
            able.setdefault(components, []).append(name)
    if not able:
        return (
            "None of these recordings can calibrate inertial parameters: in every component the "
            "measurement's own uncertainty explains all of the residual, and identification would fit noise."
        )
    by = "; ".join(f"{components} of {list_few(names)}" for components, names in able.items())
    return (
        f"Inertial parameters can be calibrated by {by}: there the residual stands above its uncertainty. "
        "Elsewhere the measurement's own uncertainty explains all of it."
    )
