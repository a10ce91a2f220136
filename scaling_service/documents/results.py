"""What the program writes: the JSON documents of results, units in the names."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from scaling_service.documents import base

SCHEMA_VERSION = 1
"""Raised when a reader of an older document would misread a newer one; new keys do not raise it."""


class TrialError(base.Part):
    """Distances between measured and model markers over one trial, mm."""

    role: Literal["calibration", "evaluation"] = Field(description="Evaluation trials were not used to fit.")
    mean: base.Rounded = Field(description="Over frames and markers.")
    sd: base.Rounded = Field(description="Over frames, of each frame's mean.")
    rms: base.Rounded
    max: base.Rounded
    anatomical_mean: base.Known = Field(description="Over markers on bony landmarks; null if none.")
    tracking_mean: base.Known = Field(description="Over markers on soft tissue; null if none.")
    frames: int
    per_marker: dict[str, base.Rounded] = Field(description="Marker to mean distance.")


class JointCentre(base.Part):
    """Where a joint turns, in the frame of its proximal segment, mm."""

    frame: str
    xyz: tuple[base.Rounded, base.Rounded, base.Rounded]
    sd_mm: tuple[base.Rounded, base.Rounded, base.Rounded] | None = Field(
        default=None, description="Standard deviation along each axis; null where it is not known."
    )


class LengthEstimate(base.Part):
    """How well a length between joint centres is known, and what decides it; the shares add up to one."""

    sd_mm: base.Rounded = Field(description="Standard deviation.")
    measured: base.Rounded = Field(description="Share of the segment's own distances.")
    others: base.Rounded = Field(description="Share of other segments' distances.")
    expected: base.Rounded = Field(
        description="Share of what persons of this stature, mass and sex are like."
    )


class KneeAxis(base.Part):
    """Turns of a knee's axis about x and y of the thigh, degrees."""

    x: base.Rounded
    y: base.Rounded


class FittedParameter(base.Part):
    """A number that was fitted, in ``unit``."""

    name: str
    value: float
    unit: Literal["m", "rad", "1"]
    sd: float | None = Field(
        description="Standard deviation; null where a method holds something fixed and cannot know it."
    )
    at_bound: bool
    identifiable: bool = Field(description="False where the recordings say no more than the bounds do.")


class WallTime(base.Part):
    """Seconds."""

    calibration: base.Rounded
    inverse_kinematics: base.Rounded


class ClinicalCycle(base.Part):
    """One gait cycle, from contact to contact of the same foot."""

    trial: str
    start_s: base.Rounded
    end_s: base.Rounded


class ClinicalCurve(base.Part):
    """An angle over the gait cycle at 0, 2, … 100 %."""

    mean_deg: list[float]
    sd_deg: list[float] | None = Field(description="Between cycles; null of a single one.")
    n_cycles: int


class ClinicalSide(base.Part):
    """One leg."""

    cycles: list[ClinicalCycle]
    curves: dict[str, ClinicalCurve]
    gvs_deg: dict[str, float] = Field(
        description="Gait Variable Scores, the Movement Analysis Profile (Baker 2009)."
    )
    gps_deg: float | None = Field(description="Gait Profile Score; null where one of nine angles is missing.")


class ClinicalDocument(base.Part):
    """Conventional angles of one model: curves, profile and score against a reference population."""

    reference: str
    population: str
    sides: dict[Literal["r", "l"], ClinicalSide]
    gps_deg: float | None = Field(description="Of both sides, the pelvis counted once (as on the left).")
    reference_gvs_deg: dict[str, float] = Field(
        description="RMS distance of the reference's own members from its mean."
    )
    reference_gps_deg: float = Field(description="The same over all nine angles.")
    held_out: bool = Field(description="Whether the cycles are from trials that were not fitted.")
    left_out: list[str] = Field(description="Angles that are not given, and why.")
    doubtful: list[str] = Field(description="Angles that are given but rest on little, and why.")
    reason: str = Field(description="Why there is no gait cycle; empty where there is one.")


SegmentSource = Literal["bone", "bone of the other leg", "movement", "markers", "persons alike"]


class MethodResult(base.Part):
    """One method's model and how well it follows the recordings."""

    method: str
    kinematic_error_mm: dict[str, TrialError]
    fitted_mean_mm: base.Known = Field(
        default=None, description="Mean kinematic error of the calibration trials, each counting once."
    )
    held_out_mean_mm: base.Known = Field(
        default=None, description="Of the evaluation trials; null where none was held out."
    )
    held_out_ratio: base.Known = Field(default=None, description="Held out over fitted; null without both.")
    segment_lengths_mm: dict[str, base.Rounded]
    length_estimates: dict[str, LengthEstimate] = Field(
        default={},
        description="Of lengths that distances and anthropometry gave; fitted ones have parameters.",
    )
    segment_sources: dict[str, SegmentSource] = Field(
        default={},
        description="What sized each segment: its own bone, the other leg's, markers or persons alike.",
    )
    joint_centres_mm: dict[str, JointCentre]
    knee_axis_deg: dict[str, KneeAxis]
    marker_shift_mm: dict[str, base.Rounded]
    scale_factors: dict[str, tuple[float, float, float]]
    parameters: list[FittedParameter]
    cumulative_error_mm2: float | None = Field(
        description="Sum of squared distances over the frames fitted (Puchaud 2019, eq. 1), or null."
    )
    iterations: int
    wall_s: WallTime
    clinical: ClinicalDocument | None = Field(
        default=None, description="Joint angles in a gait laboratory's definitions, their profile and score."
    )
    warnings: list[str]
    files: list[str] = Field(description="What was written beside this document.")


