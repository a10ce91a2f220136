"""``cohort.json``: how every subject of a batch ended, and the methods compared over all of them."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from scaling_service.documents import base

COHORT_SCHEMA_VERSION = 1
"""Raised when a reader of an older document would misread a newer one; new keys do not raise it."""

RECORD = "batch.json"
"""What a member keeps for the statistics, in its folder."""


class SubjectEntry(base.Part):
    """How one subject ended."""

    id: str = Field(description="The subject's id; its file where that could not be read.")
    file: str = Field(description="The subject file as the cohort names it.")
    groups: dict[str, str] = Field(description="Further columns of the cohort file.")
    status: Literal["done", "skipped", "failed"]
    reason: str = Field(description="Why it was skipped or failed; empty where it is done.")
    kept: bool = Field(description="Done in an earlier run and unchanged since.")
    folder: str | None = Field(description="Where its results are, relative to this document.")
    methods: list[str]
    left_out: dict[str, str] = Field(description="Method that was not done to the reason.")
    strides: dict[str, int] = Field(description="Leg (r, l) to the strides that angles are averaged over.")
    no_strides: dict[str, str] = Field(description="Leg to why it has none.")
    wall_s: float


class Compared(base.Part):
    """Whose values a comparison counts."""

    methods: list[str]
    subjects: list[str]
    excluded: dict[str, str] = Field(description="Every other subject to the reason.")


class RankedPairEntry(base.Part):
    """Two methods after Friedman's test, by Tukey's HSD on mean ranks."""

    methods: tuple[str, str]
    difference_mean: base.Rounded = Field(description="First minus second, in the quantity's unit.")
    difference_sd: base.Rounded
    p: float = Field(description="Family-wise over the pairs of this quantity.")
    significant: bool


class FriedmanEntry(base.Part):
    """Friedman's test of one quantity."""

    chi_square: float
    degrees_of_freedom: int
    p: float = Field(description="From the chi-square distribution; approximate for few subjects.")
    kendall_w: float = Field(description="0: subjects rank methods without agreement; 1: all alike.")
    alpha: float
    significant: bool
    pairs: list[RankedPairEntry] = Field(description="All; none is significant unless the test is.")

    def pair(self, method: str, reference: str) -> RankedPairEntry:
        """The pair of two methods, in either order (StopIteration if there is none)."""
        return next(pair for pair in self.pairs if set(pair.methods) == {method, reference})


class QuantityEntry(base.Part):
    """A number per subject and method; the unit stands in the name of the list that it is in."""

    quantity: str
    compared: Compared
    mean: dict[str, base.Rounded] = Field(description="Method to the mean over subjects.")
    sd: dict[str, base.Rounded] = Field(description="As mean (n - 1); empty for one subject.")
    values: dict[str, dict[str, base.Rounded]] = Field(description="Subject to method to value.")
    friedman: FriedmanEntry | None
    note: str = Field(description="Why there is no test.")


class ClusterEntry(base.Part):
    """A stretch of the gait cycle in which methods differ."""

    start_percent: base.Rounded
    end_percent: base.Rounded
    p: float


class CurveTestEntry(base.Part):
    """A statistic along the gait cycle against its rearrangements."""

    statistic: list[base.Rounded]
    threshold: base.Known = Field(description="Null where no outcome could be significant.")
    p: float
    alpha: float = Field(description="After correction for the number of pairs.")
    significant: bool
    clusters: list[ClusterEntry]
    rearrangements: int
    exact: bool = Field(description="Whether these are all.")
    can_decide: bool = Field(description="False where there are too few subjects for alpha.")

    @property
    def spans(self) -> list[tuple[float, float]]:
        """Where along the cycle methods differ, %."""
        return [(cluster.start_percent, cluster.end_percent) for cluster in self.clusters]


class CurvePairEntry(base.Part):
    """Two methods along the gait cycle, by a paired t test."""

    methods: tuple[str, str]
    difference_mean_deg: list[base.Rounded] = Field(description="First minus second.")
    test: CurveTestEntry


