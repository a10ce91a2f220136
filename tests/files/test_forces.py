"""Ground forces of MOT and STO files: every naming of columns, points without meaning, what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scaling_service.core.errors import TrialUnusable
from scaling_service.files.forces import find_plates, read_forces, read_forces_from_table
from scaling_service.files.sto import Table

NAMINGS = {
    "ground_force_1_v": ("ground_force_1_p", "ground_force_1_m"),
    "1_ground_force_v": ("1_ground_force_p", "1_ground_torque_"),
    "ground_force_r_v": ("ground_force_r_p", "ground_torque_r_"),
    "ground_force_v": ("ground_force_p", "ground_torque_"),
    "R_ground_force_v": ("R_ground_force_p", "R_ground_moment_m"),
}


def columns(force: str) -> tuple[str, ...]:
    return tuple(f"{stem}{axis}" for stem in (force, *NAMINGS[force]) for axis in "xyz")


def table(force: str = "ground_force_v", rows: int = 5, **changes: object) -> Table:
    """One plate pressed with 700 N and 30 N at (0.2, 0, 0.1) m, 4 N m about the vertical."""
    values = dict(zip(columns(force), [30, 700, 0, 0.2, 0, 0.1, 0, 4, 0], strict=True)) | changes
    data = np.column_stack([np.arange(rows) / 100, *(np.broadcast_to(v, rows) for v in values.values())])
    return Table(name="made", columns=("time", *values), data=data.astype(float))


@pytest.mark.parametrize("force", NAMINGS)
def test_every_naming_gives_the_wrench_about_the_origin(force: str) -> None:
    forces = read_forces_from_table(table(force), "made.mot")
    assert forces.plates == ("plate_1",)
    np.testing.assert_allclose(forces.force[0, 0], [30, 700, 0])
    np.testing.assert_allclose(forces.moment[0, 0], [-70, 3 + 4, 140])  # r x F + T
    np.testing.assert_allclose(forces.centre_of_pressure()[0, 0], [0.2, 0, 0.1], atol=1e-12)


def test_plates_come_in_the_order_of_the_columns() -> None:
    both = ("time", *columns("ground_force_v"), *columns("1_ground_force_v"))
    assert [p.identifier for p in find_plates(both, "f")] == ["ground_force_v", "1_ground_force_v"]


def test_a_point_far_away_at_no_force_spoils_nothing() -> None:
    vertical = np.array([0.0, 5.0, 700.0, 700.0, 700.0])
    away = np.array([346.0, 120.0, 0.2, 0.21, 0.2])
    forces = read_forces_from_table(
        table(ground_force_vy=vertical, ground_force_vx=0.0, ground_force_px=away), "made.mot"
    )
    assert forces.moment[0, 0, 2] == 0.0
    assert forces.moment[1, 0, 2] == pytest.approx(5.0 * 0.31)  # drawn back to the plate and its margin
    assert [r.frames for r in forces.repairs if r.what == "point_astray"] == [1]
    assert np.isnan(forces.centre_of_pressure()[:2]).all()


def test_forces_of_the_body_on_the_ground_act_at_the_same_points() -> None:
    pushed = {"vx": -30, "vy": -700, "px": np.array([0.5, 0.2, 0.1, 0.2, 0.0])}
    forces = read_forces_from_table(table(**{f"ground_force_{k}": v for k, v in pushed.items()}), "made.mot")
    assert not [r for r in forces.repairs if r.what == "point_astray"]
    turned = forces.change(force=-forces.force, moment=-forces.moment)
    np.testing.assert_allclose(turned.centre_of_pressure()[:, 0, 0], pushed["px"])


def test_a_missing_number_spoils_its_own_frame_only() -> None:
    forces = read_forces_from_table(table(ground_force_vx=np.array([1, np.nan, 1, 1, 1])), "made.mot")
    assert np.isfinite(forces.moment[[0, 2, 3, 4]]).all()
    assert np.isnan(forces.force[1, 0, 0])


def test_an_undefined_point_of_no_force_is_no_gap() -> None:
    none = np.array([0.0, 700, 700, 700, 700])
    forces = read_forces_from_table(
        table(ground_force_vy=none, ground_force_vx=0.0 * none, ground_force_px=np.where(none, 0.2, np.nan)),
        "made.mot",
    )
    assert np.isfinite(forces.moment).all()


def test_points_in_millimetres_are_refused() -> None:
    with pytest.raises(TrialUnusable, match=r"plate 1 is loaded 224 m away.*Give points in m"):
        read_forces_from_table(table(ground_force_px=200.0, ground_force_pz=100.0), "made.mot")


def test_a_force_without_a_point_and_a_file_without_forces_are_refused() -> None:
    with pytest.raises(TrialUnusable, match="'ground_force_v' has no point of application"):
        find_plates(("time", "ground_force_vx", "ground_force_vy", "ground_force_vz"), "f.mot")
    with pytest.raises(TrialUnusable, match="no ground force is found in the columns hip, knee"):
        find_plates(("time", "hip", "knee"), "f.mot")


def test_a_file_without_moments_is_read_and_reported() -> None:
    plain = table()
    kept = [k for k, c in enumerate(plain.columns) if "torque" not in c]
    forces = read_forces_from_table(
        Table(name="made", columns=tuple(plain.columns[k] for k in kept), data=plain.data[:, kept]), "f"
    )
    assert "no_moment" in [r.what for r in forces.repairs]


REAL = {
    "jia_mri/Walking01_kinetics.mot": (1020, 2, (500, 900)),
    "rajagopal_walk/grf_walk.mot": (4778, 2, (800, 1000)),
    "gait2354/subject01_walk1_grf.mot": (1501, 2, (700, 900)),
    "opencap_squat/squats1_grf.mot": (1346, 3, (300, 500)),
    "opencap_squat/walking1_grf.mot": (131, 2, (550, 800)),
}


@pytest.mark.parametrize("name", REAL)
def test_real_files_hold_a_persons_weight_at_points_of_a_laboratory(shared_data: Path, name: str) -> None:
    samples, plates, (low, high) = REAL[name]
    forces = read_forces(shared_data / name)
    assert forces.force.shape == (samples, plates, 3)
    peak = np.nanmax(forces.pressing, axis=0)
    assert (peak[peak > 0] > low).all()
    assert (peak < high).all()
    assert np.nanmax(np.abs(forces.centre_of_pressure())) < 5.0
    assert np.abs(forces.moment).max() < 5.0 * high
