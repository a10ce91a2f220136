"""What residuals and their uncertainty say of a model, in words."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from scaling_service.capabilities.dynamics.residuals import COMPONENTS
from scaling_service.capabilities.dynamics.trial import TrialDynamics
from scaling_service.core.text import few

_SOURCE = "Hicks 2015"


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
        name: [gate.name for gate in found.residuals.gates if gate.source == _SOURCE and not gate.passed]
        for name, found in trials.items()
    }
    failing = [name for name, gates in broken.items() if gates]
    if not failing:
        return "The residuals keep the limits of Hicks et al. 2015."
    worst = max(failing, key=lambda name: len(broken[name]))
    return (
        f"The residuals break limits of Hicks et al. 2015 in {few(failing)} ({worst}: {few(broken[worst])})."
    )
