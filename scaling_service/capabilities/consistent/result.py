"""What `consistent` finds: motion, geometry and inertia that markers and ground forces agree on."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from scaling_service.documents import base
from scaling_service.documents.results import Provenance

if TYPE_CHECKING:
    from scaling_service.capabilities.consistent import estimate
    from scaling_service.capabilities.consistent.recording import ConsistentRecording
    from scaling_service.capabilities.dynamics import start


class GroundWrench(base.Part):
    """RMS error of the wrench about the feet; a planar model has the sagittal three alone."""

    fx_N: float = Field(description="Forward.")
    fy_N: float = Field(description="Up.")
    mz_Nm: float = Field(description="About the axis to the right.")
    fz_N: float | None = None
    mx_Nm: float | None = None
    my_Nm: float | None = None


class WrenchErrors(base.Part):
    """The same recording explained in three ways."""

    classical: GroundWrench = Field(description="Inverse kinematics, filter, derivatives; the start's model.")
    consistent: GroundWrench = Field(description="Markers and forces followed together; the model found.")
    predicted: GroundWrench = Field(description="As classical, with the model found: from markers alone.")


class MarkerErrors(base.Part):
    """RMS distance of measured and model markers, mm."""

    classical: float
    consistent: float
    predicted: float


class ConsistentTrial(base.Part):
    """One recording."""

    held_out: bool = Field(description="Not used to find geometry and inertia.")
    forces_from: str = Field(description="File that the forces came from.")
    frames: int = Field(description="Frames whose forces are all known.")
    ground_wrench_rmse: WrenchErrors
    marker_rms_mm: MarkerErrors
    weight: float = Field(
        description="Of the wrench against the markers where both goals are attained alike."
    )


class InertialEntry(base.Part):
    """One inertial parameter before and after."""

    segment: str
    quantity: str
    before: float
    after: float
    sd: float
    moved: float = Field(description="Change in standard deviations of the prior.")
    identifiable: bool


class LoopEntry(base.Part):
    """Errors over the fitted recordings after one loop."""

    marker_rms_mm: float
    ground_wrench_rmse: GroundWrench


class ConsistentDocument(Provenance):
    """``consistent.json``."""

    kind: Literal["consistent"] = "consistent"
    headline: str = Field(default="", description="What was gained at the forces, in one sentence.")
    tone: base.Tone = Field(default="plain", description="Whether the headline is good news.")
    start: str = Field(description="Method that scaled the model; none: as given.")
    inertia: str = Field(description="Table of the prior; model: the model's own.")
    mass_kg: float = Field(description="That the plates bear.")
    trials: dict[str, ConsistentTrial]
    inertial: list[InertialEntry] = Field(description="SI units; tensors about the centre of mass.")
    lengths_mm: dict[str, float] = Field(description="Of the model found.")
    lengths_before_mm: dict[str, float]
    length_factors: dict[str, float] = Field(description="Segment to its length over that of the start.")
    outer_iterations: int
    converged: bool
    history: list[LoopEntry]
    warnings: list[str]
    files: list[str]
    wall_s: float


class WrenchTrial(base.Part):
    """The ground wrench over one recording, as measured and as motions explain it."""

    start_s: float
    rate_hz: float
    components: list[bool] = Field(description="Which of force x, y, z and moment x, y, z count.")
    wrenches: dict[str, base.ArrayEntry] = Field(
        description="'measured' and each way, frames, 6: N and N m, in ground axes."
    )


class WrenchScene(base.Scene):
    """Ground wrenches over time."""

    trials: dict[str, WrenchTrial]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ConsistentResults:
    """What the loop made of a subject."""

    prepared: start.Prepared  # its model has the mass that the plates bear
    recordings: tuple[ConsistentRecording, ...]  # fitted ones, then held-out ones, in the order of ``result``
    result: estimate.ConsistentResult
    document: ConsistentDocument  # ``consistent.json``

    @property
    def tracked(self) -> abc.Iterator[tuple[ConsistentRecording, dict[str, estimate.TrackedRecording]]]:
        """Every recording, and how it is explained in each of the three ways."""
        for k, recording in enumerate(self.recordings):
            yield recording, {way: tracked[k] for way, tracked in self.result.ways.items()}
