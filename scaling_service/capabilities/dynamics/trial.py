"""Dynamics of one recording, and what a person should know of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.dynamics.forces import TrialForces
from scaling_service.capabilities.dynamics.frames import judged_frames, trembling
from scaling_service.capabilities.dynamics.inverse_dynamics import (
    InverseDynamics,
    check_weight,
    inverse_dynamics,
)
from scaling_service.capabilities.dynamics.residuals import Residuals, evaluate_residuals
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
    """One recording's dynamics.

    Parameters
    ----------
    motion : Motion
        As the markers have it, not filtered.
    forces : TrialForces
    dynamics : InverseDynamics
    frames : ndarray of bool, shape (n,)
        Those that count; see ``judged_frames``.
    residuals : Residuals
        Over these frames.
    uncertainty : WrenchUncertainty
        Of the residual, over the same frames.
    warnings : tuple of str
        Plain sentences.
    """

    motion: Motion
    forces: TrialForces
    dynamics: InverseDynamics
    frames: NDArray[np.bool_]
    residuals: Residuals
    uncertainty: WrenchUncertainty
    warnings: tuple[str, ...] = ()


def trial_dynamics(
    prepared: Prepared, name: str, chosen: DynamicsSettings, seed: int, progress: Callable[[float], None]
) -> TrialDynamics:
    """Inverse dynamics, residuals and their uncertainty of one recording.

    Parameters
    ----------
    prepared : Prepared
    name : str
        The trial's stem.
    chosen : DynamicsSettings
    seed : int
    progress : callable
        Called with the share that is done.

    Raises
    ------
    InputError
        No frame has both a motion and all its forces, or the plates bear quite another mass.
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
    rotations = tuple(c.name for c in prepared.model.coordinates if c.kind == "rotation")
    told = (
        *_of_repairs(forces),
        *notes,
        *_unobserved(motion),
        *_trembling(trembling(found, rotations, frames)),
    )
    return TrialDynamics(
        motion,
        forces,
        found,
        frames,
        residuals,
        uncertainty,
        tuple(f"{name}: {said}" for said in told),
    )


def _of_repairs(forces: TrialForces) -> list[str]:
    return [
        f"{repair.where}: {repair.detail}" + (f" ({repair.frames} frames)" if repair.frames else "")
        for repair in forces.repairs
        if repair.what in _TOLD
    ]


def _unobserved(motion: Motion) -> list[str]:
    still = [name for name in motion.coordinates if name not in motion.estimated]
    if not still:
        return []
    return [f"no marker shows {few(still)}: they stand still, and what hangs on them moves as if stiff"]


def _trembling(names: list[str]) -> list[str]:
    if not names:
        return []
    return [f"{few(names)} tremble faster than joints do: markers hardly determine them, nor the residual"]
