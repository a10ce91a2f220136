"""How far to trust the markers followed, the geometry and the joint angles of the model chosen."""

from __future__ import annotations

import math

from scaling_service.capabilities.scaling.comparison.verdict_evidence import (
    Evidence,
    Level,
    MethodEvidence,
    Trust,
)
from scaling_service.capabilities.scaling.comparison.verdict_rules import (
    AGREES,
    agreement,
    gates,
    implausible,
    mm,
    mostly_undetermined,
)
from scaling_service.core.text import few

ANGLE_GOOD = math.radians(2.0)
ANGLE_FAIR = math.radians(5.0)
"""McGinley et al. 2009 (Gait Posture 29:360-369), discussion: errors of 2 deg or less are likely to be
acceptable, between 2 and 5 deg reasonable with some care, beyond 5 deg they may mislead a reader."""


def trust(chosen: MethodEvidence, evidence: Evidence) -> tuple[Trust, ...]:
    """One line each for markers, for lengths and joint centres, and for joint angles."""
    return (_markers(chosen, evidence), _geometry(chosen, evidence), _angles(chosen, evidence))


def _markers(chosen: MethodEvidence, evidence: Evidence) -> Trust:
    topic, judged = "Following the markers", chosen.judged_on
    if judged is None:
        return Trust(topic, "unknown", "No movement was recorded.")
    where = "held-out" if chosen.held_out is not None else "fitted"
    text = f"{mm(judged.mean)} mm on average, {mm(judged.max)} mm at most on {where} trials."
    if not all(gate.passed for gate in gates(evidence) if gate.method == chosen.method):
        return Trust(topic, "poor", f"{text} Beyond OpenSim's limits.")
    if chosen.held_out is None:
        return Trust(topic, "unknown", f"{text} Trials that were not fitted could tell more.")
    return Trust(topic, "good", f"{text} Within OpenSim's limits, which is necessary, not sufficient.")


def _geometry(chosen: MethodEvidence, evidence: Evidence) -> Trust:
    topic = "Lengths and joint centres"
    odd = implausible(chosen, evidence)
    if odd:
        return Trust(topic, "poor", f"{', '.join(odd)} would be unusual for the person's height.")
    if chosen.from_images:
        sides = [word for side, word in (("r", "right"), ("l", "left")) if f"knee_{side}" in evidence.imaged]
        whole = len(sides) == 2
        rest = "" if whole else " The other leg is inferred from it and from markers: trust it less."
        return Trust(
            topic,
            "good" if whole else "fair",
            f"From the bones of the {' and '.join(sides) or 'imaged'} leg.{rest}",
        )
    found = agreement(evidence).get(chosen.method)
    if found is not None and not math.isnan(found.worst):
        level: Level = "good" if found.worst <= AGREES else "poor"
        return Trust(topic, level, f"Up to {1e3 * found.worst:.0f} mm from the image.")
    if chosen.fits_lengths:
        return Trust(topic, "poor", "Lengths were fitted to moving skin, and no image checks them.")
    return Trust(
        topic,
        "unknown",
        f"No image checks them. {_spread(chosen)}Over 26 persons, femur lengths from markers differed from "
        "images by 4.0 ± 13.8 mm, inter-hip distances by -10.8 ± 19.9 mm (Puchaud 2019, section 3.1).",
    )


def _spread(chosen: MethodEvidence) -> str:
    """How well the lengths are known by their own errors, and which segments were not measured at all."""
    text = ""
    if chosen.length_sds:
        worst = max(chosen.length_sds, key=lambda name: chosen.length_sds[name])
        text += f"By the errors of markers and sizes, up to ± {mm(chosen.length_sds[worst])} mm ({worst}). "
    if chosen.inferred:
        text += (
            f"Not measured, so as large as in persons of this size and as other segments suggest: "
            f"{few(chosen.inferred)}. "
        )
    return text


def _angles(chosen: MethodEvidence, evidence: Evidence) -> Trust:
    topic = "Joint angles"
    others = {
        (a if b == chosen.method else b): gap
        for (a, b), gap in evidence.angles_apart.items()
        if chosen.method in (a, b)
    }
    # A method that is not trusted anyhow says little of those that are.
    apart = {n: gap for n, gap in others.items() if not evidence.method(n).fits_lengths} or others
    if not apart:
        return Trust(topic, "unknown", "No second model's angles to compare with.")
    other = max(apart, key=lambda name: apart[name][1])
    coordinate, gap = apart[other]
    where = "held-out" if chosen.held_out is not None else "fitted"
    level: Level = "good" if gap <= ANGLE_GOOD else "fair" if gap <= ANGLE_FAIR else "poor"
    offset = (
        " Most of its fitted numbers are not determined by the recordings, so angles may be offset."
        if mostly_undetermined(chosen)
        else ""
    )
    return Trust(
        topic,
        level,
        f"They depend on the method by up to {math.degrees(gap):.1f}° ({coordinate}, against {other}, RMS "
        f"over {where} trials); 5° may mislead a clinical reading.{offset}",
    )
