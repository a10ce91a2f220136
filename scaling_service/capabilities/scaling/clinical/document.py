"""Conventional angles of scaled models as tables and documents, in degrees."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from scaling_service.capabilities.scaling.clinical.angles import SIDES, ClinicalCycles
from scaling_service.capabilities.scaling.clinical.gait import (
    VARIABLES,
    ClinicalGait,
    typical_score,
)
from scaling_service.documents.clinical import ClinicalCurve, ClinicalCycle, ClinicalDocument, ClinicalSide
from scaling_service.documents.writing import CYCLES_TABLE
from scaling_service.model.anatomy.conventional import ANGLES
from scaling_service.model.results import Array
from scaling_service.numerics.statistics.cycles import NODES

_OVER_TIME = "_clinical.csv"


def write_clinical(folder: Path, gait: ClinicalGait) -> None:
    """``<trial>_clinical.csv`` with every angle over time, and all cycles in ``clinical_angles.csv``.

    Nothing is written where the model tells none of the angles, or where there is no cycle.
    """
    for trial, angles in gait.recordings.items():
        columns = {
            f"{name}_{side}_deg": np.degrees(angles.values[side][name])
            for side in SIDES
            for name in ANGLES
            if name in angles.values[side]
        }
        if columns:
            rows = np.column_stack([angles.times, *columns.values()])
            _write(folder / f"{trial}{_OVER_TIME}", ["time_s", *columns], map(_numbers, rows))
    if gait.cycles:
        heads = ["trial", "side", "start_s", "end_s", "cycle_pct", *(f"{name}_deg" for name in ANGLES)]
        found = [row for cycles in gait.cycles.values() for row in _cycle_rows(cycles)]
        _write(folder / CYCLES_TABLE, heads, found)


def clinical_document(gait: ClinicalGait) -> ClinicalDocument:
    """The same, summed up over cycles, as it stands in ``scaling.json``."""
    profile, reference = gait.profile, gait.reference
    return ClinicalDocument(
        reference=reference.source,
        population=reference.population,
        sides={
            side: ClinicalSide(
                cycles=[
                    ClinicalCycle(trial=trial, start_s=round(start, 4), end_s=round(end, 4))
                    for trial, start, end in cycles.cycles
                ],
                curves={name: _curve(values) for name, values in cycles.values.items()},
                gvs_deg={name: _deg(score) for name, score in profile.variable_scores[side].items()},
                gps_deg=_deg(profile.side_scores[side]) if side in profile.side_scores else None,
            )
            for side, cycles in gait.cycles.items()
        },
        gps_deg=None if profile.score is None else _deg(profile.score),
        reference_gvs_deg={name: _deg(reference.bands[name].typical) for name in VARIABLES},
        reference_gps_deg=_deg(typical_score(reference)),
        held_out=gait.held_out,
        left_out=list(gait.left_out),
        doubtful=list(gait.doubtful),
        reason=gait.reason,
    )


def _curve(values: Array) -> ClinicalCurve:
    """Mean and scatter of the cycles that are known, at every second node."""
    known = np.degrees(values[np.isfinite(values).all(axis=1)][:, ::2])
    sd = known.std(axis=0, ddof=1).round(3).tolist() if len(known) > 1 else None
    return ClinicalCurve(mean_deg=known.mean(axis=0).round(3).tolist(), sd_deg=sd, n_cycles=len(known))


def _cycle_rows(cycles: ClinicalCycles) -> Iterable[list[str]]:
    unknown = np.full((len(cycles.cycles), NODES), np.nan)
    table = np.degrees(np.stack([cycles.values.get(name, unknown) for name in ANGLES], axis=2))
    for (trial, start, end), rows in zip(cycles.cycles, table, strict=True):
        for percent, row in enumerate(rows):
            yield [trial, cycles.side, f"{start:.4f}", f"{end:.4f}", str(percent), *_numbers(row)]


def _numbers(row: Array) -> list[str]:
    """Empty where a number is not known."""
    return [f"{value:.4f}" if np.isfinite(value) else "" for value in row]


def _write(path: Path, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(heads)
        writer.writerows(rows)


def _deg(angle: float) -> float:
    return round(float(np.degrees(angle)), 3)