class CurveEntry(base.Part):
    """A joint angle over the gait cycle, 0 to 100 %."""

    coordinate: str
    compared: Compared
    strides: dict[str, int] = Field(description="Subject to the strides behind its curve.")
    reference: str | None = Field(description="Pairs are with this method; null: all pairs.")
    mean_deg: dict[str, list[base.Rounded]]
    sd_deg: dict[str, list[base.Rounded]]
    anova: CurveTestEntry | None
    pairs: list[CurvePairEntry] = Field(description="Empty unless the analysis of variance is significant.")
    note: str

    def pair(self, method: str, reference: str) -> CurvePairEntry:
        """The pair of two methods, in either order (StopIteration if it was not tested)."""
        return next(pair for pair in self.pairs if set(pair.methods) == {method, reference})


class Interval(base.Part):
    """A number with its confidence interval; null where it is not defined."""

    value: base.Rounded
    low: base.Known
    high: base.Known


class AgreementEntry(base.Part):
    """A method against a reference, mm."""

    quantity: str = Field(description="A segment length, or a joint centre's coordinate such as hip_r.x.")
    method: str
    reference: str
    subjects: list[str]
    excluded: list[str]
    bias_mm: Interval = Field(description="Mean of method minus reference.")
    sd_mm: base.Rounded = Field(description="Of the differences.")
    lower_mm: Interval = Field(description="Lower limit of agreement, bias - 1.96 SD.")
    upper_mm: Interval
    rmse_mm: base.Rounded
    icc_agreement: Interval | None = Field(description="ICC(2,1); null where the reference does not vary.")
    icc_consistency: Interval | None = Field(description="ICC(3,1).")
    confidence: float


class GateEntry(base.Part):
    """Subjects that keep OpenSim's limits in all their trials: necessary, not sufficient."""

    method: str
    subjects: int
    subjects_passed: int
    trials: int
    trials_passed: int


class Gates(base.Part):
    """OpenSim's limits of inverse kinematics."""

    rms_below_mm: float
    max_below_mm: float
    meaning: Literal["necessary, not sufficient"] = "necessary, not sufficient"
    methods: list[GateEntry]


class StatisticsDocument(base.Part):
    """The methods compared over the subjects that are done."""

    segment_lengths_mm: list[QuantityEntry]
    kinematic_error_mm: list[QuantityEntry] = Field(
        description="Mean over the trials of a role: calibration, evaluation."
    )
    knee_axis_deg: list[QuantityEntry]
    marker_shift_mm: list[QuantityEntry]
    from_truth_mm: list[QuantityEntry] = Field(description="Of virtual persons only.")
    from_truth_deg: list[QuantityEntry]
    joint_angles: list[CurveEntry]
    agreement: list[AgreementEntry]
    opensim_limits: Gates
    notes: list[str]

    def quantity(self, kind: str, name: str) -> QuantityEntry:
        """The first comparison of a quantity, that of most methods (StopIteration if there is none).

        ``kind``: one of the lists above, such as ``segment_lengths_mm``.
        """
        entries: list[QuantityEntry] = getattr(self, kind)
        return next(entry for entry in entries if entry.quantity == name)

    def curve(self, coordinate: str) -> CurveEntry:
        """The first comparison of a joint angle (StopIteration if there is none)."""
        return next(entry for entry in self.joint_angles if entry.coordinate == coordinate)


class CohortDocument(base.Part):
    """``cohort.json``."""

    schema_version: int = COHORT_SCHEMA_VERSION
    kind: Literal["cohort"] = "cohort"
    code_version: str
    cohort: str = Field(description="The file or folder that names the subjects, as given.")
    methods_asked: list[str] | None = Field(description="Null: all that each subject allows.")
    settings: dict[str, Any]
    seed: int
    headline: str = Field(default="", description="What the cohort shows, in one sentence.")
    why: list[str] = Field(default=[], description="What that rests on, a sentence each.")
    subjects: list[SubjectEntry]
    statistics: StatisticsDocument
    notes: list[str]
    wall_s: float
