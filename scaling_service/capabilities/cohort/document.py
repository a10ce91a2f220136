"""``cohort.json``: how every subject of a batch ended, and the methods compared over all of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

if TYPE_CHECKING:  # they bring scipy, which a service that only passes documents on does not need
    from scaling_service.capabilities.cohort.groups import GroupComparison, ScalarComparison
    from scaling_service.capabilities.cohort.statistics import (
        CohortAgreement,
        CohortStatistics,
        CurveComparison,
    )
    from scaling_service.numerics.statistics.agreement import Estimate
    from scaling_service.numerics.statistics.permutation_tests import CurveTest

COHORT_SCHEMA_VERSION = 1
"""Raised when a reader of an older document would misread a newer one; new keys do not raise it."""

Rounded = Annotated[float, AfterValidator(lambda value: round(value, 4))]
"""A tenth of a micrometre, or less than a second of arc."""

GATE_RMS_M, GATE_MAX_M = 0.02, 0.04
"""OpenSim's guideline for inverse kinematics: marker errors below 2 cm RMS and 2 to 4 cm at most (Hicks et
al. 2015, J Biomech Eng 137:020905; the larger limit is taken). Necessary, not sufficient: fitted
numbers absorb errors."""

_MM, _DEG = 1e3, 180.0 / math.pi


class Part(BaseModel):
    """A part of a document: frozen, checked on the way out, refusing what JSON has no number for.

    It also reads from results that have the same names.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, from_attributes=True)


class SubjectEntry(Part):
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


class Compared(Part):
    """Whose values a comparison counts."""

    methods: list[str]
    subjects: list[str]
    excluded: dict[str, str] = Field(description="Every other subject to the reason.")


class RankedPairEntry(Part):
    """Two methods after Friedman's test, by Tukey's HSD on mean ranks."""

    methods: tuple[str, str]
    difference_mean: Rounded = Field(description="First minus second, in the quantity's unit.")
    difference_sd: Rounded
    p: float = Field(description="Family-wise over the pairs of this quantity.")
    significant: bool


class FriedmanEntry(Part):
    """Friedman's test of one quantity."""

    chi_square: float
    degrees_of_freedom: int
    p: float = Field(description="From the chi-square distribution; approximate for few subjects.")
    kendall_w: float = Field(description="0: subjects rank methods without agreement; 1: all alike.")
    alpha: float
    significant: bool
    pairs: list[RankedPairEntry]


class QuantityEntry(Part):
    """A number per subject and method; the unit stands in the name of the list that it is in."""

    quantity: str
    compared: Compared
    mean: dict[str, Rounded] = Field(description="Method to the mean over subjects.")
    sd: dict[str, Rounded] = Field(description="As mean (n - 1); empty for one subject.")
    values: dict[str, dict[str, Rounded]] = Field(description="Subject to method to value.")
    friedman: FriedmanEntry | None
    note: str = Field(description="Why there is no test.")


class ClusterEntry(Part):
    """A stretch of the gait cycle in which methods differ."""

    start_percent: Rounded
    end_percent: Rounded
    p: float


class CurveTestEntry(Part):
    """A statistic along the gait cycle against its rearrangements."""

    statistic: list[Rounded]
    threshold: Rounded | None = Field(description="Null where no outcome could be significant.")
    p: float
    alpha: float = Field(description="After correction for the number of pairs.")
    significant: bool
    clusters: list[ClusterEntry]
    rearrangements: int
    exact: bool = Field(description="Whether these are all.")
    can_decide: bool = Field(description="False where there are too few subjects for alpha.")


class CurvePairEntry(Part):
    """Two methods along the gait cycle, by a paired t test."""

    methods: tuple[str, str]
    difference_mean_deg: list[Rounded] = Field(description="First minus second.")
    test: CurveTestEntry


class CurveEntry(Part):
    """A joint angle over the gait cycle, 0 to 100 %."""

    coordinate: str
    compared: Compared
    strides: dict[str, int] = Field(description="Subject to the strides behind its curve.")
    reference: str | None = Field(description="Pairs are with this method; null: all pairs.")
    mean_deg: dict[str, list[Rounded]]
    sd_deg: dict[str, list[Rounded]]
    anova: CurveTestEntry | None
    pairs: list[CurvePairEntry] = Field(description="Empty unless the analysis of variance is significant.")
    note: str


class Interval(Part):
    """A number with its confidence interval; null where it is not defined."""

    value: Rounded
    low: Rounded | None
    high: Rounded | None


class AgreementEntry(Part):
    """A method against a reference, mm."""

    quantity: str = Field(description="A segment length, or a joint centre's coordinate such as hip_r.x.")
    method: str
    reference: str
    subjects: list[str]
    excluded: list[str]
    bias_mm: Interval = Field(description="Mean of method minus reference.")
    sd_mm: Rounded = Field(description="Of the differences.")
    lower_mm: Interval = Field(description="Lower limit of agreement, bias - 1.96 SD.")
    upper_mm: Interval
    rmse_mm: Rounded
    icc_agreement: Interval | None = Field(description="ICC(2,1); null where the reference does not vary.")
    icc_consistency: Interval | None = Field(description="ICC(3,1).")
    confidence: float


