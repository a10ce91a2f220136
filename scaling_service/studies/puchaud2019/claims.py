"""What Puchaud et al. 2019 claim, and the questions that decide it; only the paper's tests are asked."""

from __future__ import annotations

from collections import abc

import numpy as np

from scaling_service.capabilities.cohort import result as cohorts
from scaling_service.core.names import say_name
from scaling_service.studies import claims
from scaling_service.studies.puchaud2019 import result as documents

_SMALL_DEG = 2.5  # "about -2 to 2 deg" (section 3.1), rounded to whole degrees
_FITTING = ("MB_lam", "MB_am", "EB_am")
_LEGS = ("femur_r", "femur_l", "shank_r", "shank_l")
_ERROR = ("kinematic_error_mm", "calibration")

CLAIMS: claims.Claims[documents.Puchaud2019Document] = claims.Claims.read(__package__)


def _test(study: documents.Puchaud2019Document, kind: str, quantity: str) -> cohorts.FriedmanEntry:
    found = study.statistics.quantity(kind, quantity)
    if found.friedman is None:
        raise ValueError(f"{kind} {quantity} was not compared: {found.note}")
    return found.friedman


def _format_p(value: float) -> str:
    return "p < 0.001" if value < 0.001 else f"p = {value:.3f}"


def _average_difference(test: cohorts.FriedmanEntry, method: str, reference: str) -> float:
    """Mean of the method minus the reference."""
    pair = test.pair(method, reference)
    return pair.difference_mean if pair.methods[1] == reference else -pair.difference_mean


@CLAIMS.decide
def lengths_differ(study: documents.Puchaud2019Document) -> claims.Answer:
    tests = {name: _test(study, "segment_lengths_mm", name) for name in documents.LENGTHS}
    return claims.Answer(
        all(t.significant for t in tests.values()),
        ", ".join(f"{say_name(name)} {_format_p(t.p)}" for name, t in tests.items()),
    )


def _compare_with_image(
    study: documents.Puchaud2019Document, method: str, names: abc.Iterable[str], *, differ: bool
) -> claims.Answer:
    """Whether a method's lengths all differ, or all do not differ, from EB's."""
    tests = {name: _test(study, "segment_lengths_mm", name) for name in names}
    pairs = {name: test.pair(method, "EB") for name, test in tests.items()}
    return claims.Answer(
        all(p.significant is differ for p in pairs.values()),
        ", ".join(
            f"{say_name(name)} {_average_difference(tests[name], method, 'EB'):+.1f} ± "
            f"{p.difference_sd:.1f} mm ({_format_p(p.p)})"
            for name, p in pairs.items()
        ),
    )


@CLAIMS.decide
def optimised_legs_differ(study: documents.Puchaud2019Document) -> claims.Answer:
    return _compare_with_image(study, "MB_lam", _LEGS, differ=True)


@CLAIMS.decide
def scaled_legs_alike(study: documents.Puchaud2019Document) -> claims.Answer:
    return _compare_with_image(study, "MB", _LEGS, differ=False)


@CLAIMS.decide
def inter_hip_alike(study: documents.Puchaud2019Document) -> claims.Answer:
    both = {m: _compare_with_image(study, m, ("inter_hip",), differ=False) for m in ("MB", "MB_lam")}
    return claims.Answer(
        all(answer.holds for answer in both.values()), "; ".join(f"{m} {a.figures}" for m, a in both.items())
    )


@CLAIMS.decide
def femurs_nearer(study: documents.Puchaud2019Document) -> claims.Answer:
    means = [study.statistics.quantity("segment_lengths_mm", f"femur_{side}").mean for side in "rl"]
    gaps = {method: [mean[method] - mean["EB"] for mean in means] for method in ("MB", "MB_lam")}
    size = {method: float(np.mean(np.abs(gap))) for method, gap in gaps.items()}
    return claims.Answer(
        size["MB"] < size["MB_lam"],
        "; ".join(f"{m} right {g[0]:+.1f}, left {g[1]:+.1f} mm" for m, g in gaps.items()),
    )


@CLAIMS.decide
def axes_turn_little(study: documents.Puchaud2019Document) -> claims.Answer:
    found = [study.statistics.quantity("knee_axis_deg", axis).mean for axis in documents.AXES]
    means = {method: [mean[method] for mean in found] for method in _FITTING}
    return claims.Answer(
        max(abs(v) for row in means.values() for v in row) <= _SMALL_DEG,
        "; ".join(f"{m} {', '.join(f'{v:+.1f}' for v in row)}" for m, row in means.items()) + " deg",
    )


@CLAIMS.decide
def axes_scatter(study: documents.Puchaud2019Document) -> claims.Answer:
    found = [study.statistics.quantity("knee_axis_deg", axis).sd for axis in documents.AXES]
    spread = {method: float(np.mean([sd[method] for sd in found])) for method in _FITTING}
    return claims.Answer(
        max(spread, key=spread.__getitem__) == "MB_lam",
        ", ".join(f"{m} {v:.2f}" for m, v in spread.items()) + " deg (mean SD)",
    )


@CLAIMS.decide
def shifts(study: documents.Puchaud2019Document) -> claims.Answer:
    found = study.statistics.quantity("marker_shift_mm", "mean_over_markers")
    order = sorted(found.mean, key=found.mean.__getitem__)
    return claims.Answer(
        order == ["MB_lam", "EB_am", "MB_am"],
        ", ".join(f"{m} {found.mean[m]:.1f} ± {found.sd[m]:.1f}" for m in order) + " mm",
    )


