"""The chord construction: its conditions, what has no solution, and a laboratory's own centres."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scaling_service.model.anatomy.hip_centre import solve_chord_centre
from tests.model.anatomy.clinic_files import clinic_trials

RNG = np.random.default_rng(3)
HIP = RNG.normal([0.0, 0.4, 0.0], 0.02, (40, 3))
KNEE = RNG.normal([0.0, 0.0, 0.06], 0.02, (40, 3))
WAND = RNG.normal([0.02, 0.2, 0.12], 0.01, (40, 3))


def test_the_centre_sees_proximal_centre_and_lateral_marker_at_a_right_angle_from_the_given_distance() -> (
    None
):
    distance = np.linspace(0.03, 0.08, 40)
    found = solve_chord_centre(HIP, KNEE, WAND, distance)
    np.testing.assert_allclose(np.linalg.norm(found - KNEE, axis=1), distance, rtol=1e-12)
    np.testing.assert_allclose(np.sum((found - KNEE) * (found - HIP), axis=1), 0.0, atol=1e-15)
    normal = np.cross(HIP - KNEE, WAND - KNEE)
    np.testing.assert_allclose(np.sum((found - KNEE) * normal, axis=1), 0.0, atol=1e-15)
    beside = np.cross(HIP - KNEE, normal)
    assert (np.sum((found - KNEE) * beside, axis=1) * np.sum((WAND - KNEE) * beside, axis=1) < 0.0).all()


def test_a_rigid_motion_takes_the_centre_along() -> None:
    turn, shift = Rotation.random(random_state=1), np.array([1.0, -2.0, 0.5])
    moved = solve_chord_centre(*(turn.apply(points) + shift for points in (HIP, KNEE, WAND)), 0.05)
    np.testing.assert_allclose(
        moved, turn.apply(solve_chord_centre(HIP, KNEE, WAND, 0.05)) + shift, atol=1e-12
    )


@pytest.mark.parametrize(
    "moved", ["proximal missing", "wand on the line", "wider than long", "no width", "one point"]
)
def test_what_has_no_solution_is_nan_in_its_frame_only(moved: str) -> None:
    hip, knee, wand, distance = HIP.copy(), KNEE.copy(), WAND.copy(), np.full(40, 0.05)
    if moved == "proximal missing":
        hip[7] = np.nan
    elif moved == "wand on the line":
        wand[7] = 0.3 * hip[7] + 0.7 * knee[7]
    elif moved == "wider than long":
        distance[7] = 0.6
    elif moved == "no width":
        distance[7] = 0.0
    else:
        hip[7] = knee[7]
    found = solve_chord_centre(hip, knee, wand, distance)
    assert np.isnan(found[7]).all()
    assert np.isfinite(np.delete(found, 7, axis=0)).all()


def test_the_centres_of_a_laboratory(shared_data: Path) -> None:
    trials = clinic_trials(shared_data)
    assert len(trials) >= 6
    for stem, lab in trials.items():
        radius = lab.sizes["MarkerDiameter"] / 2
        for side in "LR":
            knee = solve_chord_centre(
                lab.centre(f"{side}HJC"),
                lab.marker(f"{side}KNE"),
                lab.marker(f"{side}THI"),
                lab.sizes[f"{side}KneeWidth"] / 2 + radius,
            )
            ankle = solve_chord_centre(
                knee,
                lab.marker(f"{side}ANK"),
                lab.marker(f"{side}TIB"),
                lab.sizes[f"{side}AnkleWidth"] / 2 + radius,
            )
            for name, found in (("FEO", knee), ("TIO", ankle)):
                distance = np.linalg.norm(found - lab.centre(side + name), axis=1)
                assert np.nanmax(distance) < 1e-4, f"{stem} {side}{name}"  # m; measured: at most 0.07 mm
                assert np.isfinite(distance).sum() > 0.9 * len(distance), f"{stem} {side}{name}"
