"""Inverse dynamics of a subject's recordings, from the subject file to results and a verdict in memory."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.dynamics.forces import TrialForces
from scaling_service.capabilities.dynamics.inertia.evidence import ForceRecording
from scaling_service.capabilities.dynamics.inertia.identification import (
    IdentificationSettings,
    identify_inertia,
)
from scaling_service.capabilities.dynamics.inertia.parameters import InertialIdentification
from scaling_service.capabilities.dynamics.inverse_dynamics import (
    COMPONENTS,
    HICKS,
    InverseDynamics,
    Residuals,
    evaluate_residuals,
    find_trembling,
    inverse_dynamics,
    judged_frames,
)
from scaling_service.capabilities.dynamics.settings import PLAIN, UNSMOOTHED, DynamicsSettings
from scaling_service.capabilities.dynamics.start import Prepared, prepare
from scaling_service.capabilities.dynamics.uncertainty.total import (
    Recording,
    UncertaintySettings,
    WrenchUncertainty,
    propagate,
)
from scaling_service.capabilities.dynamics.weight import Weight, weigh_motions
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.core.progress import Progress, part_of, silent
from scaling_service.core.text import few
from scaling_service.model.results import Motion
from scaling_service.model.subject import Subject

_PREPARING = 0.3
"""Chosen: about the share of reading, scaling and inverse kinematics; the uncertainty takes the rest."""

_WARNED_OF = ("two_feet", "two_plates", "in_swing", "no_plate", "no_foot", "force_sign", "not_recorded")
"""Repairs of forces that a person should know of without opening the results."""


@dataclass(frozen=True, slots=True, eq=False)
class TrialDynamics:
    """One recording's dynamics."""

    motion: Motion  # as the markers have it, not filtered
    forces: TrialForces
    dynamics: InverseDynamics
    frames: NDArray[np.bool_]  # (n,): those that count; see ``judged_frames``
    residuals: Residuals  # over these frames
    uncertainty: WrenchUncertainty  # of the residual, over the same frames
    warnings: tuple[str, ...] = ()  # plain sentences


@dataclass(frozen=True, slots=True, eq=False)
class DynamicsResults:
    """Dynamics of all of a subject's recordings that have forces."""

    prepared: Prepared
    chosen: DynamicsSettings
    settings: Settings
    trials: Mapping[str, TrialDynamics]  # by the stems of the trials' files
    weight: Weight  # by the plates, beside the model's
    verdict: str  # in plain words: what the residuals say of the model
    inertial: InertialIdentification | None = None  # where it was asked for and the verdict allows it
    warnings: tuple[str, ...] = ()  # what concerns all recordings
    wall_s: float = 0.0


def dynamics(
    subject: Subject | str | Path,
    chosen: DynamicsSettings = PLAIN,
    settings: Settings = UNSMOOTHED,
    *,
    progress: Progress | None = None,
) -> DynamicsResults:
    """Joint forces and residuals of a subject's recordings.

    ``subject``: Subject or path of a subject file.
    Raises InputError: whatever in the subject file, the model, the recordings or their forces cannot be used.
    """
    clock = time.perf_counter()
    report = progress or silent
    loaded = open_subject(subject, settings)
    prepared = prepare(loaded, chosen, settings, progress=part_of(report, 0.0, _PREPARING))
    trials = {}
    with loaded.blamed():
        for k, name in enumerate(prepared.motions):
            part = _share_of(report, f"uncertainty of {name}", k, len(prepared.motions))
            part(0.0)
            trials[name] = trial_dynamics(prepared, name, chosen, settings.seed, part)
        weight = weigh_motions({name: (found.dynamics, found.frames) for name, found in trials.items()})
        assert weight is not None  # a recording without a frame that counts is refused
        weight.check()
        inertial, told = _identify(prepared, trials, chosen) if chosen.identify else (None, ())
    report("done", 1.0)
    return DynamicsResults(
        prepared,
        chosen,
        settings,
        trials,
        weight,
        verdict_of(trials, weight),
        inertial,
        (*prepared.warnings, *told),
        time.perf_counter() - clock,
    )


def _share_of(report: Progress, what: str, number: int, count: int) -> Callable[[float], None]:
    """The progress of one recording as a share of the whole."""
    return lambda share: report(what, _PREPARING + (1.0 - _PREPARING) * (number + share) / count)


