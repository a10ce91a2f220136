"""What another distribution may import: every name and where it stands."""

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

HOMES: dict[str, str]
__all__: list[str]
