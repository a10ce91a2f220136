"""What a look at a subject's files says before anything is computed."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from scaling_service.documents import base

SCHEMA_VERSION = 1

Severity = Literal["error", "warning", "note"]
FileKind = Literal[
    "recording", "forces", "model", "mesh", "segmentation", "image_markers", "setup", "subject", "other"
]


class CorrectionEntry(base.Part):
    """A correction that the subject's document may hold under ``corrections``."""

    file: str = Field(description="The recording.")
    labels: dict[str, str] = Field(description="A label as it stands in the file, to the right one.")
    from_s: float
    to_s: float


class ProblemEntry(base.Part):
    """Something to correct, and how."""

    severity: Severity = Field(description="An error stops scaling; of a note nothing is to be done.")
    file: str | None = None
    field: str | None = None
    problem: str
    remedy: str | None = None
    corrections: list[CorrectionEntry] = Field(
        default=[], description="Each can be taken; of exchanges any one solves it."
    )


class AxesEntry(base.Part):
    """Which laboratory axes were taken for up and forward."""

    up: str
    forward: str
    sure: bool = Field(description="Whether markers or walking decided; false where it is a guess.")
    given: bool = Field(description="Whether the request or the settings gave both.")
    why: list[str]
    R_new_old: list[tuple[float, float, float]] = Field(
        description="Turns laboratory vectors into X forward, Y up, Z right."
    )


class FileRole(base.Part):
    """An uploaded file, and what it is for."""

    name: str
    kind: FileKind
    role: str | None = Field(description="Its place in the subject's document, such as `trials.static`.")
    named: bool = Field(description="Whether the document has it there; else it is a proposal.")
    why: str
    problem: ProblemEntry | None = None


class LabelEntry(base.Part):
    """A label of one recording."""

    label: str
    seen: float = Field(description="Share of the frames that show it.")
    gaps: list[tuple[int, int]] = Field(description="First and last frame of each gap, counted from 0.")
    longest_gap_s: float
    computed: bool = Field(description="Whether it reads like a point that software computed.")


class RepairEntry(base.Part):
    """Something that was decided or repaired while reading."""

    what: str
    where: str
    detail: str
    frames: int


class EventProof(base.Part):
    """A foot meets the ground (strike) or leaves it (off)."""

    side: Literal["r", "l"]
    kind: Literal["strike", "off"]
    time_s: float = Field(description="By the recording's clock.")
    source: Literal["document", "file", "plates"] = Field(
        description="Who says so. Strides are cut by the document's and the file's."
    )


class RecordingProof(base.Part):
    """One recording as it was understood. Positions are m, X forward, Y up, Z right."""

    name: str
    file: str
    format: str
    unit: str = Field(description="As the file states it.")
    rate_hz: float
    frames: int
    start_s: float
    axes: AxesEntry = Field(description="What this recording alone says.")
    walked_m: float = Field(description="From first to last frame, over the floor.")
    direction: tuple[float, float, float] | None = Field(description="Of walking; null where nobody walks.")
    labels: list[LabelEntry]
    markers: base.ArrayEntry
    plates: list[base.PlateEntry]
    events: list[EventProof] = Field(default=[], description="Heel strikes and toe-offs, by time.")
    forces_from: str | None
    force: base.ArrayEntry | None
    centre_of_pressure: base.ArrayEntry | None
    repairs: list[RepairEntry]
    problems: list[ProblemEntry]


class Candidate(base.Part):
    """A label that may be a marker."""

    label: str
    confidence: float = Field(ge=0.0, le=1.0)
    why: str


class MarkerProof(base.Part):
    """A marker of the model, and the label that is proposed for it."""

    marker: str
    segment: str
    anatomical: bool
    label: str | None
    confidence: float = Field(ge=0.0, le=1.0)
    why: str
    source: Literal["document", "laboratory", "name", "place"] | None
    recordings: list[str] = Field(description="Those in which the label is.")
    others: list[Candidate]


class ExtraMarker(base.Part):
    """A label that no marker of the model took, and the segment that it sits on and moves with."""

    label: str
    segment: str | None
    confidence: float = Field(ge=0.0, le=1.0, description="Probability of that segment.")
    why: str


class MarkerSetProof(base.Part):
    """The marker set that the recordings were made with, and what follows from it."""

    name: str
    title: str
    share: float = Field(ge=0.0, le=1.0, description="Of the labels that the set asks for.")
    lacks: list[str] = Field(description="Labels that the set asks for and that no recording has.")
    additions: list[str] = Field(description="Sets that come with others and are there, too.")


class SizesProof(base.Part):
    """What is known of the person's size."""

    height_m: float | None
    mass_kg: float | None
    sex: Literal["F", "M"] | None
    sizes_mm: dict[str, float] = Field(description="Measured by hand, such as knee_width_r.")
    source: list[str] = Field(description="Files that state them.")


class Need(base.Part):
    """Something that an analysis needs, or that makes it better."""

    name: str
    there: bool
    required: bool = Field(default=True, description="Whether the analysis cannot run without it.")
    text: str = Field(description="What is there, or what its lack means.")
    give: Literal["recordings", "static", "evaluation", "bones", "forces", "model", "height", "mass"] = Field(
        description="What to give where it is not there."
    )


class Readiness(base.Part):
    """Whether an analysis can run on what is there."""

    analysis: str = Field(description="Its route, such as `dynamics`.")
    title: str
    ready: bool
    needs: list[Need]


class ProofDocument(base.Part):
    """A subject's files before anything is computed: what they are, and what to correct."""

    schema_version: int = SCHEMA_VERSION
    subject: str
    model: str
    model_why: str | None = Field(default=None, description="Of a built-in model that is proposed.")
    axes: AxesEntry | None = Field(description="For all recordings; null where none can be read.")
    files: list[FileRole]
    recordings: list[RecordingProof]
    marker_set: MarkerSetProof | None = Field(default=None, description="Null where no set is known.")
    consequences: list[str] = Field(
        default=[], description="What the markers that are there mean for each method, in words."
    )
    sizes: SizesProof | None = None
    markers: list[MarkerProof]
    unused_labels: list[str]
    extra_markers: list[ExtraMarker]
    readiness: list[Readiness] = Field(default=[], description="Of each analysis.")
    headline: str = Field(default="", description="The state of the files in a sentence.")
    proposal: dict[str, Any] | None = Field(description="A subject document to correct and to give.")
    problems: list[ProblemEntry] = Field(description="Of the whole, also what scaling would refuse.")
