"""``study.json`` of Futamure et al. done again."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from scaling_service.studies.document import STUDY_SCHEMA_VERSION, ClaimEntry

Three = tuple[float, float, float]
"""fx, N; fy, N; mz, N m, about the ankle or the middle of the feet."""


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class WayEntry(_Part):
    """One way of explaining one recording."""

    wrench_rmse: Three
    marker_rms_mm: float
    angle_rmse_deg: list[float] = Field(
        description="Ankle, knee, hip, shoulder; empty where no truth is known."
    )


class RecordingEntry(_Part):
    """One recording in three ways."""

    classical: WayEntry
    consistent: WayEntry
    predicted: WayEntry


class SquatterEntry(_Part):
    """One virtual person."""

    name: str
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


class RealEntry(_Part):
    """A real recording: its first part fitted, the rest held out."""

    name: str
    model: str
    start: str
    fitted: RecordingEntry
    held_out: RecordingEntry
    loops: int
    seconds: float


class FutamureDocument(_Part):
    """``study.json``."""

    schema_version: int = STUDY_SCHEMA_VERSION
    kind: Literal["study"] = "study"
    study: Literal["futamure"] = "futamure"
    source: str
    code_version: str
    settings: dict[str, Any]
    seed: int
    persons: list[SquatterEntry]
    recordings: list[RealEntry] = Field(description="Real ones, if given; claims leave them out.")
    claims: list[ClaimEntry]
    notes: list[str] = Field(description="How this study is not the paper's.")
    wall_s: float