class RepairNote(base.Part):
    """One thing that was changed or decided while reading or processing a recording."""

    what: str
    where: str
    detail: str
    frames: int


class Provenance(base.Part):
    """What is needed to get the same result again."""

    schema_version: int = SCHEMA_VERSION
    code_version: str
    subject: str
    settings: dict[str, Any] = Field(description="As resolved, defaults included.")
    input_hashes: dict[str, str] = Field(description="File to SHA-256.")
    seed: int
    markers_used: dict[str, list[str]] = Field(description="Model marker to the labels taken for it.")
    repairs: dict[str, list[RepairNote]] = Field(description="Trial to what was done to it.")
    sizes: dict[str, float] = Field(
        default={},
        description="Height, mass and sizes measured by hand, of the subject file or the recordings.",
    )


class ScalingDocument(Provenance, MethodResult):
    """``scaling.json``: one method."""


class TruthDocument(base.Part):
    """The known answer of a virtual subject, and each method's distance from it."""

    segment_lengths_mm: dict[str, base.Rounded]
    errors: dict[str, dict[str, base.Rounded]] = Field(description="Method to measure to value.")


class TrustNote(base.Part):
    """How far to trust one thing of a model."""

    topic: str
    level: Literal["good", "fair", "poor", "unknown"]
    text: str


class VerdictDocument(base.Part):
    """Which method to use for this person, why, and how far to trust it."""

    method: str
    strength: Literal["decided", "leaning", "undecided"]
    headline: str
    tone: base.Tone = Field(default="plain", description="Whether the headline is good news.")
    why: list[str]
    trust: list[TrustNote]


MuscleQuantity = Literal["moment arm", "length", "joint moment"]


class MuscleDifference(base.Part):
    """Where one method's muscle or joint differs most from another's, over the trials compared."""

    method: str
    against: str
    quantity: MuscleQuantity
    muscle: str = Field(description="Empty for a joint moment.")
    coordinate: str = Field(description="Empty for a length of muscle and tendon.")
    trial: str
    time_s: float
    angle_deg: float | None = Field(description="Of the coordinate then, by the method; null of none.")
    value: float = Field(description="By the method, in ``unit``.")
    reference: float
    difference: float
    rms: float = Field(description="Of the difference over that trial.")
    unit: str

    @property
    def sentence(self) -> str:
        """What a person reads."""
        what = {
            "moment arm": f"the moment arm of {self.muscle} about {self.coordinate}",
            "length": f"the length of {self.muscle} with its tendon",
            "joint moment": f"the moment at {self.coordinate}",
        }[self.quantity]
        place = "" if self.angle_deg is None else f" at {self.angle_deg:.0f} degrees"
        size = f"{abs(self.difference):.1f} {self.unit}"
        share = f" of {abs(self.reference):.1f}" if self.reference else ""
        return (
            f"{self.method} against {self.against} changes {what} by {size}{share}{place} "
            f"({self.trial}, {self.time_s:.2f} s)."
        )


class MuscleDocument(base.Part):
    """What the methods make of the muscles."""

    reference: str = Field(description="The method that the others are held against.")
    trials: list[str]
    differences: list[MuscleDifference] = Field(
        description="The largest of each method and quantity, in descending order."
    )
    summary: list[str] = Field(description="The largest differences in words.")
    notes: list[str] = Field(description="What is not compared, and why.")


class MuscleCurve(base.Part):
    """One muscle's, or joint's, course over one recording by every method."""

    quantity: MuscleQuantity
    muscle: str = Field(description="Empty for a joint moment.")
    coordinate: str = Field(description="Empty for a length of muscle and tendon.")
    trial: str
    unit: str
    start_s: float
    rate_hz: float
    methods: list[str]
    values: base.ArrayEntry = Field(description="Frames, methods.")


class MuscleScene(base.Scene):
    """The courses in which methods differ most."""

    curves: list[MuscleCurve]


class ComparisonDocument(Provenance):
    """``comparison.json``: all methods."""

    verdict: VerdictDocument | None = Field(
        default=None, description="Which method to use for this person, by stated rules; null if not judged."
    )
    methods: dict[str, MethodResult]
    warnings: list[str]
    wall_s: float
    truth: TruthDocument | None = None
    muscles: MuscleDocument | None = Field(
        default=None, description="Lengths, moment arms and joint moments by method, where asked for."
    )

    @property
    def all_warnings(self) -> list[str]:
        """What concerns all methods, then what concerns each, every sentence once."""
        own = (warning for method in self.methods.values() for warning in method.warnings)
        return list(dict.fromkeys((*self.warnings, *own)))
