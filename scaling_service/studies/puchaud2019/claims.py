"""What Puchaud et al. 2019 claim, each with the question to a cohort's statistics that decides it.

Only the tests that the paper used are asked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.cohort.groups import GroupComparison
from scaling_service.capabilities.cohort.statistics import CohortStatistics
from scaling_service.numerics.statistics.waveforms import WaveformComparison
from scaling_service.studies.claims import Answer, Claim
from scaling_service.studies.puchaud2019.paper import AXES, LENGTHS, METHODS

_MM = 1e3
_SMALL_DEG = 2.5  # "about -2 to 2 deg" (section 3.1), rounded to whole degrees


@dataclass(frozen=True, slots=True)
class Study:
    """The statistics that claims are asked of."""

    cohort: CohortStatistics  # all subjects, their functional movements and their gait
    walkers: CohortStatistics  # the few whose gait the paper had
    slowest_s: float  # the most time that one subject's calibrations took


def _test(study: Study, kind: str, quantity: str) -> GroupComparison:
    found = study.cohort.scalar(kind, quantity).test
    if found is None:
        raise ValueError(f"{kind} {quantity} was not compared: {study.cohort.scalar(kind, quantity).note}")
    return found


def _p(value: float) -> str:
    return "p < 0.001" if value < 0.001 else f"p = {value:.3f}"


def lengths_differ(study: Study) -> Answer:
    """Whether Friedman finds a difference between models in every length."""
    tests = {name: _test(study, "segment_length", name) for name in LENGTHS}
    return Answer(
        all(t.significant for t in tests.values()),
        ", ".join(f"{name} {_p(t.p)}" for name, t in tests.items()),
    )


def lengths_against_image(study: Study, method: str, names: Iterable[str], *, differ: bool) -> Answer:
    """Whether a method's lengths all differ, or all do not differ, from EB's."""
    pairs = {name: _test(study, "segment_length", name).pair(method, "EB") for name in names}
    return Answer(
        all(p.significant is differ for p in pairs.values()),
        ", ".join(
            f"{name} {_signed(_MM * _towards(p.methods, p.difference_mean, 'EB'))} ± "
            f"{_MM * p.difference_sd:.1f} mm ({_p(p.p)})"
            for name, p in pairs.items()
        ),
    )


def _towards(methods: tuple[str, str], difference: float, reference: str) -> float:
    """The other method minus the reference."""
    return difference if methods[1] == reference else -difference


def _signed(value: float) -> str:
    return f"{value:+.1f}"


def inter_hip_alike(study: Study) -> Answer:
    """Whether neither MB's nor MB_lam's inter-hip distance differs from EB's."""
    both = [lengths_against_image(study, method, ("inter_hip",), differ=False) for method in ("MB", "MB_lam")]
    return Answer(
        all(answer.holds for answer in both),
        "; ".join(f"{m} {a.figures}" for m, a in zip(("MB", "MB_lam"), both, strict=True)),
    )


def femurs_nearer(study: Study) -> Answer:
    """Whether MB's femurs lie nearer to EB's than MB_lam's do, mean over both sides."""
    gaps = {}
    for method in ("MB", "MB_lam"):
        means = [study.cohort.scalar("segment_length", f"femur_{side}").mean for side in "rl"]
        gaps[method] = [_MM * (mean[method] - mean["EB"]) for mean in means]
    size = {method: float(np.mean(np.abs(gap))) for method, gap in gaps.items()}
    return Answer(
        size["MB"] < size["MB_lam"],
        "; ".join(f"{m} right {_signed(g[0])}, left {_signed(g[1])} mm" for m, g in gaps.items()),
    )


def _error(study: Study) -> GroupComparison:
    return _test(study, "kinematic_error", "calibration")


def _means(test: GroupComparison) -> str:
    return ", ".join(f"{m} {_MM * test.mean[m]:.1f} ± {_MM * test.sd[m]:.1f}" for m in METHODS) + " mm"


def largest_error(study: Study) -> Answer:
    """Whether MB has the largest kinematic error, and differs from every other model."""
    test = _error(study)
    pairs = test.against("MB")
    return Answer(
        max(test.mean, key=test.mean.__getitem__) == "MB" and all(p.significant for p in pairs.values()),
        _means(test) + "; MB against " + ", ".join(f"{m} {_p(p.p)}" for m, p in pairs.items()),
    )


