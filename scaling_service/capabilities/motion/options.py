"""What can be chosen for the motion of recordings."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from scaling_service.capabilities.shared.flags import read_labels
from scaling_service.core import options


class MotionOptions(options.Options):
    """How recordings are read and followed.

    Examples
    --------
    >>> import scaling_service as ss
    >>> ss.MotionOptions(smooth_hz=0.0).resolved()["smooth_hz"]
    0.0
    """

    poses: Annotated[bool, options.Flag(name="--poses")] = Field(
        default=False,
        description="Whether to write where every segment is, as OpenSim's BodyKinematics does.",
    )
    angles: Annotated[bool, options.Flag(name="--angles")] = Field(
        default=False,
        description="Whether to write the conventional gait model's angles and their standard deviations.",
    )
    markers: Annotated[
        dict[str, str],
        options.Flag(
            name="--marker",
            metavar="MARKER=LABEL",
            kind=list[str] | None,
            read=read_labels,
            help="A model marker and its label, where known aliases differ; may be given again.",
        ),
    ] = Field(
        default={},
        description="Model marker to label in the recordings, where name and known aliases differ.",
    )
    bone_pins: Annotated[bool, options.Flag(name="--bone-pins")] = Field(
        default=False,
        description="Whether markers are fixed to the bone: standard deviations then leave skin out.",
    )
    up: Annotated[str | None, options.Flag(metavar="AXIS")] = Field(
        default=None,
        description="Laboratory axis that points up, such as +z; found unless given.",
    )
    forward: Annotated[str | None, options.Flag(metavar="AXIS")] = Field(
        default=None,
        description="Laboratory axis to turn to x, such as -x; the heading is kept unless given.",
    )
    smooth_hz: Annotated[float | None, options.Flag(metavar="HZ")] = Field(
        default=None,
        ge=0.0,
        description="Cutoff of the low pass for markers; 10 unless given, where the rate allows; 0: none.",
    )
