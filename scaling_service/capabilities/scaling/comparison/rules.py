"""The rules of a verdict on scaled models: each looks at one thing, and says what it means for each method.

No rule alone makes a model right. A small marker error is the least of the evidence: fitted lengths and
marker positions take up the movement of the skin (Puchaud 2019, sections 3.1 and 4.1).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping

from scaling_service.capabilities.scaling.comparison.evidence import (
    Evidence,
    Finding,
    Gate,
    ImageAgreement,
    MethodEvidence,
    Speaks,
)
from scaling_service.capabilities.scaling.comparison.geometry import list_unusual

Said = tuple[Speaks, str]
"""Whether a rule speaks for a method, and what it found."""

RMS_LIMIT = 0.020
MAX_LIMIT = 0.040
"""m. OpenSim 4 documentation, "Simulation with OpenSim - Best Practices": marker errors of inverse kinematics
should have an RMS under 2 cm and a maximum under 2 to 4 cm."""

NOISE = 0.001
"""m; mean errors nearer than this are taken as equal. Chosen: the level of noise at which functional methods
are tested (Ehrig et al. 2006), so less than what another day's recording changes."""

LEAST_KEPT = 0.5
"""Chosen: if less than half of what the fit gained comes back on trials that it did not see, most of the gain
belonged to those recordings, not to the person."""

FAR_ABOVE = 2.0
"""Chosen: a held-out error beyond twice the fitted one, where there is no first guess to compare with; how
skin moves differs between movements, but seldom twofold within one method here."""

MOST_UNDETERMINED = 0.5
"""Chosen: with more of the fitted numbers undetermined, the first guess says more than the recordings do. In
eight virtual persons (demo, seeds 0 to 7) such fits came nearer to the markers and, in most, moved further
from the true joint centres and angles."""

AGREES = 0.010
"""m; a length or a hip centre within this of the image agrees with it. Chosen: femur lengths of MB scatter
about the image's by 13.8 mm (Puchaud 2019, section 3.1), hip centres by 7 mm (Harrington 2007: 5.2, 3.6
and 3.2 mm along the axes)."""


def list_gates(evidence: Evidence) -> tuple[Gate, ...]:
    """OpenSim's limits on marker errors, on held-out trials where there are any."""
    found: list[Gate] = []
    for method in evidence.methods:
        judged = method.judged_on
        if judged is not None:
            held_out = method.held_out is not None
            found += [
                Gate(
                    method=method.method, quantity="rms", value=judged.rms, limit=RMS_LIMIT, held_out=held_out
                ),
                Gate(
                    method=method.method, quantity="max", value=judged.max, limit=MAX_LIMIT, held_out=held_out
                ),
            ]
    return tuple(found)


def compute_gain(method: MethodEvidence, evidence: Evidence) -> tuple[float, float] | None:
    """What a fit gained on its first guess, fitted and held out, m; None where that cannot be told."""
    start = next((m for m in evidence.methods if m.method == method.start), None)
    if start is None or not method.parameters:
        return None
    if method.fitted is None or start.fitted is None or method.held_out is None or start.held_out is None:
        return None
    return start.fitted.mean - method.fitted.mean, start.held_out.mean - method.held_out.mean


def is_overfitted(method: MethodEvidence, evidence: Evidence) -> bool:
    """Whether the fit serves its own trials much more than others."""
    gained = compute_gain(method, evidence)
    if gained is not None:
        return gained[1] < LEAST_KEPT * gained[0]
    if not method.parameters or method.fitted is None or method.held_out is None:
        return False
    return method.held_out.mean > FAR_ABOVE * method.fitted.mean + NOISE


def is_mostly_undetermined(method: MethodEvidence) -> bool:
    """Whether most of its fitted numbers are not determined by the recordings."""
    return method.undetermined > MOST_UNDETERMINED * max(method.parameters, 1)


def list_implausible_lengths(method: MethodEvidence, evidence: Evidence) -> tuple[str, ...]:
    """Its lengths that are unusual for the person's height."""
    return list_unusual(method.lengths, evidence.usual_lengths)


def measure_agreement(evidence: Evidence) -> Mapping[str, ImageAgreement]:
    """How each model agrees with the image over what was imaged; empty without an image-based method."""
    reference = evidence.reference
    if reference is None:
        return {}
    return {
        m.method: ImageAgreement(
            {
                name: m.lengths[name] - reference.lengths[name]
                for name in evidence.imaged_lengths
                if name in m.lengths and name in reference.lengths
            },
            {
                name: math.dist(centre, reference.hip_centres[name])
                for name, centre in m.hip_centres.items()
                if name in evidence.imaged and name in reference.hip_centres
            },
        )
        for m in evidence.methods
    }


