"""Identification of a subject's inertia from its recordings with forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from scaling_service.capabilities.dynamics.inertia.evidence import ForceRecording
from scaling_service.capabilities.dynamics.inertia.identification import (
    IdentificationSettings,
    identify_inertia,
)
from scaling_service.capabilities.dynamics.inertia.result import InertialIdentification
from scaling_service.capabilities.dynamics.settings import DynamicsSettings
from scaling_service.capabilities.dynamics.start import Prepared
from scaling_service.capabilities.dynamics.trial import TrialDynamics


def identified(
    prepared: Prepared, trials: Mapping[str, TrialDynamics], chosen: DynamicsSettings
) -> tuple[InertialIdentification | None, tuple[str, ...]]:
    """Identify inertia from the calibration trials, and hold the evaluation trials out.

    Returns
    -------
    identification : InertialIdentification or None
        None where the verdict forbids it.
    notes : tuple of str

    Raises
    ------
    InputError
        No possible inertia fits.

    Notes
    -----
    A component of the wrench is used where the verdict supports it in one of the fitted trials. Where only
    evaluation trials have forces, the first of them is fitted.
    """
    fitted, notes = _fitted(prepared, trials)
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


def _fitted(prepared: Prepared, trials: Mapping[str, TrialDynamics]) -> tuple[Sequence[str], tuple[str, ...]]:
    calibration = [trial.name for trial in prepared.loaded.session.calibration if trial.name in trials]
    if calibration:
        return calibration, ()
    first = next(iter(trials))
    return [first], (f"no calibration trial has forces: inertia is identified from {first}",)
