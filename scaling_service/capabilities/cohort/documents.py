"""From a cohort's statistics to ``cohort.json``, in mm and degrees."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from scaling_service.capabilities.cohort import document as schema
from scaling_service.capabilities.cohort.agreement import CohortAgreement
from scaling_service.capabilities.cohort.curves import CurveComparison
from scaling_service.capabilities.cohort.groups import GroupComparison
from scaling_service.capabilities.cohort.scalars import ScalarComparison
from scaling_service.capabilities.cohort.statistics import GATE_MAX_M, GATE_RMS_M, CohortStatistics
from scaling_service.model.results import Array
from scaling_service.numerics.statistics.agreement import Estimate
from scaling_service.numerics.statistics.complete import Panel
from scaling_service.numerics.statistics.permutation_tests import CurveTest
from scaling_service.numerics.statistics.waveforms import PairedCurves

_MM, _DEG = 1e3, 180.0 / math.pi


def statistics_document(found: CohortStatistics) -> schema.StatisticsDocument:
    """The statistics as they are written."""
    return schema.StatisticsDocument(
        segment_lengths_mm=list(_quantities(found, "segment_length", _MM)),
        kinematic_error_mm=list(_quantities(found, "kinematic_error", _MM)),
        knee_axis_deg=list(_quantities(found, "knee_axis", _DEG)),
        marker_shift_mm=list(_quantities(found, "marker_shift", _MM)),
        from_truth_mm=list(_quantities(found, "from_truth_m", _MM)),
        from_truth_deg=list(_quantities(found, "from_truth_rad", _DEG)),
        joint_angles=[_curve(curve) for curve in found.curves],
        agreement=[_agreement(item) for item in found.agreements],
        opensim_limits=schema.Gates(
            rms_below_mm=GATE_RMS_M * _MM,
            max_below_mm=GATE_MAX_M * _MM,
            methods=[
                schema.GateEntry(
                    method=gate.method,
                    subjects=gate.subjects,
                    subjects_passed=gate.subjects_passed,
                    trials=gate.trials,
                    trials_passed=gate.trials_passed,
                )
                for gate in found.gates
            ],
        ),
        notes=list(found.notes),
    )


def _quantities(found: CohortStatistics, kind: str, unit: float) -> Iterator[schema.QuantityEntry]:
    return (_quantity(scalar, unit) for scalar in found.scalars if scalar.kind == kind)


def _quantity(scalar: ScalarComparison, unit: float) -> schema.QuantityEntry:
    return schema.QuantityEntry(
        quantity=scalar.quantity,
        compared=_panel(scalar.panel),
        mean=_scaled(scalar.mean, unit),
        sd=_scaled(scalar.sd, unit),
        values={subject: _scaled(by_method, unit) for subject, by_method in scalar.values.items()},
        friedman=None if scalar.test is None else _friedman(scalar.test, unit),
        note=scalar.note,
    )


def _friedman(test: GroupComparison, unit: float) -> schema.FriedmanEntry:
    return schema.FriedmanEntry(
        chi_square=test.chi_square,
        degrees_of_freedom=test.degrees_of_freedom,
        p=test.p,
        kendall_w=test.kendall_w,
        alpha=test.alpha,
        significant=test.significant,
        pairs=[
            schema.RankedPairEntry(
                methods=pair.methods,
                difference_mean=_rounded(unit * pair.difference_mean),
                difference_sd=_rounded(unit * pair.difference_sd),
                p=pair.p,
                significant=pair.significant,
            )
            for pair in test.pairs
        ],
    )


def _curve(curve: CurveComparison) -> schema.CurveEntry:
    test = curve.test
    return schema.CurveEntry(
        coordinate=curve.coordinate,
        compared=_panel(curve.panel),
        strides=dict(curve.strides),
        reference=curve.reference,
        mean_deg={method: _degrees(values) for method, values in curve.mean.items()},
        sd_deg={method: _degrees(values) for method, values in curve.sd.items()},
        anova=None if test is None else _curve_test(test.anova),
        pairs=[] if test is None else [_curve_pair(pair) for pair in test.pairs],
        note=curve.note,
    )


def _curve_pair(pair: PairedCurves) -> schema.CurvePairEntry:
    return schema.CurvePairEntry(
        methods=pair.methods,
        difference_mean_deg=_degrees(pair.difference_mean),
        test=_curve_test(pair.test),
    )


def _curve_test(test: CurveTest) -> schema.CurveTestEntry:
    return schema.CurveTestEntry(
        statistic=[_rounded(value) for value in test.statistic],
        threshold=_rounded(test.threshold) if math.isfinite(test.threshold) else None,
        p=test.p,
        alpha=test.alpha,
        significant=test.significant,
        clusters=[
            schema.ClusterEntry(start_percent=_rounded(c.start), end_percent=_rounded(c.end), p=c.p)
            for c in test.clusters
        ],
        rearrangements=test.rearrangements,
        exact=test.exact,
        can_decide=test.can_decide,
    )


def _agreement(item: CohortAgreement) -> schema.AgreementEntry:
    found, limits = item.result, item.result.bland_altman
    return schema.AgreementEntry(
        quantity=item.quantity,
        method=found.method,
        reference=found.reference,
        subjects=list(item.subjects),
        excluded=list(item.excluded),
        bias_mm=_interval(limits.bias, _MM),
        sd_mm=_rounded(_MM * limits.sd),
        lower_mm=_interval(limits.lower, _MM),
        upper_mm=_interval(limits.upper, _MM),
        rmse_mm=_rounded(_MM * found.rmse),
        icc_agreement=_interval(found.icc_agreement, 1.0) if item.varies else None,
        icc_consistency=_interval(found.icc_consistency, 1.0) if item.varies else None,
        confidence=found.confidence,
    )


def _interval(estimate: Estimate, unit: float) -> schema.Interval:
    low, high = (_rounded(unit * v) if math.isfinite(v) else None for v in (estimate.low, estimate.high))
    return schema.Interval(value=_rounded(unit * estimate.value), low=low, high=high)


def _panel(panel: Panel) -> schema.Compared:
    return schema.Compared(
        methods=list(panel.methods), subjects=list(panel.subjects), excluded=dict(panel.excluded)
    )


def _scaled(values: Mapping[str, float], unit: float) -> dict[str, float]:
    return {name: _rounded(unit * value) for name, value in values.items()}


def _degrees(values: Array) -> list[float]:
    return [_rounded(value) for value in np.degrees(values)]


def _rounded(value: float) -> float:
    """Four decimals: a tenth of a micrometre, or less than a second of arc."""
    return round(float(value), 4)
