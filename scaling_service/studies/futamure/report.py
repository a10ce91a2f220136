"""The page of Futamure et al. done again: claims, then table 2, angles and inertia against the truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import plotly.graph_objects as go

from scaling_service.numerics.multibody.laws import Array
from scaling_service.report.blocks import Block, Grid, Legend, Page, Row, Section, Table
from scaling_service.report.figures import Figure, draw_grouped_bars, make_chart
from scaling_service.report.methods import FAINT
from scaling_service.studies.claims import build_study_page
from scaling_service.studies.futamure.claims import PAPER
from scaling_service.studies.futamure.document import FutamureDocument, SquatterEntry, WayEntry
from scaling_service.studies.futamure.study import WAYS

_COLOURS = dict(zip(WAYS, ("#0072B2", "#D55E00", "#009E73"), strict=True))  # Okabe & Ito 2008
_WRENCH = ("fx, N", "fy, N", "mz, N m")
_COLUMNS = ("", *_WRENCH, "markers, mm", "angles, deg")
_JOINTS = ("ankle", "knee", "hip", "shoulder")
_INERTIA = ("masses", "centres of mass", "moments of inertia")


def build_page(document: FutamureDocument) -> Page:
    """The page of the study, all from ``study.json``."""
    persons = document.persons
    real = [Section("Real recordings", [_tabulate_real(document)])] if document.recordings else []
    return build_study_page(
        "Futamure et al.",
        document,
        [
            Section("Table 2: ground wrench and markers", _build_wrench_blocks(persons), new_page=True),
            Section("What only virtual persons can tell", list(_build_truth(persons)), new_page=True),
            *real,
        ],
    )


def make_tables(document: FutamureDocument) -> Iterator[Table]:
    """What the paper's table 2 has, of virtual persons and of real recordings."""
    yield _tabulate_persons(document.persons)
    if document.recordings:
        yield _tabulate_real(document)


def _tabulate_persons(persons: Sequence[SquatterEntry]) -> Table:
    rows = [
        Row(f"{way}, {said}", _format_cells([getattr(getattr(p, part), way) for p in persons]))
        for part, said in (("fitted", "used to fit"), ("held_out", "held out"))
        for way in WAYS
    ]
    rows += [Row(f"{way}, paper", [*(f"{v:.0f}" for v in six), "–", "–"]) for way, six in PAPER.items()]
    return Table(
        caption="RMS errors, mean ± SD over persons",
        columns=_COLUMNS,
        rows=rows,
        note="Predicted: the classical two steps with the model found, so that forces of the recording "
        "played no part.",
    )


def _tabulate_real(document: FutamureDocument) -> Table:
    rows = [
        Row(f"{r.name}, {r.model}, {said}, {way}", _format_cells([getattr(getattr(r, part), way)]))
        for r in document.recordings
        for part, said in (("fitted", "used to fit"), ("held_out", "held out"))
        for way in WAYS
    ]
    return Table(caption="RMS errors of real squats", columns=_COLUMNS, rows=rows)


def _format_cells(found: Sequence[WayEntry]) -> list[str]:
    """Of all recordings in one way."""
    values = np.array([[*entry.wrench_rmse, entry.marker_rms_mm] for entry in found])
    angles = np.array([np.mean(entry.angle_rmse_deg) for entry in found if entry.angle_rmse_deg])
    return [*(_spread(values[:, k], 1) for k in range(4)), _spread(angles) if len(angles) else "–"]


def _spread(values: Array, digits: int = 2) -> str:
    spread = f" ± {values.std(ddof=1):.{digits}f}" if len(values) > 1 else ""
    return f"{values.mean():.{digits}f}{spread}"


def _build_wrench_blocks(persons: Sequence[SquatterEntry]) -> list[Block]:
    legend = Legend([(way, colour, "solid") for way, colour in _COLOURS.items()])
    return [_tabulate_persons(persons), legend, Grid([_draw_bars(persons, k) for k in range(3)])]


def _draw_bars(persons: Sequence[SquatterEntry], k: int) -> Figure:
    series = [
        (way, colour, [getattr(p.fitted, way).wrench_rmse[k] for p in persons])
        for way, colour in _COLOURS.items()
    ]
    return Figure(
        draw_grouped_bars([p.name for p in persons], series, y_title=_WRENCH[k]),
        f"RMS error of {_WRENCH[k]}",
        f"RMS error of {_WRENCH[k]} of every person in three ways.",
    )


def _build_truth(persons: Sequence[SquatterEntry]) -> Iterator[Block]:
    rows = []
    for way in WAYS:
        errors = np.array([getattr(p.fitted, way).angle_rmse_deg for p in persons])
        rows.append(Row(way, [_spread(errors[:, k]) for k in range(4)] + [_spread(errors.mean(axis=1))]))
    yield Table(
        caption="RMS error of joint angles, degrees, mean ± SD over persons",
        columns=["", *_JOINTS, "mean"],
        rows=rows,
    )
    yield Figure(
        _draw_pairs(
            [[np.mean(getattr(p.fitted, w).angle_rmse_deg) for p in persons] for w in WAYS[:2]], "deg"
        ),
        "Mean RMS error of the angles: each line a person, classical to consistent",
        "Each person's mean angle error, classical and consistent.",
        260,
    )
    before, after = (np.array([p.inertia_distance[k] for p in persons]) for k in (0, 1))
    yield Table(
        caption="Distance of inertial parameters from the truth, SDs of the tables, mean ± SD over persons",
        columns=["", "table", "identified"],
        rows=[Row(name, [_spread(before[:, k]), _spread(after[:, k])]) for k, name in enumerate(_INERTIA)],
    )
    lengths = [np.abs([p.length_error_mm[k] for p in persons]).mean(axis=0) for k in (0, 1)]
    yield Table(
        caption="Mean size of length errors, mm",
        columns=["", "start", "found"],
        rows=[
            Row(n, [f"{a:.1f}", f"{b:.1f}"])
            for n, a, b in zip(("shank", "thigh", "trunk"), *lengths, strict=True)
        ],
    )


def _draw_pairs(values: Sequence[Sequence[float]], unit: str) -> go.Figure:
    traces = [
        go.Scatter(
            x=["classical", "consistent"],
            y=[round(float(a), 4), round(float(b), 4)],
            mode="lines+markers",
            line={"color": "#D55E00" if b < a else FAINT, "width": 1.5},
        )
        for a, b in zip(*values, strict=True)
    ]
    return make_chart(traces, y_title=unit)
