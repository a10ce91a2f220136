"""What can be chosen; command line, HTTP body and provenance all come from here."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field


class MotionOptions(BaseModel):
    """How recordings are read and followed.

    Examples
    --------
    >>> MotionOptions(smooth_hz=0.0).resolved()["smooth_hz"]
    0.0
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    markers: dict[str, str] = Field(
        default={},
        description="Model marker to label in the recordings, where name and known aliases differ.",
    )
    up: str | None = Field(
        default=None,
        description="Laboratory axis that points up, such as +z; unless given, found from markers.",
    )
    forward: str | None = Field(
        default=None, description="Laboratory axis that the person faces, such as -x; found unless given."
    )
    smooth_hz: float | None = Field(
        default=None,
        ge=0.0,
        description="Smooth markers by a Butterworth filter with this cutoff, not by the moving average that "
        "scaling takes; 0: not at all.",
    )
    poses: bool = Field(
        default=False,
        description="Whether to write where every segment is, as OpenSim's BodyKinematics does.",
    )

    def resolved(self) -> dict[str, Any]:
        """All options with their defaults, for a document."""
        return self.model_dump()
