"""The chapter on residuals: over time, and against published limits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import plotly.graph_objects as go

from scaling_service.capabilities.dynamics.document import TrialDynamicsDocument
from scaling_service.capabilities.dynamics.report.data import DynamicsData, ResidualCurves
from scaling_service.report.blocks import Block, Cell, Grid, Heading, Legend, Row, Table, Text
from scaling_service.report.figures import Figure, chart
from scaling_service.report.methods import FAINT
from scaling_service.report.page import Section

AXES = (("x, forward", "#0072B2", "solid"), ("y, up", "#D55E00", "dash"), ("z, right", "#009E73", "dot"))
"""Name, colour and dash of each axis; colours of Okabe & Ito 2008."""

_WHAT = "The residual is the force and moment that the motion needs and the plates do not show."


def residuals_section(data: DynamicsData) -> Section:
    """Residuals of every recording."""
    return Section("Residuals", list(_blocks(data)), new_page=True)


def _blocks(data: DynamicsData) -> Iterator[Block]:
    yield Text(
        f"{_WHAT} Its moment is about the origin of the root segment. Grey lines: the peak that Hicks et al. "
        "2015 allow, 5 % of the net external force, and 1 % of it times the height of the centre of mass."
    )
    yield Legend([*AXES, ("limit of Hicks et al. 2015", FAINT, "solid")])
    for name, curves in data.curves.items():
        trial = data.document.trials[name]
        yield Heading(f"{name} ({trial.role}), forces from {trial.forces_from}")
        yield Grid([_figure(name, trial, curves, force) for force in (True, False)])
    yield _gates(data)
    yield _rms(data)


def _figure(name: str, trial: TrialDynamicsDocument, curves: ResidualCurves, force: bool) -> Figure:
    what, unit, first = ("force", "N", 0) if force else ("moment", "N m", 3)
    limit = next(
        gate.limit for gate in trial.gates if gate.name == f"peak {what}" and gate.source == "Hicks 2015"
    )
    traces = [
        go.Scatter(
            x=np.round(curves.times, 4),
            y=np.round(curves.residual[:, first + k], 2).astype(np.float32),
            name=axis,
            mode="lines",
            line={"color": colour, "dash": dash, "width": 1.5},
            hovertemplate=f"%{{y:.1f}} {unit}",
        )
        for k, (axis, colour, dash) in enumerate(AXES)
    ]
    bounds = [
        {
            "type": "line",
            "xref": "paper",
            "x0": 0,
            "x1": 1,
            "y0": sign * limit,
            "y1": sign * limit,
            "line": {"color": FAINT, "width": 1.5},
        }
        for sign in (1, -1)
    ]
    drawn = chart(traces, x_title="time, s", y_title=f"residual {what}, {unit}", shapes=bounds)
    peaks = np.nanmax(np.abs(curves.residual[:, first : first + 3]), axis=0)
    said = ", ".join(f"{axis} {peak:.0f}" for (axis, _, _), peak in zip(AXES, peaks, strict=True))
    return Figure(
        drawn,
        f"{name}: residual {what}",
        f"Residual {what} of {name} over time, {unit}. Largest: {said}. Limit {limit:.0f}.",
        240,
    )


def _gates(data: DynamicsData) -> Table:
    trials = data.document.trials
    first = next(iter(trials.values()))
    rows = [
        Row(
            f"{gate.source}: {gate.name}, {gate.unit}",
            [_gate_cell(trial, k) for trial in trials.values()],
        )
        for k, gate in enumerate(first.gates)
    ]
    return Table(
        "Residuals against published limits: value (limit)",
        ["", *trials],
        rows,
        "Hicks et al. 2015 (J Biomech Eng 137:020905, table 2) and OpenSim's simulation checklist, which "
        "holds for walking. Keeping them is necessary, not sufficient.",
    )


def _gate_cell(trial: TrialDynamicsDocument, k: int) -> Cell:
    gate = trial.gates[k]
    return Cell(
        f"{gate.value:.0f} ({gate.limit:.0f}) {'kept' if gate.passed else 'broken'}",
        tone="good" if gate.passed else "poor",
    )


def _rms(data: DynamicsData) -> Table:
    trials = data.document.trials
    rows = [
        Row(
            key.replace("_", ", ").replace("Nm", "N m"),
            [f"{getattr(trial.residual_rms, key):.1f}" for trial in trials.values()],
        )
        for key in next(iter(trials.values())).residual_rms.model_dump()
    ]
    counts = [
        Row("frames that count", [str(t.frames) for t in trials.values()]),
        Row("frames left out", [str(t.left_out) for t in trials.values()]),
    ]
    return Table(
        "RMS of the residual",
        ["", *trials],
        [*rows, *counts],
        "Left out: frames whose motion or forces are not all known, and half a period of the filter's cutoff "
        "at both ends of the others.",
    )
