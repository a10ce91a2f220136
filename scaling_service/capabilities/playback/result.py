"""What is played back: models, recordings and errors. Positions are m, X forward, Y up, Z right."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from scaling_service.documents import base

Point = tuple[float, float, float]


class SegmentEntry(base.Part):
    """A segment of a body."""

    name: str
    parent: str
    shape: Literal["image", "simple", "none"] = Field(description="Where the surface of that name is from.")


class PlacedEntry(base.Part):
    """A point that a segment carries."""

    name: str
    segment: str
    xyz_m: Point = Field(description="In the segment's frame.")


class BodyMarker(PlacedEntry):
    """A marker of a body."""

    anatomical: bool


class AxisEntry(base.Part):
    """A knee's axis."""

    segment: str
    ends_m: tuple[Point, Point]


class BodyEntry(base.Part):
    """One model of the person."""

    name: str
    bones: str = Field(description="Binary glTF among the job's files: a node for each segment, m.")
    segments: list[SegmentEntry] = Field(description="In the order of the poses.")
    markers: list[BodyMarker]
    centres: list[PlacedEntry]
    axes: list[AxisEntry]


class CoordinateEntry(base.Part):
    """A degree of freedom."""

    name: str
    unit: Literal["deg", "m"]
    estimated: bool = Field(description="Whether the recording determines it; else it stands at its default.")
    range: tuple[float, float] | None = Field(
        default=None, description="Ends of the range in which the model keeps it; null of one that is free."
    )


class MotionEntry(base.Part):
    """How one body moves in one recording."""

    poses: base.ArrayEntry = Field(
        description="Frames, segments, 7: origin, quaternion x, y, z, w to ground."
    )
    errors: base.ArrayEntry = Field(description="Frames, labels: distance of measured and model marker, mm.")
    coordinates: list[CoordinateEntry]
    angles: base.ArrayEntry = Field(description="Frames, coordinates: degrees or m.")
    placed: base.ArrayEntry | None = Field(
        default=None, description="Frames, labels, 3: model markers, where they glide on their segments."
    )


class SceneTrial(base.Part):
    """One recording with all bodies in it."""

    name: str
    role: Literal["calibration", "evaluation"]
    frames: int
    rate_hz: float
    start_s: float
    labels: list[str]
    measured: base.ArrayEntry = Field(description="Frames, labels, 3: measured markers after processing, m.")
    motions: dict[str, MotionEntry] = Field(description="Body to its motion.")
    plates: list[base.PlateEntry]
    force: base.ArrayEntry | None
    centre_of_pressure: base.ArrayEntry | None


class TestEntry(base.Part):
    """Where curves differ over the cycle."""

    __test__ = False  # not a test of pytest

    p: float | None
    can_decide: bool = Field(description="Whether so few cycles could show a difference at all.")
    differ_percent: list[tuple[float, float]] = Field(description="Stretches of the cycle, per cent.")


class CycleScene(TestEntry):
    """One joint angle over the gait cycle, 0 to 100 per cent in equal steps."""

    cycles: int
    mean_deg: dict[str, list[float]]
    sd_deg: dict[str, list[float]]
    pairs: dict[str, TestEntry] = Field(description="Body to its test against the reference.")


class GaitScene(base.Part):
    """Joint angles over the gait cycle."""

    trials: list[str]
    held_out: bool
    reason: str = Field(description="Why there is no cycle, where there is none.")
    reference: str
    angles: dict[str, CycleScene]


class SceneDocument(base.Scene):
    """All that is needed to play a result back."""

    subject: str
    bodies: list[BodyEntry]
    trials: list[SceneTrial]
    gait: GaitScene | None
