"""Dynamics of one recording, and what a person should know of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.dynamics.forces import TrialForces
from scaling_service.capabilities.dynamics.inverse_dynamics import (
    InverseDynamics,
    check_weight,
    inverse_dynamics,
    judged_frames,
    trembling,
)
from scaling_service.capabilities.dynamics.residuals import COMPONENTS, HICKS, Residuals, evaluate_residuals
from scaling_service.capabilities.dynamics.settings import DynamicsSettings
from scaling_service.capabilities.dynamics.start import Prepared
from scaling_service.capabilities.dynamics.uncertainty.total import (
    Recording,
    UncertaintySettings,
    WrenchUncertainty,
    propagate,
)
from scaling_service.core.text import few
from scaling_service.model.results import Motion

_TOLD = ("two_feet", "two_plates", "in_swing", "no_plate", "no_foot", "force_sign", "not_recorded")
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


def trial_dynamics(
    prepared: Prepared, name: str, chosen: DynamicsSettings, seed: int, progress: Callable[[float], None]
) -> TrialDynamics:
    """Inverse dynamics, residuals and their uncertainty of one recording.

    ``name``: the trial's stem. ``progress``: called with the share that is done. Raises InputError: no frame
    has both a motion and all its forces, or the plates bear quite another mass.
    """
    motion, forces = prepared.motions[name], prepared.forces[name]
    found = inverse_dynamics(prepared.model, motion, forces.loads, cutoff_hz=chosen.cutoff_hz)
    frames = judged_frames(found, forces.contacts, chosen.cutoff_hz)
    notes = check_weight(found, frames=frames)
    residuals = evaluate_residuals(found, prepared.height_m, frames=frames)
    recording = Recording(prepared.model, motion, forces.loads, prepared.height_m, frames, chosen.cutoff_hz)
    uncertainty = propagate(
        recording, UncertaintySettings(samples=chosen.samples, seed=seed), progress=progress
    )
    told = _told(forces, motion, trembling(found, prepared.model, frames))
    warnings = tuple(f"{name}: {said}" for said in (*notes, *told))
    return TrialDynamics(motion, forces, found, frames, residuals, uncertainty, warnings)


def _told(forces: TrialForces, motion: Motion, shaking: list[str]) -> Iterator[str]:
    """What a person should know of a recording."""
    for repair in forces.repairs:
        if repair.what in _TOLD:
            frames = f" ({repair.frames} frames)" if repair.frames else ""
            yield f"{repair.where}: {repair.detail}{frames}"
    still = [name for name in motion.coordinates if name not in motion.estimated]
    if still:
        yield f"no marker shows {few(still)}: they stand still, and what hangs on them moves as if stiff"
    if shaking:
        yield f"{few(shaking)} tremble faster than joints do: markers hardly determine them, nor the residual"


def verdict_of(trials: Mapping[str, TrialDynamics]) -> str:
    """Whether these recordings can calibrate inertia, and whether the residuals keep the limits."""
    return f"{_calibration(trials)} {_gates(trials)}"


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
