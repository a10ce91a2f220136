"""``study.json`` of the study of Futamure et al."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from scaling_service.documents import base
from scaling_service.studies import claims

Three = tuple[base.Rounded, base.Rounded, base.Rounded]


class WayEntry(base.Part):
    """One way of explaining one recording."""

    wrench_rmse: Three = Field(description="fx, N; fy, N; mz, N m, about the ankle or the feet's middle.")
    marker_rms_mm: float
    angle_rmse_deg: list[base.Rounded] = Field(
        description="Ankle, knee, hip, shoulder; empty where no truth is known."
    )


class RecordingEntry(base.Part):
    """One recording in three ways."""

    classical: WayEntry
    consistent: WayEntry
    predicted: WayEntry


class SquatterEntry(claims.PersonPart):
    """One virtual person."""

    fitted: RecordingEntry
    held_out: RecordingEntry
    inertia_distance: tuple[Three, Three] = Field(
        description="Masses, centres of mass, moments of inertia, in SDs of tables; before, after."
    )
    length_error_mm: tuple[Three, Three] = Field(description="Shank, thigh, trunk; before, after.")
    marker_rms_mm: dict[str, tuple[float, float]] = Field(description="Classical, consistent.")
    loops: int
    converged: bool
    seconds: float


class RealEntry(base.Part):
    """A real recording: its first part fitted, the rest held out."""

    name: str
    model: str
    start: str
    fitted: RecordingEntry
    held_out: RecordingEntry
    loops: int
    seconds: float


class FutamureDocument(claims.StudyDocument):
    """``study.json``."""

    study: Literal["futamure"] = "futamure"
    persons: list[SquatterEntry]
    recordings: list[RealEntry] = Field(description="Real ones, if given; claims leave them out.")

    @property
    def size(self) -> int:
        """How many virtual persons there are."""
        return len(self.persons)