def error_order(study: Study) -> Answer:
    """Whether the models' mean kinematic errors rank as in figure 5."""
    test = _error(study)
    order = sorted(METHODS, key=test.mean.__getitem__, reverse=True)
    said = " > ".join(f"{m} {_MM * test.mean[m]:.1f}" for m in order)
    return Answer(order == ["MB", "MB_lam", "EB", "MB_am", "EB_am"], f"{said} mm")


def errors_differ(method: str, others: Sequence[str], *, differ: bool) -> Callable[[Study], Answer]:
    """Whether the kinematic error of a model differs from those of others, or from none of them."""

    def ask(study: Study) -> Answer:
        pairs = {other: _error(study).pair(method, other) for other in others}
        return Answer(
            all(p.significant is differ for p in pairs.values()),
            ", ".join(
                f"against {other} {_signed(_MM * _towards(p.methods, p.difference_mean, other))} mm "
                f"({_p(p.p)})"
                for other, p in pairs.items()
            ),
        )

    return ask


def axes_turn_little(study: Study) -> Answer:
    """Whether every mean turn of a knee axis is small."""
    means = {
        m: [float(np.degrees(study.cohort.scalar("knee_axis", a).mean[m])) for a in AXES]
        for m in ("MB_lam", "MB_am", "EB_am")
    }
    return Answer(
        max(abs(v) for row in means.values() for v in row) <= _SMALL_DEG,
        "; ".join(f"{m} {', '.join(f'{v:+.1f}' for v in row)}" for m, row in means.items()) + " deg",
    )


def axes_scatter(study: Study) -> Answer:
    """Whether MB_lam's knee axes have the largest standard deviation, mean over turns."""
    spread = {
        m: float(np.degrees(np.mean([study.cohort.scalar("knee_axis", a).sd[m] for a in AXES])))
        for m in ("MB_lam", "MB_am", "EB_am")
    }
    return Answer(
        max(spread, key=spread.__getitem__) == "MB_lam",
        ", ".join(f"{m} {v:.2f}" for m, v in spread.items()) + " deg (mean SD)",
    )


def shifts(study: Study) -> Answer:
    """Whether mean marker shifts rank as in the paper."""
    found = study.cohort.scalar("marker_shift", "mean_over_markers")
    order = sorted(found.mean, key=found.mean.__getitem__)
    return Answer(
        order == ["MB_lam", "EB_am", "MB_am"],
        ", ".join(f"{m} {_MM * found.mean[m]:.1f} ± {_MM * found.sd[m]:.1f}" for m in order) + " mm",
    )


def angles(joint: str, methods: Sequence[str], *, differ: bool) -> Callable[[Study], Answer]:
    """Whether a joint's angles differ from those of EB_am somewhere in the cycle, on both sides."""

    def ask(study: Study) -> Answer:
        found = {
            f"{side} {method}": _pair(study.cohort.curve(f"{joint}_{side}").test, method)
            for side in "rl"
            for method in methods
        }
        decided = [pair.differs for pair in found.values()]
        said = ", ".join(f"{name} {pair.words}" for name, pair in found.items())
        few = _pair(study.walkers.curve(f"{joint}_r").test, methods[0])
        return Answer(
            None if None in decided else all(d is differ for d in decided),
            f"{len(study.cohort.subjects)} subjects: {said}; {len(study.walkers.subjects)} subjects alone: "
            f"{few.words}",
        )

    return ask


@dataclass(frozen=True, slots=True)
class _Pair:
    """Whether a method's curves differ from the reference's; None where too few subjects walked."""

    differs: bool | None
    words: str


def _pair(test: WaveformComparison | None, method: str) -> _Pair:
    if test is None:
        return _Pair(None, "not compared")
    if not test.anova.significant:
        return _Pair(
            False if test.anova.can_decide else None, f"no difference between models ({_p(test.anova.p)})"
        )
    pair = test.pair(method, "EB_am").test
    if not pair.can_decide:
        return _Pair(None, "models differ, but the subjects are too few for any pair to be significant")
    if not pair.significant:
        return _Pair(False, f"does not differ ({_p(pair.p)})")
    return _Pair(True, "differs at " + ", ".join(f"{c.start:.0f}-{c.end:.0f} %" for c in pair.clusters))


