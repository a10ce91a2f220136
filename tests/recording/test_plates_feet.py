"""Who stands on which plate: made walks whose answer is known, and real recordings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scaling_service.core.arrays import Array
from scaling_service.core.errors import TrialUnusable
from scaling_service.files.forces import read_forces
from scaling_service.files.recording import read_recording
from scaling_service.model.forces import GroundForces
from scaling_service.recording.plates import synchronise
from scaling_service.recording.plates_feet import (
    NOBODY,
    FootContacts,
    assign_foot_loads,
    assign_plates,
    measure_overhang,
)

STEP, N = 0.01, 200
TIMES = STEP * np.arange(N)
RIGHT, LEFT = (0.0, 0.1), (0.6, -0.1)
"""Where the heels stand, x and z; toes are 0.2 m ahead."""


def foot(heel: tuple[float, float], standing: slice) -> Array:
    """Heel and toe markers of a foot that swings in before and out after it stands."""
    before, after = np.arange(N) < standing.start, np.arange(N) >= standing.stop
    x = heel[0] - 3.0 * np.where(before, standing.start * STEP - TIMES, 0.0)
    x = x + 3.0 * np.where(after, TIMES - (standing.stop - 1) * STEP, 0.0)
    y = 0.03 + 0.1 * (before | after)
    at = np.stack([x, y, np.full(N, heel[1])], axis=1)
    return np.stack([at, at + np.array([0.2, 0.01, 0.0])], axis=1)


def pressed(places: list[tuple[tuple[float, float], slice]]) -> GroundForces:
    """Plates pressed with 600 N, 0.1 m before a heel."""
    force, moment = np.zeros((2, N, len(places), 3))
    for k, (heel, when) in enumerate(places):
        force[when, k, 1] = 600.0
        moment[when, k] = np.cross([heel[0] + 0.1, 0.0, heel[1]], [0.0, 600.0, 0.0])
    up = np.tile([0.0, 1.0, 0.0], (len(places), 1))
    names = tuple(f"plate_{k + 1}" for k in range(len(places)))
    return GroundForces(
        name="made",
        times=TIMES,
        plates=names,
        force=force,
        moment=moment,
        surfaces=np.zeros((len(places), 3)),
        normals=up,
    )


FIRST, SECOND = slice(20, 110), slice(90, 180)
FEET = {"r": foot(RIGHT, FIRST), "l": foot(LEFT, SECOND)}


def whats(contacts: FootContacts) -> set[str]:
    return {r.what for r in contacts.repairs}


def test_each_contact_goes_to_the_foot_under_it() -> None:
    contacts = assign_plates(pressed([(LEFT, SECOND), (RIGHT, FIRST)]), FEET)
    assert (contacts.foot[SECOND, 0] == 1).all()
    assert (contacts.foot[FIRST, 1] == 0).all()
    assert (contacts.foot[:20] == NOBODY).all()
    assert whats(contacts) == {"plate_foot"}
    assert contacts.supported.all()
    assert contacts.on_floor[95:105].all()


def test_pressure_that_something_moves_off_the_foot_still_goes_to_the_only_one_that_stands() -> None:
    moved = (LEFT[0] + 0.05, LEFT[1] - 0.2)
    contacts = assign_plates(pressed([(moved, SECOND), (RIGHT, FIRST)]), FEET)
    assert (contacts.foot[SECOND, 0] == 1).all()
    assert whats(contacts) == {"plate_foot", "pressure_astray"}
    forces = pressed([(moved, SECOND), (RIGHT, FIRST)])
    stick = replace(forces, force=forces.force * [[[0.2], [1.0]]], moment=forces.moment * [[[0.2], [1.0]]])
    assert (assign_plates(stick, FEET).foot[:, 0] == NOBODY).all()


def test_loads_go_to_the_segments_of_the_feet() -> None:
    forces = pressed([(LEFT, SECOND), (RIGHT, FIRST)])
    loads = assign_foot_loads(forces, assign_plates(forces, FEET), {"r": "calcn_r", "l": "calcn_l"})
    assert loads.segments == ("calcn_r", "calcn_l")
    np.testing.assert_array_equal(loads.force[:, 0], forces.force[:, 1])
    np.testing.assert_array_equal(loads.moment[:, 1], forces.moment[:, 0])


def test_a_foot_across_two_plates_receives_both_and_is_reported() -> None:
    forces = pressed([(RIGHT, FIRST), (RIGHT, FIRST), (LEFT, SECOND)])
    contacts = assign_plates(forces, FEET)
    assert "two_plates" in whats(contacts)
    loads = assign_foot_loads(forces, contacts, {"r": "calcn_r", "l": "calcn_l"})
    np.testing.assert_array_equal(loads.force[50, 0], [0, 1200, 0])


def test_a_plate_under_two_feet_is_reported() -> None:
    together = slice(20, 180)
    near = (0.05, -0.1)
    between = pressed([((0.0, 0.0), together)])
    contacts = assign_plates(between, {"r": foot(RIGHT, together), "l": foot(near, together)})
    assert "two_feet" in whats(contacts)
    assert not contacts.supported[30:170].any()  # one foot bears nothing that is known


def test_a_foot_beside_the_plates_is_reported_and_its_frames_are_not_supported() -> None:
    contacts = assign_plates(pressed([(RIGHT, FIRST)]), FEET)
    assert "no_plate" in whats(contacts)
    assert contacts.supported[25:85].all()
    assert not contacts.supported[95:175].any()


def test_loads_far_from_any_foot_are_refused() -> None:
    with pytest.raises(TrialUnusable, match="no load is near a foot"):
        assign_plates(pressed([((5.0, 5.0), FIRST)]), FEET)


def test_an_unknown_force_makes_its_frame_unknown_for_every_foot() -> None:
    forces = pressed([(LEFT, SECOND), (RIGHT, FIRST)])
    force = forces.force.copy()
    force[50, 0, 0] = np.nan
    forces = replace(forces, force=force)
    contacts = assign_plates(forces, FEET)
    loads = assign_foot_loads(forces, contacts, {"r": "calcn_r", "l": "calcn_l"})
    assert np.flatnonzero(np.isnan(loads.force).any(axis=(1, 2))).tolist() == [50]
    assert not contacts.supported[50]


def test_a_treadmill_is_a_floor_that_moves() -> None:
    back = np.zeros((N, 1, 3))
    back[:, 0, 0] = -1.2 * TIMES
    forces = pressed([(LEFT, SECOND), (RIGHT, FIRST)])
    moved = replace(forces, moment=forces.moment + np.cross(back, forces.force))
    contacts = assign_plates(moved, {name: markers + back for name, markers in FEET.items()})
    assert whats(contacts) == {"belt", "plate_foot"}
    assert contacts.supported.all()


REAL = {
    "gait2354": ("subject01_walk1.trc", "subject01_walk1_grf.mot", ("R.Heel", "R.Toe.Tip"), 151),
    "rajagopal_walk": ("motion_capture_walk.trc", "grf_walk.mot", ("R.Heel", "R.Toe", "R.MT5"), 159),
    "opencap_squat": ("squats1.trc", "squats1_grf.mot", ("r_calc", "r_toe"), 1346),
}


@pytest.mark.parametrize("name", REAL)
def test_real_plates_bear_the_feet_that_their_set_ups_name(shared_data: Path, name: str) -> None:
    markers, forces, right, supported = REAL[name]
    trial = read_recording(shared_data / name / markers)
    left = [f"L{label[1:]}" for label in right]
    feet = {
        side: np.stack([trial.position(label) for label in labels], axis=1)
        for side, labels in (("r", right), ("l", left))
    }
    contacts = assign_plates(
        synchronise(read_forces(shared_data / name / forces), trial.times, cutoff_hz=6.0), feet
    )
    borne = {(r.where, r.detail.split()[2]) for r in contacts.repairs if r.what == "plate_foot"}
    assert borne == {("plate_1", "right"), ("plate_2", "left")}
    assert contacts.supported.sum() == supported  # the walker leaves two plates; the treadmill holds all


def test_a_foot_over_the_edge_of_its_plate_is_borne_by_the_floor_too() -> None:
    """A plate ends 0.1 m before the left toe; then it is long enough, or another lies behind it."""
    forces = pressed([(LEFT, SECOND), (RIGHT, FIRST)])

    def rim(x: tuple[float, float], z: tuple[float, float]) -> Array:
        return np.array([[x[1], 0.0, z[1]], [x[0], 0.0, z[1]], [x[0], 0.0, z[0]], [x[1], 0.0, z[0]]])

    right, short = rim((-0.1, 0.4), (0.0, 0.3)), rim((0.5, 0.7), (-0.3, 0.0))
    contacts = assign_plates(replace(forces, corners=np.stack([short, right])), FEET)
    assert "over_edge" in whats(contacts)
    (note,) = [r for r in contacts.repairs if r.what == "over_edge"]
    assert note.where == "l"
    assert "reaches 100 mm beyond the edge of plate 1" in note.detail
    assert contacts.over_edge[SECOND, 1].all()
    assert not contacts.over_edge[:, 0].any()
    assert not contacts.supported[SECOND].any()
    assert contacts.supported[20:85].all()
    for enough in (rim((0.5, 0.9), (-0.3, 0.0)), rim((0.5, 0.81), (-0.3, 0.0))):
        made = assign_plates(replace(forces, corners=np.stack([enough, right])), FEET)
        assert made.supported.all()
        assert "over_edge" not in whats(made)
    behind = np.stack([short, right, rim((0.7, 1.0), (-0.3, 0.0))])
    assert measure_overhang(behind, FEET["l"])[SECOND].max() < 0.0  # a second plate behind the first one
    assert not assign_plates(forces, FEET).over_edge.any()  # no file tells where its plates end
    unseen = np.concatenate([FEET["l"], np.full((N, 1, 3), np.nan)], axis=1)
    np.testing.assert_array_equal(measure_overhang(behind, unseen), measure_overhang(behind, FEET["l"]))


@pytest.mark.parametrize("quarter", range(4))
def test_a_plate_whose_corners_begin_at_another_one_is_told(quarter: int) -> None:
    """Pressure turns about the middle of the plate, which lies 0.15 m before it and 0.12 m to the right."""
    middle, off = np.array([0.25, 0.22]), np.array([-0.15, -0.12])
    turned = middle + np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), quarter) @ off
    forces = pressed([(LEFT, SECOND), ((turned[0] - 0.1, turned[1]), FIRST)])
    surfaces = np.array([[0.7, 0.0, -0.1], [middle[0], 0.0, middle[1]]])
    square = 0.4 * np.array([[1, 0, 1], [-1, 0, 1], [-1, 0, -1], [1, 0, -1]])
    found = replace(forces, surfaces=surfaces, corners=surfaces[:, None] + square)
    told = [r.where for r in assign_plates(found, FEET).repairs if r.what == "turned_plate"]
    assert told == ([] if quarter == 0 else ["plate_2"])
