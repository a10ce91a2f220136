"""What is said of Futamure et al. done again: claims, table 2, angles and inertia against the truth."""

from __future__ import annotations

from collections import abc

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.report.summary import Summary
from scaling_service.report.tables import Row, Table
from scaling_service.studies.claims import summarise_study
from scaling_service.studies.futamure import result as documents
from scaling_service.studies.futamure.claims import PAPER
from scaling_service.studies.futamure.study import WAYS

_WRENCH = ("fx, N", "fy, N", "mz, N m")
_COLUMNS = ("", *_WRENCH, "markers, mm", "angles, deg")
_JOINTS = ("ankle", "knee", "hip", "shoulder")
_INERTIA = ("masses", "centres of mass", "moments of inertia")


def summarise(document: documents.FutamureDocument) -> Summary:
    """The study in short, with what only virtual persons can tell."""
    further: list[Table] = []
    rows = []
    for way in WAYS:
        errors = np.array([getattr(p.fitted, way).angle_rmse_deg for p in document.persons])
        rows.append(Row(way, [_spread(errors[:, k]) for k in range(4)] + [_spread(errors.mean(axis=1))]))
    further.append(
        Table(
            caption="RMS error of joint angles, degrees, mean ± SD over persons",
            columns=["", *_JOINTS, "mean"],
            rows=rows,
        )
    )
    before, after = (np.array([p.inertia_distance[k] for p in document.persons]) for k in (0, 1))
    further.append(
        Table(
            caption="Distance of inertial parameters from the truth, SDs of the tables, mean ± SD over "
            "persons",
            columns=["", "table", "identified"],
            rows=[
                Row(name, [_spread(before[:, k]), _spread(after[:, k])]) for k, name in enumerate(_INERTIA)
            ],
        )
    )
    lengths = [np.abs([p.length_error_mm[k] for p in document.persons]).mean(axis=0) for k in (0, 1)]
    further.append(
        Table(
            caption="Mean size of length errors, mm",
            columns=["", "start", "found"],
            rows=[
                Row(n, [f"{a:.1f}", f"{b:.1f}"])
                for n, a, b in zip(("shank", "thigh", "trunk"), *lengths, strict=True)
            ],
        )
    )
    tables = [*make_tables(document), *further]
    return summarise_study("Futamure et al.", document, tables)


def make_tables(document: documents.FutamureDocument) -> abc.Iterator[Table]:
    """What the paper's table 2 has, of virtual persons and of real recordings."""
    rows = [
        Row(f"{way}, {said}", _format_cells([getattr(getattr(p, part), way) for p in document.persons]))
        for part, said in (("fitted", "used to fit"), ("held_out", "held out"))
        for way in WAYS
    ]
    rows += [Row(f"{way}, paper", [*(f"{v:.0f}" for v in six), "–", "–"]) for way, six in PAPER.items()]
    yield Table(
        caption="RMS errors, mean ± SD over persons",
        columns=_COLUMNS,
        rows=rows,
        note="Predicted: the classical two steps with the model found, so that forces of the recording "
        "played no part.",
    )
    if document.recordings:
        measured = [
            Row(f"{r.name}, {r.model}, {said}, {way}", _format_cells([getattr(getattr(r, part), way)]))
            for r in document.recordings
            for part, said in (("fitted", "used to fit"), ("held_out", "held out"))
            for way in WAYS
        ]
        yield Table(caption="RMS errors of real squats", columns=_COLUMNS, rows=measured)


def _format_cells(found: abc.Sequence[documents.WayEntry]) -> list[str]:
    """Of all recordings in one way."""
    values = np.array([[*entry.wrench_rmse, entry.marker_rms_mm] for entry in found])
    angles = np.array([np.mean(entry.angle_rmse_deg) for entry in found if entry.angle_rmse_deg])
    return [*(_spread(values[:, k], 1) for k in range(4)), _spread(angles) if len(angles) else "–"]


def _spread(values: Array, digits: int = 2) -> str:
    spread = f" ± {values.std(ddof=1):.{digits}f}" if len(values) > 1 else ""
    return f"{values.mean():.{digits}f}{spread}"
