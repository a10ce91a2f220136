"""What another distribution may import to add an effect, a method or a format of recordings.

The names of ``__all__`` stay from one minor version to the next; nothing else inside is promised. They are
loaded when they are first used: a reader of files does not load the search for effects.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scaling_service.capabilities.discovery.effects.catalogue import Effect as Effect
    from scaling_service.capabilities.discovery.laws.candidates import Candidate as Candidate
    from scaling_service.capabilities.discovery.laws.candidates import Column as Column
    from scaling_service.capabilities.discovery.laws.candidates import Part as Part
    from scaling_service.capabilities.discovery.laws.loads import Inertial as Inertial
    from scaling_service.capabilities.discovery.laws.loads import Plate as Plate
    from scaling_service.capabilities.discovery.laws.loads import PlateFault as PlateFault
    from scaling_service.capabilities.discovery.laws.profiles import Following as Following
    from scaling_service.capabilities.discovery.laws.scene import Scene as Scene
    from scaling_service.capabilities.discovery.laws.spots import JointSpot as JointSpot
    from scaling_service.capabilities.discovery.laws.spots import MarkerSpot as MarkerSpot
    from scaling_service.capabilities.discovery.laws.spots import SizeSpot as SizeSpot
    from scaling_service.capabilities.discovery.observations.wrench import Load as Load
    from scaling_service.capabilities.discovery.observations.wrench import WrenchFit as WrenchFit
    from scaling_service.capabilities.scaling.methods.fitting import Progress as Progress
    from scaling_service.capabilities.scaling.methods.method import Method as Method
    from scaling_service.capabilities.scaling.methods.table import calibrate as calibrate
    from scaling_service.capabilities.shared.settings import CalibrationSettings as CalibrationSettings
    from scaling_service.core.arrays import Array as Array
    from scaling_service.core.errors import FileUnreadable as FileUnreadable
    from scaling_service.core.errors import InputError as InputError
    from scaling_service.core.errors import TrialUnusable as TrialUnusable
    from scaling_service.files.recording import Recording as Recording
    from scaling_service.model.body import BodyModel as BodyModel
    from scaling_service.model.forces import PlateRecording as PlateRecording
    from scaling_service.model.forces import RawPlate as RawPlate
    from scaling_service.model.results import Calibration as Calibration
    from scaling_service.model.subject import Session as Session
    from scaling_service.model.subject import Subject as Subject
    from scaling_service.model.trial import MeasuredSizes as MeasuredSizes
    from scaling_service.model.trial import Repair as Repair
    from scaling_service.model.trial import Trial as Trial

_LAWS = "capabilities.discovery.laws"

HOMES = {  # name: its module, under this package
    "Array": "core.arrays",
    "BodyModel": "model.body",
    "FileUnreadable": "core.errors",
    "InputError": "core.errors",
    "Repair": "model.trial",
    "Session": "model.subject",
    "Subject": "model.subject",
    "Trial": "model.trial",
    "TrialUnusable": "core.errors",
    # formats
    "MeasuredSizes": "model.trial",
    "PlateRecording": "model.forces",
    "RawPlate": "model.forces",
    "Recording": "files.recording",
    # methods
    "Calibration": "model.results",
    "CalibrationSettings": "capabilities.shared.settings",
    "Method": "capabilities.scaling.methods.method",
    "Progress": "capabilities.scaling.methods.fitting",
    "calibrate": "capabilities.scaling.methods.table",
    # effects
    "Candidate": f"{_LAWS}.candidates",
    "Column": f"{_LAWS}.candidates",
    "Effect": "capabilities.discovery.effects.catalogue",
    "Following": f"{_LAWS}.profiles",
    "Inertial": f"{_LAWS}.loads",
    "JointSpot": f"{_LAWS}.spots",
    "Load": "capabilities.discovery.observations.wrench",
    "MarkerSpot": f"{_LAWS}.spots",
    "Part": f"{_LAWS}.candidates",
    "Plate": f"{_LAWS}.loads",
    "PlateFault": f"{_LAWS}.loads",
    "Scene": f"{_LAWS}.scene",
    "SizeSpot": f"{_LAWS}.spots",
    "WrenchFit": "capabilities.discovery.observations.wrench",
}

__all__ = list(HOMES)


def __getattr__(name: str) -> object:
    if name not in HOMES:
        raise AttributeError(f"module 'scaling_service.plugins' has no attribute '{name}'")
    return getattr(import_module(f"scaling_service.{HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