def _check_gate(method: MethodEvidence, evidence: Evidence) -> Iterator[Said]:
    for gate in list_gates(evidence):
        if gate.method == method.method and not gate.passed:
            what = "RMS" if gate.quantity == "rms" else "largest"
            yield (
                "against",
                f"{what} marker error {format_mm(gate.value)} mm, limit {1e3 * gate.limit:.0f} mm",
            )


def _check_held_out(method: MethodEvidence, evidence: Evidence) -> Iterator[Said]:
    """The mean error on trials that were not fitted."""
    if method.held_out is not None:
        error = method.held_out.mean
        best = min(m.held_out.mean for m in evidence.methods if m.held_out is not None)
        near = error <= best + NOISE
        more = "" if near else f", {format_mm(error - best)} mm more than the smallest"
        yield "for" if near else "against", f"{format_mm(error)} mm on average{more}"


def _check_overfitting(method: MethodEvidence, evidence: Evidence) -> Iterator[Said]:
    gained, against = compute_gain(method, evidence), is_overfitted(method, evidence)
    if gained is not None:
        yield (
            "against" if against else "for",
            f"against {method.start} the error fell by {format_mm(gained[0])} mm on fitted trials "
            f"and by {format_mm(gained[1])} mm on held-out ones",
        )
    elif method.parameters and method.fitted is not None and method.held_out is not None:
        held_out, fitted = format_mm(method.held_out.mean), format_mm(method.fitted.mean)
        text = f"{held_out} mm held out, {fitted} mm on fitted trials"
        yield "against" if against else "neither", text


def _check_image(method: MethodEvidence, evidence: Evidence) -> Iterator[Said]:
    found = measure_agreement(evidence).get(method.method)
    if found is not None and method.from_images:
        yield "for", "its lengths and joint centres are the image's"
    elif found is not None and (found.lengths or found.hips):
        parts = [f"{length} {1e3 * gap:+.0f} mm" for length, gap in found.lengths.items()]
        parts += [f"{hip} {1e3 * gap:.0f} mm apart" for hip, gap in found.hips.items()]
        yield "for" if found.worst <= AGREES else "against", ", ".join(parts)


def _check_fitted_lengths(method: MethodEvidence, _: Evidence) -> Iterator[Said]:
    if method.fits_lengths:
        yield (
            "against",
            "its lengths were fitted to moving markers and take up skin movement: over 26 persons thighs "
            "and shanks came out 5 to 16 mm too long (Puchaud 2019, table 2)",
        )


def _check_sizes(method: MethodEvidence, evidence: Evidence) -> Iterator[Said]:
    usual = evidence.usual_lengths
    odd = [
        f"{name} {1e3 * method.lengths[name]:.0f} mm (usual {1e3 * usual[name]:.0f})"
        for name in list_implausible_lengths(method, evidence)
    ]
    if odd:
        yield "against", f"for the person's height: {', '.join(odd)}"


def _check_identifiability(method: MethodEvidence, _: Evidence) -> Iterator[Said]:
    if method.parameters:
        loose = f"{method.undetermined} of {method.parameters} fitted numbers"
        speaks: Speaks = "against" if is_mostly_undetermined(method) else "for"
        yield speaks, f"{loose} are not determined by the recordings"


def _check_bounds(method: MethodEvidence, _: Evidence) -> Iterator[Said]:
    if method.at_bounds:
        yield "against", f"{method.at_bounds} of {method.parameters} fitted numbers stopped at a bound"


RULES: Mapping[str, Callable[[MethodEvidence, Evidence], Iterator[Said]]] = {
    "quality gate": _check_gate,
    "held-out error": _check_held_out,
    "overfitting": _check_overfitting,
    "image": _check_image,
    "fitted lengths": _check_fitted_lengths,
    "implausible sizes": _check_sizes,
    "identifiability": _check_identifiability,
    "bounds": _check_bounds,
}
"""In the order in which their findings are reported. A new rule is a function and an entry."""


def find(evidence: Evidence) -> Iterator[Finding]:
    """What every rule says of every method."""
    for rule, of_method in RULES.items():
        for method in evidence.methods:
            for speaks, text in of_method(method, evidence):
                yield Finding(rule, method.method, speaks, text)


def format_mm(metres: float) -> str:
    """Millimetres as shown to people."""
    return f"{1e3 * metres:.1f}"
