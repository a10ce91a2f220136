"""What `discover` finds: where simulation and measurement disagree, what was named, what is left."""

from __future__ import annotations

import math
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import BeforeValidator, Field

from scaling_service.core.tables import ResultTable
from scaling_service.documents.base import Part, Tone
from scaling_service.documents.results import Provenance

if TYPE_CHECKING:
    from scaling_service.capabilities.discovery.evidence.fit import Fit
    from scaling_service.capabilities.discovery.laws.bones import BoneKnowledge
    from scaling_service.capabilities.discovery.search.leanings import Leanings
    from scaling_service.capabilities.discovery.start import Prepared

FILE_NAME = "discovery.json"

_FIGURES = 6  # far beyond what any of these numbers is known to


def _round_numbers(value: object) -> object:
    if not isinstance(value, int | float):
        return value
    return float(f"{value:.{_FIGURES}g}") if math.isfinite(value) else None


Unit = Literal["1", "mm", "N", "N m"]
Verdict = Literal["found", "nothing", "unexplained"]
Number = Annotated[float, BeforeValidator(_round_numbers)]
Known = Annotated[float | None, BeforeValidator(_round_numbers)]
"""A number, null where there is none."""


class PlacedEffect(Part):
    """An effect of the catalogue at a place."""

    kind: str
    where: list[str] = Field(description="Markers, segments, joints or plates, or the whole recording.")
    driver: list[str] = Field(default=[], description="Coordinates that it follows.")
    # Read from a candidate, too, of which no names mean all
    trials: Annotated[list[str] | None, BeforeValidator(lambda names: names or None)] = Field(
        default=None, description="The recordings in which alone it is; null for all."
    )
    note: str = ""


class DisagreementDocument(Part):
    """Where the model and the recordings differ before anything was added."""

    where: str
    observable: Literal["marker", "force", "moment"]
    unit: Unit
    rms: Number
    floor: Known = Field(description="What is ordinary for people, as lively as this person is.")
    share: Known = Field(description="Of all that stands above what is ordinary.")
    p: Known = Field(description="Of standing so far above what is ordinary by chance.")
    trials: dict[str, Number] = Field(description="Recording to its RMS.")
    when: str
    along: str


class QuantityDocument(Part):
    """A number of an effect, in the unit of its name; a direction is three numbers."""

    value: Number | tuple[Number, Number, Number]
    sd: Known = Field(description="Standard deviation; null where it cannot be known.")
    usual: tuple[Number, Number] | None = Field(
        default=None, description="What laboratories meet, lowest and highest; null where that is not known."
    )
    at_bound: bool = Field(default=False, description="False: the search has no bounds any more.")
    determined: bool = Field(default=True, description="Whether the recordings tell it at all.")


class EvidenceDocument(Part):
    """What speaks for an effect."""

    gain_held_out: Known = Field(
        description="Share of the sum of squares of markers, or of forces or moments, that it takes off "
        "recordings that did not fit it."
    )
    log_odds: Known = Field(
        description="Natural logarithm of the odds that it is there, against what is ordinary for people; "
        "that it could have been elsewhere is taken into account."
    )
    p_family_wise: Known = Field(description="That nothing is there: one less the probability of those odds.")
    by_blocks: bool = Field(description="Whether no recording was held out, so that the share is of all.")
    summary: str = Field(default="", description="The same in sentences.")


class BeliefDocument(Part):
    """How far an effect may be believed, in probabilities; those of sign and size hold if it is there."""

    effect: Number = Field(description="That it is there, and not what is ordinary for people.")
    member: Number = Field(description="That it is this one of its class.")
    sign: Known = Field(description="That it points this way; null where it has no direction.")
    size: Known = Field(description="That its size is one that laboratories meet; null where none is known.")
    summary: str = Field(description="The same in a sentence.")
    cautions: list[str] = Field(description="Sizes that are implausible.")


class EffectDocument(PlacedEffect):
    """An effect that was named and added to the model, or taken out of the recordings."""

    name: str = Field(description="What it is, in plain English.")
    carries: bool = Field(
        default=True, description="Whether it stands in the headline: what takes nothing off does not."
    )
    parameters: dict[str, QuantityDocument]
    smallest_nameable: dict[str, Number] = Field(
        description="Parameter to the size from which it would be named nine times in ten."
    )
    advice: str = Field(default="", description="What to do about it; empty in results of earlier versions.")
    confusable_with: list[PlacedEffect] = Field(
        description="What this recording does not tell from it; the answer is then the class."
    )
    would_separate: str | None = Field(description="The ordinary movement that would tell them apart.")
    evidence: EvidenceDocument
    belief: BeliefDocument | None = Field(default=None, description="Null in results of earlier versions.")


