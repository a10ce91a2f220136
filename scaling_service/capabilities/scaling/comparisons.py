"""Views of a comparison of methods: errors, lengths, angles; units in the names."""

from __future__ import annotations

from pydantic import Field

from scaling_service.documents.base import Part
from scaling_service.documents.results import JointCentre, Provenance, TrialError


class KinematicErrorComparison(Provenance):
    """How closely each method's model follows the markers."""

    kinematic_error_mm: dict[str, dict[str, TrialError]] = Field(description="Method to trial to error.")
    fitted_mean_mm: dict[str, float | None] = Field(description="Method to the mean over calibration trials.")
    held_out_mean_mm: dict[str, float | None] = Field(
        description="Method to the mean over evaluation trials."
    )
    warnings: list[str]


class SegmentLengthComparison(Provenance):
    """The sizes of the methods' models."""

    segment_lengths_mm: dict[str, dict[str, float]] = Field(description="Method to segment to length.")
    joint_centres_mm: dict[str, dict[str, JointCentre]] = Field(description="Method to joint to centre.")
    reference: str = Field(
        description="EB, whose lengths come from images, where it was done; else the first."
    )
    difference_mm: dict[str, dict[str, float]] = Field(
        description="Every other method to segment to its length minus the reference's."
    )
    warnings: list[str]


class AngleDifference(Part):
    """Two methods' angle over the frames in which both know it, degrees; null where there are none."""

    methods: tuple[str, str]
    frames: int
    rms_deg: float | None
    mean_deg: float | None = Field(description="First minus second.")
    largest_deg: float | None


class AngleEntry(Part):
    """A joint angle in one recording."""

    mean_deg: dict[str, float | None] = Field(description="Method to the mean over frames.")
    range_deg: dict[str, float | None] = Field(description="Method to largest minus smallest.")
    pairs: list[AngleDifference]


class CycleEntry(Part):
    """A joint angle over the gait cycle, 0 to 100 %."""

    cycles: int
    mean_deg: dict[str, list[float]]
    sd_deg: dict[str, list[float]]
    p: float | None = Field(description="Of an analysis of variance along the curve; null: not tested.")
    can_decide: bool = Field(description="False where there are too few cycles for 5 %.")
    differ_percent: list[tuple[float, float]] = Field(description="Stretches in which the methods differ.")


class GaitEntry(Part):
    """Joint angles over the gait cycles of this person."""

    trials: list[str]
    held_out: bool = Field(description="Whether none of these trials was fitted.")
    reason: str = Field(description="Why there are no cycles; empty where there are.")
    angles: dict[str, CycleEntry]


class JointAngleComparison(Provenance):
    """The joint angles that the methods' models give in the same recordings."""

    joint_angles: dict[str, dict[str, AngleEntry]] = Field(description="Trial to joint angle.")
    gait: GaitEntry
    warnings: list[str]
