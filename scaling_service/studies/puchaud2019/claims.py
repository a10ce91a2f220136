"""What Puchaud et al. 2019 claim, one by one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from scaling_service.studies.puchaud2019 import questions as ask
from scaling_service.studies.puchaud2019.questions import Answer, Study


@dataclass(frozen=True, slots=True)
class Claim:
    """One claim of the paper."""

    where: str  # section, table or figure
    text: str  # the claim in plain English
    paper: str  # the paper's own figures for it
    ask: Callable[[Study], Answer]  # from a study to an answer


def answers(study: Study) -> tuple[tuple[Claim, Answer], ...]:
    """Every claim with its answer."""
    return tuple((claim, claim.ask(study)) for claim in CLAIMS)


_LEGS = ("femur_r", "femur_l", "shank_r", "shank_l")

CLAIMS: tuple[Claim, ...] = (
    Claim(
        "table 2",
        "Segment lengths differ between the models",
        "p < 0.05, inter-hip and shanks p < 0.001",
        ask.lengths_differ,
    ),
    Claim(
        "table 2",
        "Femurs and shanks of MB_lam differ from those of EB",
        "femur +8.4 ± 12.5 and +5.1 ± 13.3 mm, shank +15.8 and +16.4 mm",
        lambda study: ask.lengths_against_image(study, "MB_lam", _LEGS, differ=True),
    ),
    Claim(
        "table 2",
        "Femurs and shanks of MB do not differ from those of EB",
        "femur +4.0 ± 13.8 and +0.9 ± 16.3 mm, shank +3.9 and +3.8 mm",
        lambda study: ask.lengths_against_image(study, "MB", _LEGS, differ=False),
    ),
    Claim(
        "3.1",
        "The inter-hip distance of MB and MB_lam does not differ from that of EB",
        "MB -10.8 ± 19.9, MB_lam +4.0 ± 18.5 mm",
        ask.inter_hip_alike,
    ),
    Claim("4.1", "Femur lengths of MB lie nearer to EB than those of MB_lam", "see above", ask.femurs_nearer),
    Claim(
        "3.1",
        "Knee axes turn by about -2 to 2 deg on average",
        "table 3: at most 2.1 deg",
        ask.axes_turn_little,
    ),
    Claim("3.1", "Knee axes of MB_lam scatter most", "SD 3.2-4.1 against 1.8-2.7 deg", ask.axes_scatter),
    Claim("3.1", "Markers shift least in MB_lam and most in MB_am", "5.6, 6.3 (EB_am), 12.3 mm", ask.shifts),
    Claim(
        "3.2",
        "MB has the largest kinematic error, larger than all others",
        "27.4 ± 3.7 mm",
        ask.largest_error,
    ),
    Claim(
        "figure 5",
        "Kinematic errors rank MB > MB_lam > EB > MB_am > EB_am",
        "27.4, 11.0, 8.9, 6.5, 5.4 mm",
        ask.error_order,
    ),
    Claim(
        "3.2",
        "The kinematic error of EB_am is lower than that of MB_lam and EB",
        "5.4 against 11.0 and 8.9 mm",
        ask.errors_differ("EB_am", ("MB_lam", "EB"), differ=True),
    ),
    Claim(
        "3.2",
        "The kinematic error of MB_am does not differ from that of EB and EB_am",
        "6.5 against 8.9 and 5.4 mm",
        ask.errors_differ("MB_am", ("EB", "EB_am"), differ=False),
    ),
    Claim(
        "3.3",
        "Hip flexion of MB, MB_lam and EB differs from that of EB_am in gait",
        "6 subjects, 12 cycles: significant on both sides",
        ask.angles("hip_flexion", ("MB", "MB_lam", "EB"), differ=True),
    ),
    Claim(
        "3.3",
        "Knee flexion of EB differs from that of EB_am in gait",
        "6 subjects, 12 cycles: significant on both sides",
        ask.angles("knee_angle", ("EB",), differ=True),
    ),
    Claim(
        "3.3",
        "Hip flexion of MB_am does not differ from that of EB_am in gait",
        "6 subjects, 12 cycles: not significant",
        ask.angles("hip_flexion", ("MB_am",), differ=False),
    ),
    Claim(
        "3.3",
        "Knee flexion of MB_am does not differ from that of EB_am in gait",
        "6 subjects, 12 cycles: not significant",
        ask.angles("knee_angle", ("MB_am",), differ=False),
    ),
    Claim(
        "5",
        "Of the marker-based models, MB_am gives the joint angles nearest to EB_am",
        "stated in words",
        ask.most_consistent,
    ),
    Claim("4.4", "A subject is scaled in less than four minutes", "< 4 min, 100 frames", ask.quick),
)
"""In the order of the paper's results."""
