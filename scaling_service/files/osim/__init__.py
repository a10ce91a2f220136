"""OpenSim models and set-up files; models in and out through the opensim library in its own process."""

from scaling_service.files.osim.models import read_osim, render_osim, replace_text, write_osim
from scaling_service.files.osim.muscles import (
    Attachment,
    MuscleGeometry,
    Wrap,
    measure_muscles,
    move_attachments,
    read_attachments,
)
from scaling_service.files.osim.setups import read_scale_setup

__all__ = [
    "Attachment",
    "MuscleGeometry",
    "Wrap",
    "measure_muscles",
    "move_attachments",
    "read_attachments",
    "read_osim",
    "read_scale_setup",
    "render_osim",
    "replace_text",
    "write_osim",
]
