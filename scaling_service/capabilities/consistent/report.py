"""The report of dynamically consistent motion: what it gained, then wrench, markers, lengths and inertia."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import plotly.graph_objects as go

from scaling_service.capabilities.consistent.document import ConsistentDocument, GroundWrench
from scaling_service.capabilities.consistent.run import ConsistentResults
from scaling_service.numerics.multibody.laws import Array
from scaling_service.report.blocks import (
    Block,
    Callout,
    Grid,
    Heading,
    Legend,
    Page,
    Row,
    Section,
    Table,
    Text,
    Tone,
)
from scaling_service.report.figures import Figure, escape_plain, make_chart
from scaling_service.report.methods import INK
from scaling_service.report.provenance import build_origin_blocks

WAYS = (("classical", "#0072B2", "dash"), ("consistent", "#D55E00", "solid"), ("predicted", "#009E73", "dot"))
"""Name, colour and dash; colours of Okabe & Ito 2008."""

NAMES = (
    "force forward, N",
    "force up, N",
    "force right, N",
    "moment x, N m",
    "moment y, N m",
    "moment z, N m",
)
SHOWN = ("fx_N", "fy_N", "mz_Nm")
MOVED = 12
"""Inertial parameters listed: those that moved most (chosen); all are in consistent.json."""


def build_consistent_page(document: ConsistentDocument, results: ConsistentResults) -> Page:
    """The page of one person's dynamically consistent motion."""
    return Page(
        f"Dynamically consistent motion of {document.subject}",
        [
            Section("What it gained", list(_build_gain(document))),
            Section("Ground wrench", list(_build_wrenches(results)), new_page=True),
            Section("Markers", list(_build_markers(results)), new_page=True),
            Section("Lengths and inertia", list(_build_body(document)), new_page=True),
            Section(
                "Where this comes from", list(build_origin_blocks(document, document.warnings)), new_page=True
            ),
        ],
        subtitle=f"Start: {document.start}, inertia: {document.inertia}, "
        f"{document.mass_kg:.1f} kg on the plates",
        footer=f"scaling-service {document.code_version}. The numbers are in consistent.json, too.",
    )


def _build_gain(document: ConsistentDocument) -> Iterator[Block]:
    fitted = [t for t in document.trials.values() if not t.held_out]
    ratio = max(
        getattr(t.ground_wrench_rmse.consistent, n) / max(getattr(t.ground_wrench_rmse.classical, n), 1e-9)
        for t in fitted
        for n in SHOWN
    )
    tone: Tone = "good" if ratio <= 0.5 else "fair" if ratio < 1.0 else "poor"
    yield Callout(
        f"The ground wrench is missed by at most {100 * ratio:.0f} % "
        "of what the classical two steps miss it by",
        [
            Text(
                f"{document.outer_iterations} loops of motion, geometry and inertia"
                + ("." if document.converged else ", and they had not settled.")
            )
        ],
        tone,
    )
    yield tabulate_errors(document)


def tabulate_errors(document: ConsistentDocument) -> Table:
    """Errors of every recording in the three ways."""
    rows = []
    for name, trial in document.trials.items():
        rows.append(Row(f"{name} ({'held out' if trial.held_out else 'used to fit'})"))
        for way, _, _ in WAYS:
            wrench: GroundWrench = getattr(trial.ground_wrench_rmse, way)
            values = [*(getattr(wrench, n) for n in SHOWN), getattr(trial.marker_rms_mm, way)]
            rows.append(Row(way, [f"{value:.1f}" for value in values]))
    return Table(
        caption="RMS error",
        columns=["", "fx, N", "fy, N", "mz, N m", "markers, mm"],
        rows=rows,
        note="Classical: inverse kinematics, filter and derivatives with the model it started "
        "from. Consistent: "
        "markers and forces followed together by the model found. Predicted: the classical two steps with "
        "the model found, so that forces of this recording played no part in its motion. Moments are about "
        "the middle of the feet.",
    )


def _build_wrenches(results: ConsistentResults) -> Iterator[Block]:
    yield Legend([("measured", INK, "solid"), *WAYS])
    for recording, ways in results.tracked:
        curves = {"measured": recording.wrench}
        curves |= {way: recording.wrench - tracked.gaps.wrench_gaps for way, tracked in ways.items()}
        yield Heading(recording.name)
        yield Grid(
            [
                _draw_wrench(recording.name, recording.trial.times, curves, k)
                for k in range(6)
                if recording.components[k]
            ]
        )


def _draw_wrench(name: str, times: Array, curves: Mapping[str, Array], k: int) -> Figure:
    traces = [
        go.Scatter(
            x=np.round(times, 4),
            y=np.round(curves[way][:, k], 2).astype(np.float32),
            name=way,
            mode="lines",
            line={"color": colour, "dash": dash, "width": 2.5 if way == "measured" else 1.5},
        )
        for way, colour, dash in (("measured", INK, "solid"), *WAYS)
    ]
    drawn = make_chart(traces, x_title="time, s", y_title=NAMES[k])
    return Figure(
        drawn, f"{name}: {NAMES[k]}", f"{NAMES[k]} of {name} over time, measured and in three ways.", 230
    )


def _build_markers(results: ConsistentResults) -> Iterator[Block]:
    yield Text(
        "RMS distance of each marker from the model's. What follows forces follows markers less closely."
    )
    yield Legend([(n, c, "solid") for n, c, _ in WAYS[:2]])
    for recording, ways in results.tracked:
        traces = [
            go.Bar(
                x=[escape_plain(m) for m in recording.motion.markers],
                y=np.round(1e3 * np.sqrt(np.mean(ways[way].gaps.marker_gaps ** 2, axis=0).sum(axis=1)), 2),
                name=way,
                marker={"color": colour},
            )
            for way, colour, _ in WAYS[:2]
        ]
        drawn, name = make_chart(traces, y_title="mm", barmode="group"), recording.name
        yield Figure(drawn, f"{name}: markers", f"RMS distance of every marker of {name}, mm.", 280)


def _build_body(document: ConsistentDocument) -> Iterator[Block]:
    rows = [
        Row(name, [f"{document.lengths_before_mm[name]:.1f}", f"{after:.1f}"])
        for name, after in document.lengths_mm.items()
    ]
    yield Table(caption="Segment lengths, mm", columns=["", "start", "found"], rows=rows)
    moved = sorted(document.inertial, key=lambda p: -abs(p.moved))[:MOVED]
    yield Table(
        caption="Inertial parameters that moved most",
        columns=["", "table", "found", "SD", "moved, SD of the prior"],
        rows=[
            Row(
                f"{p.segment}, {p.quantity}",
                [f"{p.before:.4g}", f"{p.after:.4g}", f"{p.sd:.2g}", f"{p.moved:+.1f}"],
            )
            for p in moved
        ],
        note="kg, m, kg m2; tensors about the centre of mass.",
    )
