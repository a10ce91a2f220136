"""The page of Futamure et al. done again: claims, then table 2, angles and inertia against the truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import plotly.graph_objects as go
import rich.table

from scaling_service.report.blocks import Block, Grid, Legend, Row, Table
from scaling_service.report.figures import Figure, chart, plain
from scaling_service.report.methods import FAINT
from scaling_service.report.page import Page, Section
from scaling_service.studies.claims import study_page
from scaling_service.studies.futamure.run import FutamureDocument, RecordingEntry, SquatterEntry
from scaling_service.studies.screen import titled_table

_WAYS = (("classical", "#0072B2"), ("consistent", "#D55E00"), ("predicted", "#009E73"))  # Okabe & Ito 2008
_PAPER = {"classical": (7.0, 8.0, 8.0), "consistent": (3.0, 4.0, 3.0)}
_WRENCH = ("fx, N", "fy, N", "mz, N m")
_JOINTS = ("ankle", "knee", "hip", "shoulder")
_INERTIA = ("masses", "centres of mass", "moments of inertia")


def page(document: FutamureDocument) -> Page:
    """The page of the study, all from ``study.json``."""
    persons = document.persons
    real = [Section("Real recordings", list(_real(document)))] if document.recordings else []
    return study_page(
        "Futamure et al.",
        document,
        [
            Section("Table 2: ground wrench and markers", list(_table(persons)), new_page=True),
            Section("What only virtual persons can tell", list(_truth(persons)), new_page=True),
            *real,
        ],
    )


def table(document: FutamureDocument) -> rich.table.Table:
    """Means over persons, and real recordings, for the terminal."""
    shown = titled_table("RMS errors", (*_WRENCH, "markers, mm", "angles, deg"))
    for part in ("fitted", "held_out"):
        _add_means(shown, part.replace("_", " "), [getattr(p, part) for p in document.persons])
    for real in document.recordings:
        for part in ("fitted", "held_out"):
            _add_means(shown, f"{real.name}, {real.model}, {part.replace('_', ' ')}", [getattr(real, part)])
    return shown


def _add_means(shown: rich.table.Table, label: str, found: Sequence[RecordingEntry]) -> None:
    for way, _ in _WAYS:
        entries = [getattr(recording, way) for recording in found]
        wrench = np.mean([entry.wrench_rmse for entry in entries], axis=0)
        markers = np.mean([entry.marker_rms_mm for entry in entries])
        angles = [np.mean(entry.angle_rmse_deg) for entry in entries if entry.angle_rmse_deg]
        last = f"{np.mean(angles):.2f}" if angles else "–"
        shown.add_row(f"{label}, {way}", *(f"{v:.1f}" for v in wrench), f"{markers:.1f}", last)


def _table(persons: Sequence[SquatterEntry]) -> Iterator[Block]:
    rows = []
    for held_out in (False, True):
        for way, _ in _WAYS:
            found = [getattr(p.held_out if held_out else p.fitted, way) for p in persons]
            values = np.array([[*f.wrench_rmse, f.marker_rms_mm] for f in found])
            cells = [_spread(values[:, k], 1) for k in range(4)]
            rows.append(Row(f"{way}, {'held out' if held_out else 'used to fit'}", cells))
    for way, numbers in _PAPER.items():
        rows.append(Row(f"{way}, paper", [f"{v:.0f}" for v in numbers] + ["–"]))
    yield Table(
        "RMS errors, mean ± SD over persons",
        ["", *_WRENCH, "markers, mm"],
        rows,
        "Predicted: the classical two steps with the model found, so that forces of the recording "
        "played no part.",
    )
    yield Legend([(way, colour, "solid") for way, colour in _WAYS])
    yield Grid([_bars(persons, k) for k in range(3)])


def _spread(values: np.ndarray, digits: int = 2) -> str:
    spread = f" ± {values.std(ddof=1):.{digits}f}" if len(values) > 1 else ""
    return f"{values.mean():.{digits}f}{spread}"


def _bars(persons: Sequence[SquatterEntry], k: int) -> Figure:
    traces = [
        go.Bar(
            x=[plain(p.name) for p in persons],
            y=[getattr(p.fitted, way).wrench_rmse[k] for p in persons],
            name=way,
            marker={"color": colour},
        )
        for way, colour in _WAYS
    ]
    return Figure(
        chart(traces, y_title=_WRENCH[k], barmode="group"),
        f"RMS error of {_WRENCH[k]}",
        f"RMS error of {_WRENCH[k]} of every person in three ways.",
        260,
    )


def _truth(persons: Sequence[SquatterEntry]) -> Iterator[Block]:
    rows = []
    for way, _ in _WAYS:
        errors = np.array([getattr(p.fitted, way).angle_rmse_deg for p in persons])
        rows.append(Row(way, [_spread(errors[:, k]) for k in range(4)] + [_spread(errors.mean(axis=1))]))
    yield Table("RMS error of joint angles, degrees, mean ± SD over persons", ["", *_JOINTS, "mean"], rows)
    yield Figure(
        _pairs(
            [[np.mean(getattr(p.fitted, w).angle_rmse_deg) for p in persons] for w, _ in _WAYS[:2]], "deg"
        ),
        "Mean RMS error of the angles: each line a person, classical to consistent",
        "Each person's mean angle error, classical and consistent.",
        260,
    )
    before, after = (np.array([p.inertia_distance[k] for p in persons]) for k in (0, 1))
    yield Table(
        "Distance of inertial parameters from the truth, SDs of the tables, mean ± SD over persons",
        ["", "table", "identified"],
        [Row(name, [_spread(before[:, k]), _spread(after[:, k])]) for k, name in enumerate(_INERTIA)],
    )
    lengths = [np.abs([p.length_error_mm[k] for p in persons]).mean(axis=0) for k in (0, 1)]
    yield Table(
        "Mean size of length errors, mm",
        ["", "start", "found"],
        [
            Row(n, [f"{a:.1f}", f"{b:.1f}"])
            for n, a, b in zip(("shank", "thigh", "trunk"), *lengths, strict=True)
        ],
    )


def _pairs(values: Sequence[Sequence[float]], unit: str) -> go.Figure:
    traces = [
        go.Scatter(
            x=["classical", "consistent"],
            y=[round(float(a), 4), round(float(b), 4)],
            mode="lines+markers",
            line={"color": "#D55E00" if b < a else FAINT, "width": 1.5},
        )
        for a, b in zip(*values, strict=True)
    ]
    return chart(traces, y_title=unit)


def _real(document: FutamureDocument) -> Iterator[Block]:
    rows = []
    for found in document.recordings:
        for part in ("fitted", "held_out"):
            recording: RecordingEntry = getattr(found, part)
            for way, _ in _WAYS:
                entry = getattr(recording, way)
                numbers = [f"{v:.1f}" for v in entry.wrench_rmse]
                label = f"{found.name}, {found.model}, {part.replace('_', ' ')}, {way}"
                rows.append(Row(label, [*numbers, f"{entry.marker_rms_mm:.1f}"]))
    yield Table("RMS errors of real squats", ["", *_WRENCH, "markers, mm"], rows)
