"""Which scaled model to use for a person, why, and how far to trust it, by the posterior's deviations.

Methods are not ranked by how near they come to the markers: what is free takes up skin, so that the nearest
model is often the one furthest from the bones (Puchaud 2019, sections 3.1 and 4.1).
"""

from __future__ import annotations

import math
from collections import abc
from typing import Literal

from scaling_service.capabilities.scaling.comparison import evidence as judging
from scaling_service.capabilities.scaling.comparison.geometry import list_unusual
from scaling_service.core.names import say_names, say_parameters, spell_name
from scaling_service.core.text import list_few
from scaling_service.documents.base import Tone
from scaling_service.documents.results import TrustNote, VerdictDocument

ANSWER = "MAP"
"""The method that weighs markers, images and what is ordinary in people, and states what is left open."""

STRANGE = 3.0
"""Chosen: skin that moves so many times as much as is ordinary is another thing. Persons differ by a quarter
to a half, so this is more than two deviations (in logarithms, of a half) from what is ordinary."""

LENGTH_GOOD, LENGTH_FAIR = 0.010, 0.020
"""m, one standard deviation. Chosen: femur lengths of linear scaling scatter about images' by 13.8 mm
(Puchaud 2019, section 3.1), hip centres by regression by 7 mm along one axis."""

ANGLE_GOOD, ANGLE_FAIR = math.radians(2.0), math.radians(5.0)
"""McGinley et al. 2009 (Gait Posture 29:360-369), discussion: errors of 2 deg or less are likely to be
acceptable, between 2 and 5 deg reasonable with some care, beyond 5 deg they may mislead a reader."""

Strength = Literal["decided", "leaning", "undecided"]
TONES: abc.Mapping[Strength, Tone] = {"decided": "good", "leaning": "fair", "undecided": "unknown"}
"""Whether recordings and images say more of the person than people in general do, less, or contradict it."""

Level = Literal["good", "fair", "poor", "unknown"]
"""How far something can be trusted; ``unknown`` where nothing is known that could tell."""

Graded = tuple[Level, str]
"""How far to trust something, and why."""


def judge(evidence: judging.Evidence) -> VerdictDocument:
    """The verdict on a person's scaled models.

    Its method is the one to use, or what comes nearest to it where that was not computed.

    ``evidence``: of at least one method.
    Raises ValueError: there is no method.

    Examples
    --------
    >>> from scaling_service.capabilities.scaling.comparison.evidence import Following
    >>> near, far = Following(0.004, 0.012), Following(0.009, 0.025)
    >>> fitted = judging.MethodEvidence(method="MB_lam", held_out=near)
    >>> weighed = judging.MethodEvidence(
    ...     method="MAP", skin=1.1, held_out=far, length_sds={"femur_r": 0.008}, angle_sds={"hip": 0.05}
    ... )
    >>> found = judge(judging.Evidence((fitted, weighed)))
    >>> found.method, found.strength, found.headline
    ('MAP', 'decided', 'Use MAP for this person: lengths to ± 8 mm, joint angles to ± 2.9°.')
    """
    if not evidence.methods:
        raise ValueError("a verdict needs at least one method")
    answer = next((m for m in evidence.methods if m.method == ANSWER), None)
    chosen = answer or evidence.reference or evidence.methods[0]
    # What speaks against the model, or against the recordings that it was made from
    doubts: list[str] = []
    if chosen.method != ANSWER:
        doubts.append(
            f"{ANSWER} was not computed. Other methods hold something fixed that nobody knows, and their "
            f"distance from the markers does not tell how wrong that is."
        )
    if chosen.skin is not None and chosen.skin > STRANGE:
        doubts.append(
            f"Markers move {chosen.skin:.1f} times as much over the bones as skin ordinarily does: look for "
            f"mislabelled or strayed markers{_describe_moment(chosen.worst)}, loose clothing, or a body that "
            "the model does not describe."
        )
    doubts += [f"{said}." for said in evidence.contradictions]
    odd = list_unusual(chosen.lengths, evidence.usual_lengths)
    if odd:
        doubts.append(f"{_describe_unusual(odd)} Check height, units and labels.")
    strength: Strength = "undecided" if doubts else "leaning" if chosen.by_people else "decided"
    why = [f"{stop}." for stop in chosen.stops]
    if chosen.method == ANSWER:
        images = "images, " if evidence.imaged else ""
        why.append(
            f"It weighs {images}markers and movements with what is ordinary in people, and every deviation "
            "counts what they leave open; deviations are one standard deviation of the worst."
        )
    if chosen.by_people:
        known = list_few(say_parameters(chosen.by_people))
        why.append(f"People in general say more about {known} than these recordings do.")
    own = chosen.judged_on
    judged = {m.method: m.judged_on for m in evidence.methods if m.judged_on is not None}
    nearer = [name for name, other in judged.items() if own is not None and other.mean < own.mean]
    if nearer:
        why.append(
            f"{list_few(nearer)} {'comes' if len(nearer) == 1 else 'come'} nearer to the markers, which is "
            "no merit: what is free takes up skin, and of virtual persons such models are further from the "
            "bones."
        )
    # One line each for markers, for lengths and joint centres, and for joint angles.
    topics = {
        "Following the markers": _rate_markers(chosen),
        "Lengths and joint centres": _rate_geometry(chosen, evidence),
        "Joint angles": _rate_angles(chosen),
    }
    return VerdictDocument(
        method=chosen.method,
        strength=strength,
        headline=_write_headline(chosen, strength, evidence),
        tone=TONES[strength],
        why=[*doubts, *why],
        trust=[TrustNote(topic=t, level=level, text=text) for t, (level, text) in topics.items()],
    )


