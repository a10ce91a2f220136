"""OpenSim models and set-up files; models in and out through the opensim library in its own process."""

from scaling_service.files.osim.models import read_osim, write_osim
from scaling_service.files.osim.setups import read_scale_setup

__all__ = ["read_osim", "read_scale_setup", "write_osim"]
