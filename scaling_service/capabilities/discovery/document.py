"""``discovery.json``: where simulation and measurement disagree, which effects were named, what is left."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from scaling_service.documents.base import Part
from scaling_service.documents.results import Provenance

FILE_NAME = "discovery.json"

Unit = Literal["1", "mm", "N", "N m"]


class PlacedEffect(Part):
    """An effect of the catalogue at a place."""

    kind: str
    where: list[str] = Field(description="Markers, segments, joints or plates, or the whole recording.")
    driver: list[str] = Field(default=[], description="Coordinates that it follows.")
    trials: list[str] | None = Field(
        default=None, description="The recordings in which alone it is; null for all."
    )
    note: str = ""


class DisagreementDocument(Part):
    """Where the model and the recordings differ before anything was added."""

    where: str
    observable: Literal["marker", "force", "moment"]
    unit: Unit
    rms: float
    floor: float | None = Field(description="Noise floor: what noise alone would leave.")
    share: float | None = Field(description="Of all that stands above the noise floors.")
    p: float | None = Field(
        description="Of standing so far above its noise floor by chance, over all places."
    )
    trials: dict[str, float] = Field(description="Recording to its RMS.")
    when: str
    along: str


class QuantityDocument(Part):
    """A number of an effect, in the unit of its name; a direction is three numbers."""

    value: float | tuple[float, float, float]
    sd: float | None = Field(description="Standard deviation; null where it cannot be known.")


class EvidenceDocument(Part):
    """What speaks for an effect."""

    gain_held_out: float | None = Field(
        description="Share of the whitened sum of squares that it takes off recordings (or blocks of time) "
        "that did not fit it."
    )
    p_held_out: float | None
    p_family_wise: float | None = Field(description="Over the whole catalogue at all its places.")
    by_blocks: bool = Field(description="Whether blocks of time stood in for a recording held out.")
    summary: str = Field(default="", description="The same in sentences.")


class EffectDocument(PlacedEffect):
    """An effect that was named and added to the model, or taken out of the recordings."""

    name: str = Field(description="What it is, in plain English.")
    parameters: dict[str, QuantityDocument]
    smallest_nameable: dict[str, float] = Field(
        description="Parameter to the size from which it would be named nine times in ten."
    )
    confusable_with: list[PlacedEffect] = Field(
        description="What this recording does not tell from it; the answer is then the class."
    )
    would_separate: str | None = Field(description="The ordinary movement that would tell them apart.")
    evidence: EvidenceDocument


class LevelDocument(Part):
    """RMS before and after, between what noise leaves and what a black box reaches."""

    before: float | None
    after: float | None
    floor: float | None
    ceiling: float | None = Field(description="Black-box bound: a correction with as many numbers.")
    low: float | None = Field(description="95 % interval of `after`, over blocks of time.")
    high: float | None


class PlaceLevelDocument(LevelDocument):
    """The same at one marker, or of one component of the wrench."""

    unit: Unit


class GapDocument(Part):
    """The gap of the recordings of one role; null where nothing of the sort was measured."""

    whitened: LevelDocument | None = Field(description="All residuals, each divided by its own noise floor.")
    markers_mm: LevelDocument | None
    force_N: LevelDocument | None
    moment_Nm: LevelDocument | None
    absorbed: float | None = Field(
        description="Whitened RMS where the calibration's own parameters take up what they can instead."
    )
    places: dict[str, PlaceLevelDocument]


class BothGaps(Part):
    """The gap of what was fitted, and of what was not."""

    fit: GapDocument
    held_out: GapDocument


class TriedDocument(PlacedEffect):
    """The best of what was not named."""

    gain: float | None = Field(description="As `gain_held_out`.")


class UnexplainedDocument(Part):
    """What is left above the noise floor and matches no effect."""

    where: list[str]
    observable: Literal["marker", "force", "moment"]
    unit: Unit
    law: str = Field(description="The simplest sum of simple functions that describes it.")
    rms: float
    floor: float | None


class HiddenDocument(PlacedEffect):
    """What was hidden in the recordings of a virtual person."""

    parameters: dict[str, float]


class DiscoveryDocument(Provenance):
    """``discovery.json``."""

    verdict: Literal["found", "nothing", "unexplained"]
    headline: str = Field(default="", description="The verdict in one sentence.")
    reason: str = Field(description="Why the search stopped.")
    disagreements: list[DisagreementDocument]
    effects: list[EffectDocument]
    gap: BothGaps
    tried: list[TriedDocument]
    unexplained: list[UnexplainedDocument]
    start: str = Field(description="The method that scaled the model, or 'none'.")
    fitted_trials: list[str]
    held_out_trials: list[str] = Field(description="Empty where blocks of time stood in for them.")
    trials_with_forces: list[str]
    notes: list[str] = Field(description="What could not be tried or decided, and what was not written.")
    files: list[str] = Field(description="What was written beside this document.")
    wall_s: float
    hidden: list[HiddenDocument] | None = Field(
        default=None, description="Of a virtual person: what the search should have found."
    )
