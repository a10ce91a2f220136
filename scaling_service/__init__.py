"""Scales multibody body models to persons from motion capture, and says how far to trust the result.

What is named in ``__all__`` is the Python interface; it is loaded when it is first used, so that the
worker processes of single modules stay light.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scaling_service.calibration.inertial import identify_inertia
    from scaling_service.calibration.settings import CalibrationSettings
    from scaling_service.capabilities.motion.options import MotionOptions
    from scaling_service.core.errors import InputError
    from scaling_service.estimation.inverse_kinematics import inverse_kinematics
    from scaling_service.evaluation.kinematic_error import kinematic_error
    from scaling_service.formats.recording import read_recording
    from scaling_service.jobs.batch import batch
    from scaling_service.jobs.discover import discover
    from scaling_service.jobs.discover_saving import save_discovery
    from scaling_service.jobs.discover_settings import DiscoverSettings
    from scaling_service.jobs.dynamics import dynamics
    from scaling_service.jobs.dynamics_saving import save_dynamics
    from scaling_service.jobs.dynamics_settings import DynamicsSettings
    from scaling_service.jobs.loading import read_model
    from scaling_service.jobs.proof_saving import prove_folder
    from scaling_service.jobs.saving import save
    from scaling_service.jobs.settings import Settings
    from scaling_service.jobs.subjects import load_subject
    from scaling_service.jobs.tasks import Results, Scaling, compare, scale
    from scaling_service.jobs.tracking import Tracked, ik
    from scaling_service.jobs.tracking_saving import save_motions
    from scaling_service.models.subject import Subject
    from scaling_service.processing.pipeline import ProcessingSettings

__all__ = [
    "CalibrationSettings",
    "DiscoverSettings",
    "DynamicsSettings",
    "InputError",
    "MotionOptions",
    "ProcessingSettings",
    "Results",
    "Scaling",
    "Settings",
    "Subject",
    "Tracked",
    "batch",
    "compare",
    "discover",
    "dynamics",
    "identify_inertia",
    "ik",
    "inverse_kinematics",
    "kinematic_error",
    "load_subject",
    "prove_folder",
    "read_model",
    "read_recording",
    "save",
    "save_discovery",
    "save_dynamics",
    "save_motions",
    "scale",
]

_HOMES = {
    "CalibrationSettings": "calibration.settings",
    "DiscoverSettings": "jobs.discover_settings",
    "DynamicsSettings": "jobs.dynamics_settings",
    "InputError": "core.errors",
    "MotionOptions": "capabilities.motion.options",
    "ProcessingSettings": "processing.pipeline",
    "Results": "jobs.tasks",
    "Scaling": "jobs.tasks",
    "Settings": "jobs.settings",
    "Subject": "models.subject",
    "Tracked": "jobs.tracking",
    "batch": "jobs.batch",
    "compare": "jobs.tasks",
    "discover": "jobs.discover",
    "dynamics": "jobs.dynamics",
    "identify_inertia": "calibration.inertial",
    "ik": "jobs.tracking",
    "inverse_kinematics": "estimation.inverse_kinematics",
    "kinematic_error": "evaluation.kinematic_error",
    "load_subject": "jobs.subjects",
    "prove_folder": "jobs.proof_saving",
    "read_model": "jobs.loading",
    "read_recording": "formats.recording",
    "save": "jobs.saving",
    "save_discovery": "jobs.discover_saving",
    "save_dynamics": "jobs.dynamics_saving",
    "save_motions": "jobs.tracking_saving",
    "scale": "jobs.tasks",
}


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'scaling_service' has no attribute '{name}'")
    return getattr(import_module(f"scaling_service.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