def most_consistent(study: Study) -> Answer:
    """RMS over the cycle and both sides of the mean difference from EB_am, hip and knee flexion, by model."""
    gaps = {}
    for method in ("MB", "MB_lam", "MB_am"):
        curves = [
            study.cohort.curve(f"{joint}_{s}").mean for joint in ("hip_flexion", "knee_angle") for s in "rl"
        ]
        gaps[method] = float(np.degrees(np.sqrt(np.mean([(c[method] - c["EB_am"]) ** 2 for c in curves]))))
    return Answer(
        min(gaps, key=gaps.__getitem__) == "MB_am",
        ", ".join(f"{m} {gap:.1f}" for m, gap in gaps.items()) + " deg",
    )


def quick(study: Study) -> Answer:
    """Whether the slowest subject took less than the paper's four minutes."""
    return Answer(study.slowest_s < 240.0, f"slowest subject {study.slowest_s:.1f} s, all five models")


_LEGS = ("femur_r", "femur_l", "shank_r", "shank_l")

CLAIMS: tuple[Claim[Study], ...] = (
    Claim(
        "table 2",
        "Segment lengths differ between the models",
        "p < 0.05, inter-hip and shanks p < 0.001",
        lengths_differ,
    ),
    Claim(
        "table 2",
        "Femurs and shanks of MB_lam differ from those of EB",
        "femur +8.4 ± 12.5 and +5.1 ± 13.3 mm, shank +15.8 and +16.4 mm",
        lambda study: lengths_against_image(study, "MB_lam", _LEGS, differ=True),
    ),
    Claim(
        "table 2",
        "Femurs and shanks of MB do not differ from those of EB",
        "femur +4.0 ± 13.8 and +0.9 ± 16.3 mm, shank +3.9 and +3.8 mm",
        lambda study: lengths_against_image(study, "MB", _LEGS, differ=False),
    ),
    Claim(
        "3.1",
        "The inter-hip distance of MB and MB_lam does not differ from that of EB",
        "MB -10.8 ± 19.9, MB_lam +4.0 ± 18.5 mm",
        inter_hip_alike,
    ),
    Claim("4.1", "Femur lengths of MB lie nearer to EB than those of MB_lam", "see above", femurs_nearer),
    Claim(
        "3.1", "Knee axes turn by about -2 to 2 deg on average", "table 3: at most 2.1 deg", axes_turn_little
    ),
    Claim("3.1", "Knee axes of MB_lam scatter most", "SD 3.2-4.1 against 1.8-2.7 deg", axes_scatter),
    Claim("3.1", "Markers shift least in MB_lam and most in MB_am", "5.6, 6.3 (EB_am), 12.3 mm", shifts),
    Claim(
        "3.2", "MB has the largest kinematic error, larger than all others", "27.4 ± 3.7 mm", largest_error
    ),
    Claim(
        "figure 5",
        "Kinematic errors rank MB > MB_lam > EB > MB_am > EB_am",
        "27.4, 11.0, 8.9, 6.5, 5.4 mm",
        error_order,
    ),
    Claim(
        "3.2",
        "The kinematic error of EB_am is lower than that of MB_lam and EB",
        "5.4 against 11.0 and 8.9 mm",
        errors_differ("EB_am", ("MB_lam", "EB"), differ=True),
    ),
    Claim(
        "3.2",
        "The kinematic error of MB_am does not differ from that of EB and EB_am",
        "6.5 against 8.9 and 5.4 mm",
        errors_differ("MB_am", ("EB", "EB_am"), differ=False),
    ),
    Claim(
        "3.3",
        "Hip flexion of MB, MB_lam and EB differs from that of EB_am in gait",
        "6 subjects, 12 cycles: significant on both sides",
        angles("hip_flexion", ("MB", "MB_lam", "EB"), differ=True),
    ),
    Claim(
        "3.3",
        "Knee flexion of EB differs from that of EB_am in gait",
        "6 subjects, 12 cycles: significant on both sides",
        angles("knee_angle", ("EB",), differ=True),
    ),
    Claim(
        "3.3",
        "Hip flexion of MB_am does not differ from that of EB_am in gait",
        "6 subjects, 12 cycles: not significant",
        angles("hip_flexion", ("MB_am",), differ=False),
    ),
    Claim(
        "3.3",
        "Knee flexion of MB_am does not differ from that of EB_am in gait",
        "6 subjects, 12 cycles: not significant",
        angles("knee_angle", ("MB_am",), differ=False),
    ),
    Claim(
        "5",
        "Of the marker-based models, MB_am gives the joint angles nearest to EB_am",
        "stated in words",
        most_consistent,
    ),
    Claim("4.4", "A subject is scaled in less than four minutes", "< 4 min, 100 frames", quick),
)
"""In the order of the paper's results."""