def _describe_moment(worst: judging.Moment | None) -> str:
    if worst is None:
        return ""
    distance = f"{1e3 * worst.distance:.0f} mm"
    return f" ({worst.marker} is farthest, {distance} in {worst.trial} at {worst.time:.2f} s)"


def _describe_unusual(lengths: tuple[str, ...]) -> str:
    return f"{say_names(lengths)} would be unusual for the person's height."


def _write_headline(chosen: judging.MethodEvidence, strength: Strength, evidence: judging.Evidence) -> str:
    if chosen.method != ANSWER:
        return f"{chosen.method} is one estimate of several: compute {ANSWER} to know how far to trust it."
    if strength == "undecided":
        images = " and images" if evidence.imaged else ""
        return f"Look at the recordings{images} before you use any model of this person."
    known = [
        f"{what} to ± {unit(max(sds.values()))}"
        for what, sds, unit in (
            ("lengths", chosen.length_sds, lambda metres: f"{1e3 * metres:.0f} mm"),
            ("joint angles", chosen.angle_sds, _format_deg),
        )
        if sds
    ]
    said = f": {', '.join(known)}" if known else ""
    if strength == "leaning":
        return f"Use {ANSWER} for this person, which leans on what is ordinary in people{said}."
    return f"Use {ANSWER} for this person{said}."


def _rate_markers(chosen: judging.MethodEvidence) -> Graded:
    judged = chosen.judged_on
    if judged is None:
        return "unknown", "No movement was recorded."
    where = "held-out" if chosen.held_out is not None else "fitted"
    text = f"{format_mm(judged.mean)} mm on average, {format_mm(judged.max)} mm at most on {where} trials."
    if chosen.skin is None:
        return "unknown", f"{text} How much of it is skin is not known."
    level = _grade(chosen.skin, STRANGE / 1.5, STRANGE)
    return (
        level,
        f"{text} Markers move {chosen.skin:.1f} times as much over the bones as skin ordinarily does.",
    )


def _rate_geometry(chosen: judging.MethodEvidence, evidence: judging.Evidence) -> Graded:
    if evidence.contradictions:
        return "poor", f"What they rest on contradicts itself: {evidence.contradictions[0]}."
    odd = list_unusual(chosen.lengths, evidence.usual_lengths)
    if odd:
        return "poor", _describe_unusual(odd)
    text = " ".join(
        f"{what} to ± {format_mm(sds[worst])} mm ({spell_name(worst)})."
        for what, sds in (("Lengths", chosen.length_sds), ("Hip centres in the pelvis", chosen.centre_sds))
        if sds
        for worst in [max(sds, key=lambda name: sds[name])]
    )
    if chosen.method != ANSWER or not text:
        return "unknown", f"{text} What {chosen.method} holds fixed is not counted.".strip()
    return _grade(max(chosen.length_sds.values(), default=math.inf), LENGTH_GOOD, LENGTH_FAIR), text


def _rate_angles(chosen: judging.MethodEvidence) -> Graded:
    if not chosen.angle_sds:
        return "unknown", "Their deviations are not known here: see `ik`."
    sds: abc.Mapping[str, float] = chosen.angle_sds
    worst = max(sds, key=lambda name: sds[name])
    most = f"{_format_deg(sds[worst])} at most ({spell_name(worst)})"
    text = f"To ± {most}, RMS over frames; 5° may mislead a reader."
    return _grade(sds[worst], ANGLE_GOOD, ANGLE_FAIR), text


def _grade(value: float, good: float, fair: float) -> Level:
    return "good" if value <= good else "fair" if value <= fair else "poor"


def format_mm(metres: float) -> str:
    """Millimetres as shown to people."""
    return f"{1e3 * metres:.1f}"


def _format_deg(angle: float) -> str:
    return f"{math.degrees(angle):.1f}°"
