"""Which scaled model to use for a person, why, and how far to trust it, by rules that are stated."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Literal

from scaling_service.capabilities.scaling.comparison.evidence import (
    Evidence,
    MethodEvidence,
    Strength,
    Verdict,
)
from scaling_service.capabilities.scaling.comparison.rules import (
    AGREES,
    NOISE,
    find,
    format_mm,
    is_mostly_undetermined,
    is_overfitted,
    list_gates,
    list_implausible_lengths,
    measure_agreement,
)
from scaling_service.core.text import list_few
from scaling_service.documents.results import TrustNote

Level = Literal["good", "fair", "poor", "unknown"]
"""How far something can be trusted; ``unknown`` where nothing was measured that could tell."""

Graded = tuple[Level, str]
"""How far to trust something, and why."""

RULES_IN_WORDS = (
    "Models that pass OpenSim's limits on marker errors are preferred to those that do not. Passing proves "
    "nothing.",
    "Where bones were imaged, an image-based model is used: its lengths and joint centres are seen, not "
    "inferred from skin.",
    "Of a model and its refinement by moved markers and turned knee axes, the refinement is used where it "
    "follows held-out trials better by more than the noise (1 mm), at least half of its gain on fitted "
    "trials was kept on held-out ones, and the recordings determine most of its fitted numbers.",
    "A refinement that is better but mostly undetermined is not used, and the verdict then only leans. Over "
    "26 persons such refinements agreed best with images (MB_am) or were the reference for joint angles "
    "(EB_am; Puchaud 2019); in virtual persons, whose truth is known, they moved hip centres away from it, "
    "from 4 to 11 mm (EB, EB_am) and from 9 to 13 mm (MB, MB_am; means of 8).",
    "A model whose lengths were fitted is not preferred, however small its error: over 26 persons lengths of "
    "MB_lam drifted (Puchaud 2019).",
    "Without images the verdict at most leans. It is undecided where no trial was held out, no model passes "
    "the limits, a better refinement is mostly undetermined and no image speaks for either, fitted numbers "
    "stop at bounds, a length is implausible for the person's height, or only one method was computed.",
)
"""What :func:`judge` does, for a reader of its verdict."""


def judge(evidence: Evidence) -> Verdict:
    """The verdict on a person's scaled models, by :data:`RULES_IN_WORDS`.

    ``evidence``: of at least one method.
    Raises ValueError: there is no method.

    Examples
    --------
    >>> from scaling_service.capabilities.scaling.comparison.evidence import Following
    >>> near, far = Following(0.004, 0.005, 0.012, 2), Following(0.009, 0.011, 0.025, 2)
    >>> bones = MethodEvidence(method="EB", from_images=True, fitted=far, held_out=far)
    >>> fitted = MethodEvidence(
    ...     method="EB_am", start="EB", from_images=True, fitted=near, held_out=near, parameters=50
    ... )
    >>> found = judge(Evidence((bones, fitted), frozenset({"hip_r", "knee_r", "ankle_r"})))
    >>> found.method, found.strength
    ('EB_am', 'decided')
    """
    if not evidence.methods:
        raise ValueError("a verdict needs at least one method")
    chosen = _choose(_select_eligible(evidence), evidence)
    doubts = tuple(_list_doubts(chosen, evidence))
    unchecked = tuple(_list_unchecked(chosen, evidence))
    strength: Strength = "undecided" if doubts else "leaning" if unchecked else "decided"
    return Verdict(
        method=chosen.method,
        strength=strength,
        headline=_write_headline(chosen, strength, alone=len(evidence.methods) == 1),
        why=(*_explain_choice(chosen, evidence), *doubts, *unchecked),
        trust=rate_trust(chosen, evidence),
        gates=list_gates(evidence),
        findings=tuple(find(evidence)),
    )


def _select_eligible(evidence: Evidence) -> Sequence[MethodEvidence]:
    """Image-based models that pass the gates, else other models that pass, else all."""
    passing = [m for m in evidence.methods if m.method not in _list_failed(evidence)]
    return [m for m in passing if m.from_images] or passing or evidence.methods


def _list_failed(evidence: Evidence) -> set[str]:
    return {gate.method for gate in list_gates(evidence) if not gate.passed}


def _choose(pool: Sequence[MethodEvidence], evidence: Evidence) -> MethodEvidence:
    """A proven refinement, else the plain model; one with fitted lengths only where there is no other."""
    plain = next((m for m in pool if not m.parameters), None)
    refined = [m for m in pool if m.parameters and not m.fits_lengths]
    proven = [m for m in refined if _is_better(m, plain, evidence) and not is_mostly_undetermined(m)]
    if proven:
        return min(proven, key=_average_error)
    return plain or min(refined or pool, key=_average_error)


def _is_better(refined: MethodEvidence, plain: MethodEvidence | None, evidence: Evidence) -> bool:
    """Whether it follows held-out trials better, by more than the noise, and not its own trials alone."""
    if refined.held_out is None or is_overfitted(refined, evidence):
        return False
    return plain is None or plain.held_out is None or refined.held_out.mean < plain.held_out.mean - NOISE


def _average_error(method: MethodEvidence) -> float:
    return math.inf if method.judged_on is None else method.judged_on.mean


def _list_doubts(chosen: MethodEvidence, evidence: Evidence) -> Iterator[str]:
    """What keeps the evidence from deciding."""
    if len(evidence.methods) == 1:
        yield f"Only {chosen.method} was computed, so there is nothing to compare it with."
    if chosen.held_out is None:
        yield "No trial was held out, so nothing shows how any model follows what it was not fitted to."
    if chosen.method in _list_failed(evidence):
        yield "No model passes the limits on marker errors: look for mislabelled or strayed markers first."
    elif evidence.reference is not None and not chosen.from_images:
        yield (
            "The image-based models do not pass the limits on marker errors: check that bones and recordings "
            "are of one person."
        )
    if not chosen.from_images and is_mostly_undetermined(chosen):
        yield (
            f"{chosen.undetermined} of its {chosen.parameters} fitted numbers are not determined by the "
            "recordings: where pelvis and thighs lie among their markers rests on the first guess."
        )
    if evidence.reference is None:
        yield from _open_questions(chosen, evidence)
    if chosen.at_bounds:
        yield (
            f"{chosen.at_bounds} of its {chosen.parameters} fitted numbers stopped at a bound: that is a "
            "limit that was set, not a finding."
        )
    odd = list_implausible_lengths(chosen, evidence)
    if odd:
        yield _describe_unusual(odd)


def _describe_unusual(lengths: Sequence[str]) -> str:
    return f"{', '.join(lengths)} would be unusual for the person's height."


def _list_unchecked(chosen: MethodEvidence, evidence: Evidence) -> Iterator[str]:
    if not chosen.from_images and evidence.reference is None:
        yield (
            "No image-based model was computed, so nothing checks the lengths and joint centres of any model."
        )
    if evidence.reference is not None:
        yield from _open_questions(chosen, evidence)


def _open_questions(chosen: MethodEvidence, evidence: Evidence) -> Iterator[str]:
    """Refinements of the model chosen that are better, but mostly undetermined."""
    for m in evidence.methods:
        refines = m.start == chosen.method and m.parameters and not m.fits_lengths
        if refines and is_mostly_undetermined(m) and _is_better(m, chosen, evidence):
            yield (
                f"Over a cohort {m.method} was taken for the better model (Puchaud 2019): compare the joint "
                f"angles of {chosen.method} and {m.method}, and rely on what both show."
            )


def _write_headline(chosen: MethodEvidence, strength: Strength, *, alone: bool) -> str:
    if strength == "decided":
        return f"Use {chosen.method} for this person."
    if alone:
        return f"{chosen.method} was the only method computed: nothing here confirms it."
    if strength == "leaning" and chosen.from_images:
        return f"Use {chosen.method} for lengths and joint centres; on joint angles the evidence only leans."
    if strength == "leaning":
        return f"The recordings favour {chosen.method}, but no image checks it."
    return f"The evidence does not decide. It leans to {chosen.method}."


def _explain_choice(chosen: MethodEvidence, evidence: Evidence) -> Iterator[str]:
    """What speaks for the choice, and why a smaller error elsewhere is not enough."""
    if chosen.from_images:
        yield f"Joint centres and lengths of {chosen.method} come from this person's bones."
    start = next((m for m in evidence.methods if m.method == chosen.start), None)
    if chosen.held_out is not None:
        against = (
            f", {start.method} to {format_mm(start.held_out.mean)} mm"
            if start is not None and start.held_out is not None and chosen.parameters
            else ""
        )
        yield (
            f"On held-out trials {chosen.method} follows the markers to "
            f"{format_mm(chosen.held_out.mean)} mm on average{against}."
        )
        refused = list(_explain_nearer_but_refused(chosen, evidence, chosen.held_out.mean))
        yield from refused
        if refused:
            yield "A small error alone is no proof of a right model."
    failed = [m.method for m in evidence.methods if m.method in _list_failed(evidence)]
    if failed and chosen.method not in failed:
        yield f"{list_few(failed)} {'fails' if len(failed) == 1 else 'fail'} a limit on marker errors."


def _explain_nearer_but_refused(chosen: MethodEvidence, evidence: Evidence, error: float) -> Iterator[str]:
    for m in evidence.methods:
        if m.held_out is not None and m.held_out.mean < error:
            reasons = list(_explain_refusal(m, chosen, evidence))
            if error - m.held_out.mean <= NOISE:
                reasons.append("the difference is within the noise")
            if reasons:
                nearer = format_mm(m.held_out.mean)
                yield f"{m.method} follows them to {nearer} mm, but {' and '.join(reasons)}."


def _explain_refusal(method: MethodEvidence, chosen: MethodEvidence, evidence: Evidence) -> Iterator[str]:
    if method.method in _list_failed(evidence):
        yield "it fails a limit on marker errors"
    if method.fits_lengths:
        yield f"its lengths were fitted to moving skin{_describe_off_image(method, evidence)}"
    elif chosen.from_images and not method.from_images:
        yield (
            "its lengths and joint centres are inferred from skin markers"
            f"{_describe_off_image(method, evidence)}"
        )
    if is_mostly_undetermined(method):
        yield f"{method.undetermined} of its {method.parameters} fitted numbers are not determined"
    if is_overfitted(method, evidence):
        yield "it kept too little of its gain on held-out trials"


def _describe_off_image(method: MethodEvidence, evidence: Evidence) -> str:
    found = measure_agreement(evidence).get(method.method)
    if found is None or math.isnan(found.worst):
        return ""
    return f" (up to {1e3 * found.worst:.0f} mm from the image)"


ANGLE_GOOD = math.radians(2.0)
ANGLE_FAIR = math.radians(5.0)
"""McGinley et al. 2009 (Gait Posture 29:360-369), discussion: errors of 2 deg or less are likely to be
acceptable, between 2 and 5 deg reasonable with some care, beyond 5 deg they may mislead a reader."""


def rate_trust(chosen: MethodEvidence, evidence: Evidence) -> tuple[TrustNote, ...]:
    """One line each for markers, for lengths and joint centres, and for joint angles."""
    topics = {
        "Following the markers": _rate_markers(chosen, evidence),
        "Lengths and joint centres": _rate_geometry(chosen, evidence),
        "Joint angles": _rate_angles(chosen, evidence),
    }
    return tuple(TrustNote(topic=t, level=level, text=text) for t, (level, text) in topics.items())


def _rate_markers(chosen: MethodEvidence, evidence: Evidence) -> Graded:
    judged = chosen.judged_on
    if judged is None:
        return "unknown", "No movement was recorded."
    where = "held-out" if chosen.held_out is not None else "fitted"
    text = f"{format_mm(judged.mean)} mm on average, {format_mm(judged.max)} mm at most on {where} trials."
    if not all(gate.passed for gate in list_gates(evidence) if gate.method == chosen.method):
        return "poor", f"{text} Beyond OpenSim's limits."
    if chosen.held_out is None:
        return "unknown", f"{text} Trials that were not fitted could tell more."
    return "good", f"{text} Within OpenSim's limits, which is necessary, not sufficient."


def _rate_geometry(chosen: MethodEvidence, evidence: Evidence) -> Graded:
    odd = list_implausible_lengths(chosen, evidence)
    if odd:
        return "poor", _describe_unusual(odd)
    if chosen.from_images:
        sides = [word for side, word in (("r", "right"), ("l", "left")) if f"knee_{side}" in evidence.imaged]
        whole = len(sides) == 2
        rest = "" if whole else " The other leg is inferred from it and from markers: trust it less."
        return (
            "good" if whole else "fair",
            f"From the bones of the {' and '.join(sides) or 'imaged'} leg.{rest}",
        )
    found = measure_agreement(evidence).get(chosen.method)
    if found is not None and not math.isnan(found.worst):
        level: Level = "good" if found.worst <= AGREES else "poor"
        return level, f"Up to {1e3 * found.worst:.0f} mm from the image."
    if chosen.fits_lengths:
        return "poor", "Lengths were fitted to moving skin, and no image checks them."
    return (
        "unknown",
        f"No image checks them. {_spread(chosen)}Over 26 persons, femur lengths from markers differed from "
        "images by 4.0 ± 13.8 mm, inter-hip distances by -10.8 ± 19.9 mm (Puchaud 2019, section 3.1).",
    )


def _spread(chosen: MethodEvidence) -> str:
    """How well the lengths are known by their own errors, and which segments were not measured at all."""
    text = ""
    if chosen.length_sds:
        worst = max(chosen.length_sds, key=lambda name: chosen.length_sds[name])
        sd = format_mm(chosen.length_sds[worst])
        text += f"By the errors of markers and sizes, up to ± {sd} mm ({worst}). "
    if chosen.inferred:
        text += (
            f"Not measured, so as large as in persons of this size and as other segments suggest: "
            f"{list_few(chosen.inferred)}. "
        )
    return text


def _rate_angles(chosen: MethodEvidence, evidence: Evidence) -> Graded:
    others = {
        (a if b == chosen.method else b): gap
        for (a, b), gap in evidence.angles_apart.items()
        if chosen.method in (a, b)
    }
    # A method that is not trusted anyhow says little of those that are.
    apart = {n: gap for n, gap in others.items() if not evidence.method(n).fits_lengths} or others
    if not apart:
        return "unknown", "No second model's angles to compare with."
    other = max(apart, key=lambda name: apart[name][1])
    coordinate, gap = apart[other]
    where = "held-out" if chosen.held_out is not None else "fitted"
    level: Level = "good" if gap <= ANGLE_GOOD else "fair" if gap <= ANGLE_FAIR else "poor"
    offset = (
        " Most of its fitted numbers are not determined by the recordings, so angles may be offset."
        if is_mostly_undetermined(chosen)
        else ""
    )
    return (
        level,
        f"They depend on the method by up to {math.degrees(gap):.1f}° ({coordinate}, against {other}, RMS "
        f"over {where} trials); 5° may mislead a clinical reading.{offset}",
    )
