"""Wrenches of force plates against closed forms, another reader and the authors' own forces."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scaling_service.core.arrays import Array
from scaling_service.core.errors import TrialUnusable
from scaling_service.files.c3d import read_c3d
from scaling_service.files.forces import read_forces
from scaling_service.model.forces import GroundForces, PlateRecording, RawPlate
from scaling_service.numerics.multibody.rigid import convert_vector_to_rotation
from scaling_service.numerics.signals.filters import filter_butterworth
from scaling_service.recording.orientation import Orientation, decide
from scaling_service.recording.plates import compute_ground_forces, find_plate_axes, orient_forces

FORCE, POINT, FREE = np.array([30.0, -20.0, 700.0]), np.array([0.12, -0.05, 0.0]), 4.0
"""On the body, in axes with z up and the middle of the plate as origin."""


def corners(tilt: Array, middle: Array) -> Array:
    """Of a plate 0.6 by 0.4 m whose z axis points into the floor, turned and moved in the laboratory."""
    flat = np.array([[0.3, -0.2, 0], [-0.3, -0.2, 0], [-0.3, 0.2, 0], [0.3, 0.2, 0]])  # y = -lab y, z down
    return flat @ convert_vector_to_rotation(tilt).T + middle


def sensed(kind: int, wrench: tuple[Array, Array], origin: Array) -> Array:
    """What the sensors of each type show for a wrench about the plate's middle, in the plate's axes."""
    force, moment = wrench
    if kind == 1:
        point = np.array([-moment[1] / force[2], moment[0] / force[2], 0.0])
        return np.array([*force, *point[:2], (moment - np.cross(point, force))[2]])
    about = moment + np.cross(origin if kind != 3 else [0, 0, origin[2]], force)
    if kind in (2, 4):
        return np.array([*force, *about])
    a, b, _ = origin
    mx, my, mz = about
    fx, fy, fz = force
    z = np.linalg.lstsq(
        np.array([[1, 1, 1, 1], [b, b, -b, -b], [-a, a, a, -a]]), np.array([fz, mx, my]), rcond=None
    )[0]
    split = (mz + b * fx - a * fy) / (2 * b)  # x34, with y14 = y23 + ... chosen so that mz comes out
    x34, y14 = split, fy
    return np.array([fx - x34, x34, y14, 0.0, *z])


@pytest.mark.parametrize(
    ("kind", "sign"), [(1, 1.0), (2, 1.0), (2, -1.0), (3, 1.0), (3, -1.0), (4, 1.0), (4, -1.0)]
)
def test_every_type_gives_the_wrench_in_the_laboratory(kind: int, sign: float) -> None:
    tilt, middle = np.array([0.02, -0.01, 0.7]), np.array([1.0, 2.0, 0.1])
    R = convert_vector_to_rotation(tilt)
    down = np.diag([1.0, -1.0, -1.0])  # the plate's axes in those with z up
    force = down @ FORCE
    moment = down @ (np.cross(POINT, FORCE) + np.array([0, 0, FREE]))
    origin = np.array([0.12, 0.2, -0.04]) if kind == 3 else np.array([0.001, 0.002, -0.04])
    signals = sensed(kind, (force, moment), origin)
    shown = origin * ([1, 1, sign] if kind == 3 else sign)  # files differ in the sign of ORIGIN
    plate = RawPlate(kind, corners(tilt, middle), shown, np.tile(signals, (3, 1)))
    found = compute_ground_forces(PlateRecording("made", np.arange(3) / 100, (plate,)))
    np.testing.assert_allclose(found.force[0, 0], R @ FORCE, atol=1e-9)
    at = R @ POINT + middle
    np.testing.assert_allclose(found.moment[0, 0], np.cross(at, R @ FORCE) + R @ [0, 0, FREE], atol=1e-9)
    np.testing.assert_allclose(found.centre_of_pressure()[0, 0], at, atol=1e-12)
    np.testing.assert_allclose(found.normals[0], R @ [0, 0, 1], atol=1e-12)


def test_plate_axes_follow_the_corners() -> None:
    np.testing.assert_allclose(
        find_plate_axes(corners(np.zeros(3), np.zeros(3))), np.diag([1.0, -1.0, -1.0]), atol=1e-15
    )


def type_2(moment: Array, origin: Array) -> PlateRecording:
    signals = np.tile([*(np.diag([1.0, -1.0, -1.0]) @ FORCE), *moment], (4, 1))
    return PlateRecording(
        "made", np.arange(4) / 100, (RawPlate(2, corners(*np.zeros((2, 3))), origin, signals),)
    )


def test_moments_a_thousand_times_too_large_are_refused() -> None:
    moment = np.diag([1.0, -1.0, -1.0]) @ np.cross(POINT, FORCE)
    with pytest.raises(TrialUnusable, match=r"off plate 1 in 100% .*N mm or N m"):
        compute_ground_forces(type_2(1000 * moment, np.zeros(3)))


def test_an_origin_of_the_other_sign_is_recognised_by_pressure_off_the_plate() -> None:
    away = np.array([0.9, -0.3, 0.0])
    moment = np.diag([1.0, -1.0, -1.0]) @ np.cross(POINT, FORCE) + np.cross(
        away, np.diag([1.0, -1.0, -1.0]) @ FORCE
    )
    found = compute_ground_forces(type_2(moment, -away))
    np.testing.assert_allclose(found.centre_of_pressure()[0, 0], POINT, atol=1e-12)
    assert "plate_origin" in [r.what for r in found.repairs]


def test_a_missing_sample_stays_alone() -> None:
    recording = type_2(np.zeros(3), np.zeros(3))
    signals = recording.plates[0].signals.copy()
    signals[2, 1] = np.nan
    found = compute_ground_forces(replace(recording, plates=(replace(recording.plates[0], signals=signals),)))
    assert np.isfinite(found.moment[[0, 1, 3]]).all()
    assert np.isnan(found.force[2]).any()


UP_Z = Orientation(np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]))


def test_forces_turn_with_the_markers_and_push_up() -> None:
    found = compute_ground_forces(type_2(np.zeros(3), np.zeros(3)))
    turned = orient_forces(UP_Z, found)
    np.testing.assert_allclose(turned.force[0, 0], [30, 700, 20])
    action = replace(found, force=-found.force, moment=-found.moment)
    again = orient_forces(UP_Z, action)
    np.testing.assert_allclose(again.force, turned.force)
    assert "force_sign" in [r.what for r in again.repairs]


def test_ezc3d_finds_the_same_forces_on_a_calibrated_treadmill(shared_data: Path) -> None:
    ezc3d = pytest.importorskip("ezc3d")
    file = shared_data / "functional" / "right_hip.c3d"
    ours = compute_ground_forces(read_c3d(file).plates)
    peers = ezc3d.c3d(str(file), extract_forceplat_data=True)["data"]["platform"]
    for k, peer in enumerate(peers):
        np.testing.assert_allclose(ours.force[:, k], peer["force"].T, rtol=0, atol=1e-6)
    pressed = ours.in_contact()[:, 0]
    feet = read_c3d(file)
    heel, toe = (feet.position(name) for name in ("LCAL", "LTT2"))
    centre = ours.centre_of_pressure()[pressed, 0]
    low, high = np.minimum(heel, toe).min(axis=0), np.maximum(heel, toe).max(axis=0)
    assert (centre[:, 0] > low[0] - 0.02).all()
    assert (centre[:, 0] < high[0] + 0.08).all()
    assert np.abs(centre[:, 1] - 0.5 * (low[1] + high[1])).max() < 0.08


@pytest.mark.parametrize("order", [[1, 0, 3, 2], [3, 2, 1, 0]])
def test_corners_that_go_round_the_other_way_are_refused(order: list[int]) -> None:
    recording = type_2(np.zeros(3), np.zeros(3))
    mirrored = replace(recording.plates[0], corners=recording.plates[0].corners[order])
    found = compute_ground_forces(replace(recording, plates=(mirrored,)))
    with pytest.raises(TrialUnusable, match="the corners of plate 1 go round the other way"):
        orient_forces(UP_Z, found)


@pytest.mark.parametrize(("trial", "turn"), [("Walking01", 1.0), ("Walking02", -1.0), ("Walking04", -1.0)])
def test_the_authors_forces_are_found_again(shared_data: Path, trial: str, turn: float) -> None:
    folder = shared_data / "jia_mri"
    theirs = read_forces(folder / f"{trial}_kinetics.mot")
    ours = compute_ground_forces(read_c3d(folder / f"{trial}.c3d").plates)
    # Their x is forward in every trial, walking along -z or +z of the laboratory, and they cut the ends.
    R = np.array([[0.0, 0, -turn], [0, 1, 0], [turn, 0, 0]])
    force, lag = _aligned(ours, theirs, R)
    n = len(theirs.times)
    span = slice(lag, lag + n)
    pressed = theirs.in_contact(200.0)
    # They filtered and do not tell how; of 20 to 100 Hz and orders 2 and 4 this comes nearest.
    smooth = filter_butterworth(force, rate_hz=1000.0, cutoff_hz=40.0, order=4).values
    miss = np.abs(smooth[span] - theirs.force)[pressed]
    assert np.median(miss, axis=0).max() < 0.15  # N
    assert np.sqrt((miss**2).mean(axis=0)).max() < 2.0  # N, most of it at the impact of the heel
    centre = (ours.centre_of_pressure(200.0) @ R.T)[span]
    both = pressed & np.isfinite(centre).all(axis=2)
    away = np.linalg.norm((centre - theirs.centre_of_pressure(200.0))[both], axis=1)
    assert np.median(away) < 1e-3
    assert np.percentile(away, 95) < 6e-3


def _aligned(ours: GroundForces, theirs: GroundForces, R: Array) -> tuple[Array, int]:
    """Our forces in their axes, and the sample at which theirs begin."""
    force, n = ours.force @ R.T, len(theirs.times)
    misses = [
        float(np.abs(force[k : k + n, :, 1] - theirs.force[:, :, 1]).mean())
        for k in range(len(force) - n + 1)
    ]
    return force, int(np.argmin(misses))


def test_axes_found_from_the_markers_turn_the_walk_forward(shared_data: Path) -> None:
    folder = shared_data / "jia_mri"
    trial = read_c3d(folder / "Walking01.c3d")
    roles = {"RASI": "RASIS", "LASI": "LASIS", "RPSI": "RPSIS", "LPSI": "LPSIS"}
    forces = orient_forces(
        decide(trial, roles=roles), compute_ground_forces(read_c3d(folder / "Walking01.c3d").plates)
    )
    first, second = (forces.centre_of_pressure()[:, k] for k in (0, 1))
    assert np.nanmean(second[:, 0]) > np.nanmean(first[:, 0]) + 0.3  # x grows along the walk
    assert np.nanmax(forces.pressing) > 700