class GateEntry(Part):
    """Subjects that keep OpenSim's limits in all their trials: necessary, not sufficient."""

    method: str
    subjects: int
    subjects_passed: int
    trials: int
    trials_passed: int


class Gates(Part):
    """OpenSim's limits of inverse kinematics."""

    rms_below_mm: float
    max_below_mm: float
    meaning: Literal["necessary, not sufficient"] = "necessary, not sufficient"
    methods: list[GateEntry]


class StatisticsDocument(Part):
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


class CohortDocument(Part):
    """``cohort.json``."""

    schema_version: int = COHORT_SCHEMA_VERSION
    kind: Literal["cohort"] = "cohort"
    code_version: str
    cohort: str = Field(description="The file or folder that names the subjects, as given.")
    methods_asked: list[str] | None = Field(description="Null: all that each subject allows.")
    settings: dict[str, Any]
    seed: int
    subjects: list[SubjectEntry]
    statistics: StatisticsDocument
    notes: list[str]
    wall_s: float


def statistics_document(found: CohortStatistics) -> StatisticsDocument:
    """The statistics as they are written, in mm and degrees."""

    def quantities(kind: str, unit: float) -> list[QuantityEntry]:
        return [_quantity(scalar, unit) for scalar in found.scalars if scalar.kind == kind]

    return StatisticsDocument(
        segment_lengths_mm=quantities("segment_length", _MM),
        kinematic_error_mm=quantities("kinematic_error", _MM),
        knee_axis_deg=quantities("knee_axis", _DEG),
        marker_shift_mm=quantities("marker_shift", _MM),
        from_truth_mm=quantities("from_truth_m", _MM),
        from_truth_deg=quantities("from_truth_rad", _DEG),
        joint_angles=[_curve(curve) for curve in found.curves],
        agreement=[_agreement(item) for item in found.agreements],
        opensim_limits=Gates(
            rms_below_mm=GATE_RMS_M * _MM,
            max_below_mm=GATE_MAX_M * _MM,
            methods=[GateEntry.model_validate(gate) for gate in found.gates],
        ),
        notes=list(found.notes),
    )


def _quantity(scalar: ScalarComparison, unit: float) -> QuantityEntry:
    return QuantityEntry(
        quantity=scalar.quantity,
        compared=Compared.model_validate(scalar.panel),
        mean=_scaled(scalar.mean, unit),
        sd=_scaled(scalar.sd, unit),
        values={subject: _scaled(by_method, unit) for subject, by_method in scalar.values.items()},
        friedman=None if scalar.test is None else _friedman(scalar.test, unit),
        note=scalar.note,
    )


def _friedman(test: GroupComparison, unit: float) -> FriedmanEntry:
    pairs = [
        replace(p, difference_mean=unit * p.difference_mean, difference_sd=unit * p.difference_sd)
        for p in test.pairs
    ]
    return FriedmanEntry.model_validate(replace(test, pairs=tuple(pairs)))


def _curve(curve: CurveComparison) -> CurveEntry:
    test = curve.test
    return CurveEntry(
        coordinate=curve.coordinate,
        compared=Compared.model_validate(curve.panel),
        strides=dict(curve.strides),
        reference=curve.reference,
        mean_deg={method: np.degrees(values).tolist() for method, values in curve.mean.items()},
        sd_deg={method: np.degrees(values).tolist() for method, values in curve.sd.items()},
        anova=None if test is None else _curve_test(test.anova),
        pairs=[
            CurvePairEntry(
                methods=pair.methods,
                difference_mean_deg=np.degrees(pair.difference_mean).tolist(),
                test=_curve_test(pair.test),
            )
            for pair in (() if test is None else test.pairs)
        ],
        note=curve.note,
    )


def _curve_test(test: CurveTest) -> CurveTestEntry:
    return CurveTestEntry(
        statistic=test.statistic.tolist(),
        threshold=_finite(test.threshold),
        p=test.p,
        alpha=test.alpha,
        significant=test.significant,
        clusters=[ClusterEntry(start_percent=c.start, end_percent=c.end, p=c.p) for c in test.clusters],
        rearrangements=test.rearrangements,
        exact=test.exact,
        can_decide=test.can_decide,
    )


def _agreement(item: CohortAgreement) -> AgreementEntry:
    found, limits = item.result, item.result.bland_altman
    return AgreementEntry(
        quantity=item.quantity,
        method=found.method,
        reference=found.reference,
        subjects=list(item.subjects),
        excluded=list(item.excluded),
        bias_mm=_interval(limits.bias, _MM),
        sd_mm=_MM * limits.sd,
        lower_mm=_interval(limits.lower, _MM),
        upper_mm=_interval(limits.upper, _MM),
        rmse_mm=_MM * found.rmse,
        icc_agreement=_interval(found.icc_agreement, 1.0) if item.varies else None,
        icc_consistency=_interval(found.icc_consistency, 1.0) if item.varies else None,
        confidence=found.confidence,
    )


def _interval(estimate: Estimate, unit: float) -> Interval:
    return Interval(
        value=unit * estimate.value, low=_finite(unit * estimate.low), high=_finite(unit * estimate.high)
    )


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _scaled(values: Mapping[str, float], unit: float) -> dict[str, float]:
    return {name: unit * value for name, value in values.items()}
