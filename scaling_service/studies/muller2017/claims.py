"""What Muller et al. 2017 claim, one by one, and what only virtual persons can tell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from scaling_service.studies.muller2017 import questions as ask
from scaling_service.studies.muller2017.questions import Answer
from scaling_service.studies.muller2017.study import INTERVAL, NOMINAL, PersonStudied


@dataclass(frozen=True, slots=True)
class Claim:
    """One claim."""

    where: str  # section or figure; "truth" where only virtual persons can tell
    text: str
    paper: str  # the paper's own figures for it
    ask: Callable[[Sequence[PersonStudied]], Answer]  # from the persons to an answer


def answers(persons: Sequence[PersonStudied]) -> tuple[tuple[Claim, Answer], ...]:
    """Every claim with its answer."""
    return tuple((claim, claim.ask(persons)) for claim in CLAIMS)


CLAIMS: tuple[Claim, ...] = (
    Claim(
        "3.1",
        "Uncertainty grows linearly with the added reconstruction error",
        "R2 0.963 to 0.999",
        ask.linear,
    ),
    Claim("figure 8", "Slopes are consistent between persons", "boxes about a third wide", ask.consistent),
    Claim("figure 8", "Vertical force and moment are least uncertain", "stated in words", ask.least_vertical),
    Claim("3.1", "Both horizontal directions are alike", "same order of magnitude", ask.horizontals_alike),
    Claim(
        "3.2",
        "The plates' noise is negligible",
        "5 orders of magnitude lower, about 1e-6",
        ask.plates_negligible,
    ),
    Claim(
        "3.3, H1",
        "A table's inertia is acceptable",
        "forces 2 ± 0.6 %, moments 1.3 ± 0.7 %",
        ask.table_acceptable,
    ),
    Claim(
        "3.3",
        "Uncertainties exceed residuals, except for the vertical moment",
        "all components of 10 persons but that one",
        ask.uncertainty_exceeds,
    ),
    Claim(
        "3.3, H2", "Residuals cannot calibrate inertia", "refuted for all 10 persons", ask.calibration_refused
    ),
    Claim(
        "truth",
        "Where calibration is refused, the measurement's true error is larger than inertia's",
        "cannot be known",
        ask.refusal_is_right,
    ),
    Claim(
        "truth", "The stated uncertainty covers the true error of the residual", "cannot be known", ask.covers
    ),
    Claim(
        "truth",
        f"Intervals of {INTERVAL} SD by the markers' errors hold {100 * NOMINAL:.0f} % of the true errors",
        "proposed as future work",
        ask.markers_cover,
    ),
    Claim("beyond", "Linear propagation gives the sampled slopes", "not in the paper", ask.linear_agrees),
    Claim(
        "truth",
        "Identification against the verdict makes the held-out error of inertia worse",
        "expected: overfitting",
        ask.identification_worse,
    ),
    Claim(
        "truth",
        "It does so in components whose residual is mostly the measurement's",
        "expected: overfitting",
        ask.worse_where_forbidden,
    ),
    Claim(
        "beyond",
        "The verdict by the markers' errors supports only what identification betters",
        "not in the paper",
        ask.markers_verdict,
    ),
    Claim(
        "truth",
        "Even a held-out residual can fall while inertia becomes less true",
        "expected: overfitting",
        ask.held_out_residual_deceives,
    ),
)
"""In the order of the paper's results, then what only truth tells."""