class LevelDocument(Part):
    """RMS before and after, beside what is ordinary for people."""

    before: Known
    after: Known
    floor: Known = Field(description="What is ordinary for people, as lively as this person is.")
    ceiling: Known = Field(description="What is left where everything ordinary takes what it can.")
    low: Known = Field(description="95 % interval of `after`, over blocks of time.")
    high: Known


class PlaceLevelDocument(LevelDocument):
    """The same at one marker, or of one component of the wrench."""

    unit: Unit


class GapDocument(Part):
    """The gap of the recordings of one role; null where nothing of the sort was measured."""

    whitened: LevelDocument | None = Field(description="All residuals, each divided by what is ordinary.")
    markers_mm: LevelDocument | None
    force_N: LevelDocument | None
    moment_Nm: LevelDocument | None
    places: dict[str, PlaceLevelDocument]


class BothGaps(Part):
    """The gap of what was fitted, and of what was not."""

    fit: GapDocument
    held_out: GapDocument


class TriedDocument(PlacedEffect):
    """The best of what was not named."""

    gain: Known = Field(
        description="Share of the whitened squares that it alone would take; null where it has no columns."
    )
    log_odds: Known = Field(description="As of an effect that was named.")
    smallest_nameable: dict[str, Number] = Field(
        description="Sizes, in proportion as it was tried, from which it would be named nine times in ten."
    )


class EstimateDocument(PlacedEffect):
    """What these recordings say of one thing of the model, named or not, were only that unlike the model."""

    parameters: dict[str, QuantityDocument] = Field(
        description="By the names of an effect's; `determined`: these recordings tell more than half of it."
    )


class UnexplainedDocument(Part):
    """What stands out of what is ordinary and matches no effect."""

    where: list[str]
    observable: Literal["marker", "force", "moment"]
    unit: Unit
    law: str = Field(description="What was seen, which coordinate it follows, or which effect it is like.")
    rms: Number
    floor: Known


class ExpectationDocument(Part):
    """What is known of a coordinate before markers are seen."""

    coordinate: str
    at_rest_deg: Number = Field(description="Its mean with the coordinates that it follows at zero.")
    follows: list[str] = Field(description="Coordinates that its mean follows.")
    sd_deg: Number
    source: str


class BonesDocument(Part):
    """What `model.json` holds of the bones beside the effects; `ik` takes all of it."""

    skin_mm: dict[str, Number] = Field(
        description="Marker to how far its skin is expected to slide over the bone where the knee flexes by "
        "60 deg, from other people's bones."
    )
    expectations: list[ExpectationDocument]
    left_out: list[str] = Field(
        description="Named movements that are not in `model.json`: more than these moves the same markers, "
        "so the recordings do not show where they take the bones."
    )
    sentences: list[str] = Field(default=[], description="The same in sentences.")


class HiddenDocument(PlacedEffect):
    """What was hidden in the recordings of a virtual person."""

    parameters: dict[str, float]


class DiscoveryDocument(Provenance):
    """``discovery.json``."""

    verdict: Verdict
    headline: str = Field(default="", description="The verdict in one sentence.")
    tone: Tone = Field(default="plain", description="Whether the headline is good news.")
    reason: str = Field(description="Why the search stopped.")
    disagreements: list[DisagreementDocument]
    effects: list[EffectDocument]
    gap: BothGaps
    tried: list[TriedDocument]
    estimates: list[EstimateDocument] = Field(
        default=[],
        description="Masses, centres and axes of the model as these recordings have them, most unlike first.",
    )
    unexplained: list[UnexplainedDocument]
    bones: BonesDocument | None = Field(default=None, description="Null in results of earlier versions.")
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


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class DiscoverResults:
    """What a search made of a subject's recordings."""

    prepared: Prepared
    before: Fit  # before, after: without and with what was named
    after: Fit
    lasting: Fit  # after, without movements that skin as a whole could as well be
    bones: BoneKnowledge
    leanings: Leanings  # what the recordings say of every effect of the model
    document: DiscoveryDocument  # ``discovery.json``: mm, degrees, factors

    @property
    def effects(self) -> ResultTable:
        """Every number of every effect that was named; its name holds the unit."""
        rows = tuple(
            (effect.kind, ", ".join(effect.where), name, number.value, number.sd)
            for effect in self.document.effects
            for name, number in effect.parameters.items()
        )
        return ResultTable("The missing effects", ("kind", "where", "parameter", "value", "sd"), rows)

    @property
    def tables(self) -> dict[str, ResultTable]:
        """What was named, number by number."""
        return {"effects": self.effects}

    def __repr__(self) -> str:
        return f"{self.document.headline}\n{self.effects!r}"

    def _repr_html_(self) -> str:
        return f"<p>{escape(self.document.headline)}</p>{self.effects._repr_html_()}"
