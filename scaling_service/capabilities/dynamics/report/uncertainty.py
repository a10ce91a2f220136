"""The chapter on uncertainty: how much of a residual the measurement explains."""

from __future__ import annotations

import math
from collections.abc import Iterator

import plotly.graph_objects as go

from scaling_service.capabilities.dynamics.document import TrialDynamicsDocument
from scaling_service.capabilities.dynamics.report.data import COMPONENTS, DynamicsData
from scaling_service.report.blocks import Block, Cell, Grid, Legend, Row, Table, Text
from scaling_service.report.figures import Figure, chart
from scaling_service.report.methods import FAINT, INK
from scaling_service.report.page import Section

_PLATE = "#0072B2"
_FROM_TO = (1e-4, 100.0)  # %; chosen: from below any plate's noise to the whole body weight

_WHAT = (
    "Errors of markers and plates alone give a residual, whatever the inertia. Where the residual stands "
    "below that, nothing can be learnt of the inertia from it: an identification would fit noise."
)
_HOW = (
    "Motions with a larger reconstruction error are drawn and filtered as the measured one; the dispersion "
    "of their residuals grows in proportion to the added error. At an added error as large as the "
    "recording's own it is the kinematic uncertainty (Muller et al. 2017)."
)


def uncertainty_section(data: DynamicsData) -> Section:
    """Residual indicator and uncertainty of every recording."""
    return Section("Residual against its uncertainty", list(_blocks(data)), new_page=True)


def _blocks(data: DynamicsData) -> Iterator[Block]:
    yield Text(f"{_WHAT} {_HOW}")
    yield Legend(
        [
            ("residual", INK, "solid"),
            ("uncertainty by the motion", FAINT, "solid"),
            ("uncertainty by the plates", _PLATE, "solid"),
        ]
    )
    yield Grid([_bars(name, trial) for name, trial in data.document.trials.items()])
    for name, trial in data.document.trials.items():
        yield _table(name, trial)


def _bars(name: str, trial: TrialDynamicsDocument) -> Figure:
    low, high = _FROM_TO
    sets = (
        ("residual", trial.dr, INK),
        ("by the motion", trial.uncertainty.kinematic, FAINT),
        ("by the plates", trial.uncertainty.plate, _PLATE),
    )
    traces = [
        go.Bar(
            x=list(COMPONENTS),
            y=[max(100.0 * v, low) for v in values],
            name=title,
            marker={"color": colour},
            hovertemplate="%{y:.3g} %",
        )
        for title, values, colour in sets
    ]
    ticks = [10.0**k for k in range(-4, 3)]
    drawn = chart(traces, y_title="% of weight, of weight × height", barmode="group")
    top = _decades(max(*trial.dr, *trial.uncertainty.kinematic), high)
    drawn.update_yaxes(
        type="log", range=[math.log10(low), top], tickvals=ticks, ticktext=[f"{t:g}" for t in ticks]
    )
    said = ", ".join(
        f"{c} {100 * d:.2g} against {100 * u:.2g}"
        for c, d, u in zip(COMPONENTS, trial.dr, trial.uncertainty.total, strict=True)
    )
    return Figure(
        drawn,
        f"{name}, logarithmic",
        f"Residual of {name} against its uncertainty, % of body weight or of weight times height: {said}.",
        300,
    )


def _decades(share: float, high: float) -> float:
    """The end of a logarithmic axis: whole decades, at least up to ``high``."""
    return math.ceil(math.log10(max(100.0 * share, high)))


def _table(name: str, trial: TrialDynamicsDocument) -> Table:
    rows = [
        Row(
            component,
            [
                _percent(trial.dr[k]),
                _percent(trial.uncertainty.kinematic[k]),
                _percent(trial.uncertainty.plate[k]),
                _percent(trial.uncertainty.total[k]),
                _percent(trial.slopes_per_cm[k]),
                f"{trial.r2[k]:.3f}",
                _supported(trial.calibration_supported[k]),
            ],
        )
        for k, component in enumerate(COMPONENTS)
    ]
    return Table(
        f"{name}: shares of body weight (forces) and of weight times height (moments), %",
        ["", "residual", "motion", "plates", "uncertainty", "slope per cm", "R²", "can calibrate inertia"],
        rows,
        f"Mean reconstruction error {trial.reconstruction_error_mm:.1f} mm.",
    )


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g}"


def _supported(yes: bool) -> Cell:
    return Cell("yes", tone="good") if yes else Cell("no", tone="unknown")
