"""What is said of dynamically consistent motion, once for terminal, page and report."""

from __future__ import annotations

from collections.abc import Iterable

from scaling_service.capabilities.consistent import result as documents
from scaling_service.core.names import spell_name
from scaling_service.documents.base import Tone
from scaling_service.report import tables
from scaling_service.report.summary import Summary

WAYS = ("classical", "consistent", "predicted")
SHOWN = ("fx_N", "fy_N", "mz_Nm")
HARDLY = 0.9
"""Chosen: an error of more than this share of the classical one is hardly better, and no good news."""


def summarise(document: documents.ConsistentDocument) -> Summary:
    """What was gained, what to beware of, errors and lengths."""
    settled = "." if document.converged else ", and they had not settled."
    before = document.lengths_before_mm
    rows = [
        tables.Row(spell_name(name), [f"{before[name]:.1f}", f"{after:.1f}"])
        for name, after in document.lengths_mm.items()
    ]
    return Summary(
        title=f"Dynamically consistent motion of {document.subject}",
        subtitle=describe_start(document),
        headline=document.headline,
        tone=document.tone,
        why=[f"{document.outer_iterations} loops of motion, geometry and inertia{settled}"],
        cautions=document.warnings,
        tables=[
            tabulate_errors(document),
            tables.Table(caption="Segment lengths, mm", columns=["", "start", "found"], rows=rows),
        ],
    )


def describe_start(document: documents.ConsistentDocument) -> str:
    """What the loops started from."""
    return f"start {document.start}, inertia {document.inertia}, {document.mass_kg:.1f} kg on the plates"


def write_headline(trials: Iterable[documents.ConsistentTrial]) -> tuple[str, Tone]:
    """What was gained at the forces, on recordings that were fitted and held out; whether it is good news."""
    found = list(trials)
    ratio = max(_compare_ways(t, "consistent") for t in found if not t.held_out)
    tone: Tone = "good" if ratio <= 0.5 else "fair" if ratio < 1.0 else "poor"
    said = f"The ground wrench is missed by at most {100 * ratio:.0f} % of what the classical two steps miss"
    unseen = [_compare_ways(t, "predicted") for t in found if t.held_out]
    if not unseen:
        return said, tone
    if max(unseen) > HARDLY and tone == "good":
        tone = "fair"
    return (
        f"{said}; by {100 * max(unseen):.0f} % where nothing was fitted, predicted from markers alone",
        tone,
    )


def _compare_ways(trial: documents.ConsistentTrial, way: str) -> float:
    """The worst component's error over that of the classical two steps."""
    wrenches = trial.ground_wrench_rmse
    ours: documents.GroundWrench = getattr(wrenches, way)
    return float(max(getattr(ours, n) / max(getattr(wrenches.classical, n), 1e-9) for n in SHOWN))


def tabulate_errors(document: documents.ConsistentDocument) -> tables.Table:
    """Errors of every recording in the three ways."""
    rows = []
    for name, trial in document.trials.items():
        rows.append(tables.Row(f"{name} ({'held out' if trial.held_out else 'used to fit'})"))
        for way in WAYS:
            wrench: documents.GroundWrench = getattr(trial.ground_wrench_rmse, way)
            values = [*(getattr(wrench, n) for n in SHOWN), getattr(trial.marker_rms_mm, way)]
            rows.append(tables.Row(way, [f"{value:.1f}" for value in values]))
    return tables.Table(
        caption="RMS error",
        columns=["", "fx, N", "fy, N", "mz, N m", "markers, mm"],
        rows=rows,
        note="Classical: inverse kinematics, filter and derivatives with the model it started "
        "from. Consistent: "
        "markers and forces followed together by the model found. Predicted: the classical two steps with "
        "the model found, so that forces of this recording played no part in its motion. Moments are about "
        "the middle of the feet.",
    )
