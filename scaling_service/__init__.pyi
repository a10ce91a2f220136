"""The Python interface: every name and where it stands."""

from scaling_service.capabilities.cohort.run import batch as batch
from scaling_service.capabilities.discovery.options import DiscoverSettings as DiscoverSettings
from scaling_service.capabilities.discovery.run import discover as discover
from scaling_service.capabilities.discovery.saving import save_discovery as save_discovery
from scaling_service.capabilities.dynamics.inertia.identification import identify_inertia as identify_inertia
from scaling_service.capabilities.dynamics.run import dynamics as dynamics
from scaling_service.capabilities.dynamics.saving import save_dynamics as save_dynamics
from scaling_service.capabilities.dynamics.settings import DynamicsSettings as DynamicsSettings
from scaling_service.capabilities.intake.run import prove_folder as prove_folder
from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics as inverse_kinematics
from scaling_service.capabilities.motion.kinematic_error import kinematic_error as kinematic_error
from scaling_service.capabilities.motion.options import MotionOptions as MotionOptions
from scaling_service.capabilities.motion.result import Tracked as Tracked
from scaling_service.capabilities.motion.run import ik as ik
from scaling_service.capabilities.motion.saving import save_motions as save_motions
from scaling_service.capabilities.scaling.result import Results as Results
from scaling_service.capabilities.scaling.result import Scaling as Scaling
from scaling_service.capabilities.scaling.run import compare as compare
from scaling_service.capabilities.scaling.run import scale as scale
from scaling_service.capabilities.scaling.saving import save as save
from scaling_service.capabilities.shared.settings import CalibrationSettings as CalibrationSettings
from scaling_service.capabilities.shared.settings import Settings as Settings
from scaling_service.capabilities.subject.files import read_model as read_model
from scaling_service.capabilities.subject.reading import load_subject as load_subject
from scaling_service.core.errors import InputError as InputError
from scaling_service.files.recording import read_recording as read_recording
from scaling_service.model.subject import Subject as Subject
from scaling_service.recording.settings import ProcessingSettings as ProcessingSettings

HOMES: dict[str, str]
__all__: list[str]
