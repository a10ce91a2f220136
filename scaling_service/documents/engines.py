"""What becomes of muscles in another engine: ``model_muscles.json``."""

from __future__ import annotations

from pydantic import Field

from scaling_service.documents.base import Part


class EngineMuscle(Part):
    """One muscle beside OpenSim's, over every coordinate's range."""

    muscle: str
    wraps: bool = Field(description="Whether it slides over a surface.")
    length_mm: float = Field(description="Largest difference of its length with the tendon.")
    length_at: str = Field(description="The coordinate that was moved there.")
    length_at_deg: float
    moment_arm_mm: float = Field(description="Largest difference of its moment arms.")
    moment_arm_at: str
    moment_arm_at_deg: float
    within: bool = Field(description="Whether both are within what is asked.")
    causes: list[str] = Field(description="Of what is not within, as far as they are known.")


class EngineMuscleDocument(Part):
    """How near another engine's muscles are to OpenSim's."""

    engine: str
    reference: str | None = Field(description="What it is held against; null if OpenSim is not there.")
    coordinates: list[str] = Field(description="Those moved over their range, one at a time.")
    steps: int = Field(description="Equal steps of each range.")
    asked_length_mm: float
    asked_wrapping_length_mm: float
    asked_moment_arm_mm: float
    share_lengths_within: float | None
    share_moment_arms_within: float | None
    share_within: float | None = Field(description="Of muscles, with both within what is asked.")
    muscles: list[EngineMuscle] = Field(description="The worst first.")
    summary: list[str] = Field(description="In words, the worst named.")
    changed: list[str] = Field(description="What the engine does not hold as OpenSim does.")
