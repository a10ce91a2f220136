"""Conventional angles on disk and in documents: the same numbers, in degrees."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.scaling.clinical_gait import (
    VARIABLES,
    ClinicalGait,
    compute_clinical_gait,
    make_clinical_document,
    write_clinical,
)
from scaling_service.model.results import Motion
from scaling_service.virtual.example import make_demo_session
from scaling_service.virtual.subject import VirtualSettings


@pytest.fixture(scope="module")
def gait() -> ClinicalGait:
    session, person = make_demo_session(4, VirtualSettings(functional_s=3.0, strides=4.0))
    names = person.model.coordinate_names
    motions = {}
    for trial in session.dynamic:
        q = np.array(person.motions[trial.name])
        q[0] = np.nan
        motions[trial.name] = Motion(
            trial=trial.name,
            times=trial.times,
            coordinates=names,
            q=q,
            markers=(),
            residuals=np.empty((trial.n_frames, 0, 3)),
            estimated=names,
        )
    return compute_clinical_gait(
        person.model, motions, session.dynamic, {t.name for t in session.calibration}
    )


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_tables_hold_every_frame_and_every_cycle(gait: ClinicalGait, tmp_path: Path) -> None:
    write_clinical(tmp_path, gait)
    for trial, angles in gait.recordings.items():
        table = rows(tmp_path / f"{trial}_clinical.csv")
        assert len(table) == len(angles.times)
        assert table[0]["knee_flexion_l_deg"] == ""
        written = [float(row["knee_flexion_l_deg"]) for row in table[1:]]
        np.testing.assert_allclose(written, np.degrees(angles.values["l"]["knee_flexion"][1:]), atol=5.1e-5)
        assert float(table[-1]["time_s"]) == pytest.approx(angles.times[-1], abs=5.1e-5)
    table = rows(tmp_path / "clinical_angles.csv")
    assert len(table) == 101 * sum(len(cycles.cycles) for cycles in gait.cycles.values())
    first = [row for row in table if row["side"] == "r"][:101]
    assert [int(row["cycle_pct"]) for row in first] == list(range(101))
    assert {row["ankle_dorsiflexion_deg"] for row in first} == {""}
    np.testing.assert_allclose(
        [float(row["hip_flexion_deg"]) for row in first],
        np.degrees(gait.cycles["r"].values["hip_flexion"][0]),
        atol=5.1e-5,
    )


def test_the_document_sums_the_cycles_up(gait: ClinicalGait) -> None:
    document = make_clinical_document(gait)
    for side in ("r", "l"):
        found, values = document.sides[side], gait.cycles[side].values
        assert len(found.cycles) == len(gait.cycles[side].cycles)
        curve = found.curves["hip_adduction"]
        assert curve.n_cycles == len(found.cycles)
        np.testing.assert_allclose(
            curve.mean_deg, np.degrees(values["hip_adduction"][:, ::2].mean(axis=0)), atol=1e-3
        )
        assert set(found.gvs_deg) == set(VARIABLES[:-2])
        assert found.gps_deg is None
    assert document.gps_deg is None
    assert document.held_out
    assert document.reference_gvs_deg["hip_flexion"] == pytest.approx(6.1, abs=0.1)
    assert any("no heel" in sentence for sentence in document.left_out)