def _identify(
    prepared: Prepared, trials: Mapping[str, TrialDynamics], chosen: DynamicsSettings
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
    supported = np.any([trials[name].uncertainty.calibration_supported for name in fitted], axis=0)
    if not supported.any() and not chosen.despite_verdict:
        return None, (*notes, "inertia was not identified: the verdict is that it would fit noise")
    recordings = {name: ForceRecording(found.dynamics, found.frames) for name, found in trials.items()}
    result = identify_inertia(
        prepared.model,
        [recordings[name] for name in fitted],
        held_out=[recording for name, recording in recordings.items() if name not in fitted],
        supported=supported,
        settings=IdentificationSettings(
            mass_known=not chosen.free_mass,
            symmetric=not chosen.sides_apart,
            despite_verdict=chosen.despite_verdict,
        ),
    )
    return result, notes


def trial_dynamics(
    prepared: Prepared, name: str, chosen: DynamicsSettings, seed: int, progress: Callable[[float], None]
) -> TrialDynamics:
    """Inverse dynamics, residuals and their uncertainty of the recording of this stem."""
    motion, forces = prepared.motions[name], prepared.forces[name]
    found = inverse_dynamics(prepared.model, motion, forces.loads, cutoff_hz=chosen.cutoff_hz)
    frames = judged_frames(found, forces.contacts, chosen.cutoff_hz)
    residuals = evaluate_residuals(found, prepared.height_m, frames=frames)
    recording = Recording(prepared.model, motion, forces.loads, prepared.height_m, frames, chosen.cutoff_hz)
    uncertainty = propagate(
        recording, UncertaintySettings(samples=chosen.samples, seed=seed), progress=progress
    )
    said = _warn(forces, motion, find_trembling(found, prepared.model, frames))
    warnings = tuple(f"{name}: {warning}" for warning in said)
    return TrialDynamics(motion, forces, found, frames, residuals, uncertainty, warnings)


def _warn(forces: TrialForces, motion: Motion, shaking: list[str]) -> Iterator[str]:
    """What a person should know of a recording."""
    for repair in forces.repairs:
        if repair.what in _WARNED_OF:
            frames = f" ({repair.frames} frames)" if repair.frames else ""
            yield f"{repair.where}: {repair.detail}{frames}"
    still = [name for name in motion.coordinates if name not in motion.estimated]
    if still:
        yield f"no marker shows {few(still)}: they stand still, and what hangs on them moves as if stiff"
    if shaking:
        yield f"{few(shaking)} tremble faster than joints do: markers hardly determine them, nor the residual"


def verdict_of(trials: Mapping[str, TrialDynamics], weight: Weight) -> str:
    """Whether the mass is right, inertia can be calibrated, and the residuals keep the limits."""
    return " ".join([*weight.sentences, _calibration(trials), _gates(trials)])


def _calibration(trials: Mapping[str, TrialDynamics]) -> str:
    if len(trials) == 1:
        return next(iter(trials.values())).uncertainty.verdict
    able: dict[str, list[str]] = {}
    for name, found in trials.items():
        components = ", ".join(np.array(COMPONENTS)[found.uncertainty.calibration_supported])
        if components:
            able.setdefault(components, []).append(name)
    if not able:
        return (
            "None of these recordings can calibrate inertial parameters: in every component the "
            "measurement's own uncertainty explains all of the residual, and identification would fit noise."
        )
    by = "; ".join(f"{components} of {few(names)}" for components, names in able.items())
    return (
        f"Inertial parameters can be calibrated by {by}: there the residual stands above its uncertainty. "
        "Elsewhere the measurement's own uncertainty explains all of it."
    )


def _gates(trials: Mapping[str, TrialDynamics]) -> str:
    broken = {
        name: [gate.name for gate in found.residuals.gates if gate.source == HICKS and not gate.passed]
        for name, found in trials.items()
    }
    failing = [name for name, gates in broken.items() if gates]
    if not failing:
        return "The residuals keep the limits of Hicks et al. 2015."
    worst = max(failing, key=lambda name: len(broken[name]))
    return (
        f"The residuals break limits of Hicks et al. 2015 in {few(failing)} ({worst}: {few(broken[worst])})."
    )
