"""Inverse dynamics of a subject's recordings, from the subject file to results in memory."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from scaling_service.capabilities.dynamics.identify import identified
from scaling_service.capabilities.dynamics.inertia.result import InertialIdentification
from scaling_service.capabilities.dynamics.settings import PLAIN, UNSMOOTHED, DynamicsSettings
from scaling_service.capabilities.dynamics.start import Prepared, prepare
from scaling_service.capabilities.dynamics.trial import TrialDynamics, trial_dynamics
from scaling_service.capabilities.dynamics.verdict import verdict_of
from scaling_service.capabilities.subject.loading import blamed_on, recordings
from scaling_service.capabilities.subject.settings import Settings
from scaling_service.core.progress import Progress
from scaling_service.model.subject import Subject

_PREPARING = 0.3
"""Chosen: about the share of reading, scaling and inverse kinematics; the uncertainty takes the rest."""


@dataclass(frozen=True, slots=True, eq=False)
class DynamicsResults:
    """Dynamics of all of a subject's recordings that have forces.

    Parameters
    ----------
    prepared : Prepared
    chosen : DynamicsSettings
    settings : Settings
    trials : mapping
        By the stems of the trials' files.
    verdict : str
        In plain words: what the residuals say of the model.
    inertial : InertialIdentification, optional
        Where it was asked for and the verdict allows it.
    warnings : tuple of str
        What concerns all recordings.
    wall_s : float
    subject_file : Path, optional
    """

    prepared: Prepared
    chosen: DynamicsSettings
    settings: Settings
    trials: Mapping[str, TrialDynamics]
    verdict: str
    inertial: InertialIdentification | None = None
    warnings: tuple[str, ...] = ()
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
    report = progress or _silent
    file = None if isinstance(subject, Subject) else Path(subject)
    prepared = prepare(
        subject, chosen, settings, progress=lambda what, share: report(what, _PREPARING * share)
    )
    trials = {}
    with blamed_on(file), blamed_on(None, recordings(prepared.subject)):
        for k, name in enumerate(prepared.motions):
            part = _Part(report, f"uncertainty of {name}", k, len(prepared.motions))
            part(0.0)
            trials[name] = trial_dynamics(prepared, name, chosen, settings.seed, part)
        inertial, told = identified(prepared, trials, chosen) if chosen.identify else (None, ())
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


@dataclass(frozen=True, slots=True)
class _Part:
    """One recording's share of the whole."""

    report: Progress
    what: str
    number: int
    count: int

    def __call__(self, share: float) -> None:
        done = (self.number + share) / self.count
        self.report(self.what, _PREPARING + (1.0 - _PREPARING) * done)


def _silent(what: str, share: float) -> None:
    """No progress is shown."""