@CLAIMS.decide
def largest_error(study: documents.Puchaud2019Document) -> claims.Answer:
    found, test = study.statistics.quantity(*_ERROR), _test(study, *_ERROR)
    pairs = {m: test.pair(m, "MB") for m in documents.METHODS if m != "MB"}
    means = ", ".join(f"{m} {found.mean[m]:.1f} ± {found.sd[m]:.1f}" for m in documents.METHODS)
    return claims.Answer(
        max(found.mean, key=found.mean.__getitem__) == "MB" and all(p.significant for p in pairs.values()),
        f"{means} mm; MB against " + ", ".join(f"{m} {_format_p(p.p)}" for m, p in pairs.items()),
    )


@CLAIMS.decide
def error_order(study: documents.Puchaud2019Document) -> claims.Answer:
    mean = study.statistics.quantity(*_ERROR).mean
    order = sorted(documents.METHODS, key=mean.__getitem__, reverse=True)
    said = " > ".join(f"{m} {mean[m]:.1f}" for m in order)
    return claims.Answer(order == ["MB", "MB_lam", "EB", "MB_am", "EB_am"], f"{said} mm")


def _errors_differ(
    study: documents.Puchaud2019Document, method: str, others: abc.Sequence[str], *, differ: bool
) -> claims.Answer:
    """Whether the kinematic error of a model differs from those of others, or from none of them."""
    test = _test(study, *_ERROR)
    pairs = {other: test.pair(method, other) for other in others}
    return claims.Answer(
        all(p.significant is differ for p in pairs.values()),
        ", ".join(
            f"against {other} {_average_difference(test, method, other):+.1f} mm ({_format_p(p.p)})"
            for other, p in pairs.items()
        ),
    )


@CLAIMS.decide
def imaged_and_fitted_differs(study: documents.Puchaud2019Document) -> claims.Answer:
    return _errors_differ(study, "EB_am", ("MB_lam", "EB"), differ=True)


@CLAIMS.decide
def fitted_is_alike(study: documents.Puchaud2019Document) -> claims.Answer:
    return _errors_differ(study, "MB_am", ("EB", "EB_am"), differ=False)


def _angles_differ(
    study: documents.Puchaud2019Document, joint: str, methods: abc.Sequence[str], *, differ: bool
) -> claims.Answer:
    """Whether a joint's angles differ from those of EB_am somewhere in the cycle, on both sides."""
    found = {
        f"{side} {method}": _curves_differ(study.statistics.curve(f"{joint}_{side}"), method)
        for side in "rl"
        for method in methods
    }
    decided = [differs for differs, _ in found.values()]
    said = ", ".join(f"{name} {words}" for name, (_, words) in found.items())
    _, few = _curves_differ(study.walkers_statistics.curve(f"{joint}_r"), methods[0])
    return claims.Answer(
        None if None in decided else all(d is differ for d in decided),
        f"{len(study.subjects)} subjects: {said}; {len(study.walkers)} subjects alone: {few}",
    )


def _curves_differ(curve: cohorts.CurveEntry, method: str) -> tuple[bool | None, str]:
    """Whether a method's curves differ from EB_am's, None where too few subjects walked; and words for it."""
    anova = curve.anova
    if anova is None:
        return None, "not compared"
    if not anova.significant:
        return False if anova.can_decide else None, f"no difference between models ({_format_p(anova.p)})"
    pair = curve.pair(method, "EB_am").test
    if not pair.can_decide:
        return None, "models differ, but the subjects are too few for any pair to be significant"
    if not pair.significant:
        return False, f"does not differ ({_format_p(pair.p)})"
    return True, "differs at " + ", ".join(f"{start:.0f}-{end:.0f} %" for start, end in pair.spans)


@CLAIMS.decide
def hips_differ(study: documents.Puchaud2019Document) -> claims.Answer:
    return _angles_differ(study, "hip_flexion", ("MB", "MB_lam", "EB"), differ=True)


@CLAIMS.decide
def knees_differ(study: documents.Puchaud2019Document) -> claims.Answer:
    return _angles_differ(study, "knee_angle", ("EB",), differ=True)


@CLAIMS.decide
def hips_alike(study: documents.Puchaud2019Document) -> claims.Answer:
    return _angles_differ(study, "hip_flexion", ("MB_am",), differ=False)


@CLAIMS.decide
def knees_alike(study: documents.Puchaud2019Document) -> claims.Answer:
    return _angles_differ(study, "knee_angle", ("MB_am",), differ=False)


@CLAIMS.decide
def most_consistent(study: documents.Puchaud2019Document) -> claims.Answer:
    """By the RMS over the cycle and both sides of the mean difference, hip and knee flexion."""
    curves = [
        study.statistics.curve(f"{joint}_{side}").mean_deg
        for joint in ("hip_flexion", "knee_angle")
        for side in "rl"
    ]
    gaps = {}
    for method in ("MB", "MB_lam", "MB_am"):
        apart = [np.subtract(curve[method], curve["EB_am"]) for curve in curves]
        gaps[method] = float(np.sqrt(np.mean(np.square(apart))))
    return claims.Answer(
        min(gaps, key=gaps.__getitem__) == "MB_am",
        ", ".join(f"{m} {gap:.1f}" for m, gap in gaps.items()) + " deg",
    )


@CLAIMS.decide
def quick(study: documents.Puchaud2019Document) -> claims.Answer:
    slowest = study.slowest_subject_s
    return claims.Answer(slowest < 240.0, f"slowest subject {slowest:.1f} s, all five models")
