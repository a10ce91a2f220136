"""Inverse dynamics of a subject's recordings, from the subject file to results in memory."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scaling_service.capabilities.dynamics.inertia.evidence import ForceRecording
from scaling_service.capabilities.dynamics.inertia.identification import (
    IdentificationSettings,
    identify_inertia,
)
from scaling_service.capabilities.dynamics.inertia.result import InertialIdentification
from scaling_service.capabilities.dynamics.settings import PLAIN, UNSMOOTHED, DynamicsSettings
from scaling_service.capabilities.dynamics.start import Prepared, prepare
from scaling_service.capabilities.dynamics.trial import TrialDynamics, trial_dynamics, verdict_of
from scaling_service.capabilities.scaling.run import Progress
from scaling_service.capabilities.subject.loading import blamed_on, recordings
from scaling_service.capabilities.subject.settings import Settings
from scaling_service.model.subject import Subject

_PREPARING = 0.3
"""Chosen: about the share of reading, scaling and inverse kinematics; the uncertainty takes the rest."""


@dataclass(frozen=True, slots=True, eq=False)
class DynamicsResults:
    """Dynamics of all of a subject's recordings that have forces."""

    prepared: Prepared
    chosen: DynamicsSettings
    settings: Settings
    trials: Mapping[str, TrialDynamics]  # by the stems of the trials' files
    verdict: str  # in plain words: what the residuals say of the model
    inertial: InertialIdentification | None = None  # where it was asked for and the verdict allows it
    warnings: tuple[str, ...] = ()  # what concerns all recordings
    wall_s: float = 0.0
    subject_file: Path | None = None


def dynamics(
    subject: Subject | str | Path,
    chosen: DynamicsSettings = PLAIN,
    settings: Settings = UNSMOOTHED,
    *,
    progress: Progress | None = None,
) -> DynamicsResults:
    """Joint forces and residuals of a subject's recordings.

    Parameters
    ----------
    subject : Subject or path of a subject file
    chosen : DynamicsSettings
    settings : Settings
    progress : callable, optional

    Raises
    ------
    InputError
        Whatever in the subject file, the model, the recordings or their forces cannot be used.
    """
    clock = time.perf_counter()
    report = progress or (lambda _what, _share: None)
    file = None if isinstance(subject, Subject) else Path(subject)
    prepared = prepare(
        subject, chosen, settings, progress=lambda what, share: report(what, _PREPARING * share)
    )
    trials = {}
    with blamed_on(file), blamed_on(None, recordings(prepared.subject)):
        for k, name in enumerate(prepared.motions):
            part = _share_of(report, f"uncertainty of {name}", k, len(prepared.motions))
            part(0.0)
            trials[name] = trial_dynamics(prepared, name, chosen, settings.seed, part)
        inertial, told = _identify(prepared, trials, chosen) if chosen.identify else (None, ())
    report("done", 1.0)
    return DynamicsResults(
        prepared,
        chosen,
        settings,
        trials,
        verdict_of(trials),
        inertial,
        (*prepared.warnings, *told),
        time.perf_counter() - clock,
        file,
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
            mass_known=chosen.mass_known, symmetric=chosen.symmetric, despite_verdict=chosen.despite_verdict
        ),
    )
    return result, notes
