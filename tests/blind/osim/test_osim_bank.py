"""The maker against closed forms and the product's dynamics, and six cases through the command line."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from scaling_service.cli import main
from tests.blind.body import Array, Body, Move
from tests.blind.cases import Case
from tests.blind.effects.gravity_tilt import GravityTilt
from tests.blind.osim.cases import BodyMass, HingeTilt, ScaledSegment, cases, sample
from tests.blind.osim.engine import OsimBody, OsimEngine, read_body
from tests.blind.osim.making import MODEL, make
from tests.blind.real.angles import data_folder
from tests.blind.scoring.outcomes import Outcome
from tests.blind.scoring.records import Record

DATA = data_folder()
pytestmark = [
    pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed"),
    pytest.mark.skipif(DATA is None, reason="the real recordings are not here: set SCALING_SERVICE_DATA"),
]

FRAMES = 30


@pytest.fixture(scope="module")
def body() -> OsimBody:
    assert DATA is not None
    return read_body(DATA / MODEL)


def moving(body: Body, bent: float = 1.0) -> Array:
    """A bent knee that bends on, everything else still."""
    q = np.zeros((FRAMES, len(body.coordinates)))
    q[:, body.coordinates.index("knee_angle_r")] = bent * np.linspace(0.5, 1.0, FRAMES)
    return q


def at(body: Body, name: str, bent: float = 1.0) -> Array:
    """Path of a marker."""
    engine = OsimEngine(body)
    markers = engine.markers(engine.poses(moving(body, bent)))
    path: Array = markers[:, body.marker_names.index(name)]
    return path


def test_a_glide_moves_the_shank_by_the_driver(body: OsimBody) -> None:
    knee = body.of_joint("walker_knee_r")
    glide = Move("slide", (0.0, 0.0, 1.0), (("knee_angle_r", 0.01),))
    gliding = body.with_segment(replace(knee, moves=(glide, *knee.moves)))
    shift = at(gliding, "r_ankle") - at(body, "r_ankle")
    expected = np.outer(0.01 * np.linspace(0.5, 1.0, FRAMES), [0.0, 0.0, 1.0])
    np.testing.assert_allclose(shift, expected, atol=1e-9)  # m: nothing turns the thigh here


def test_a_tilt_and_back_leaves_a_straight_knee_and_turns_a_bent_one(body: OsimBody) -> None:
    parameters = {"y_deg": 10.0, "z_deg": 5.0}
    tilted = HingeTilt(kind="joint_axis_tilt", where=("walker_knee_r",), parameters=parameters).body(body)
    away = np.linalg.norm(at(tilted, "r_ankle") - at(body, "r_ankle"), axis=1)
    np.testing.assert_array_less(0.02, away)  # m: a shank of 0.4 m, bent by 0.5 rad about a turned axis
    assert np.all(np.diff(away) > 0)
    straight = np.linalg.norm(at(tilted, "r_ankle", bent=0.0) - at(body, "r_ankle", bent=0.0), axis=1)
    np.testing.assert_array_less(straight, 2e-3)  # m: what the knee glides by, turned


def test_a_scaled_thigh_takes_the_shank_along(body: OsimBody) -> None:
    longer = ScaledSegment(kind="segment_length", where=("femur_r",), parameters={"factor": 1.1}).body(body)
    centre = np.array(body.of_joint("walker_knee_r").centre)
    lowered = at(longer, "r_ankle") - at(body, "r_ankle")
    # The knee's glide, some mm, grows along with the place of its centre.
    np.testing.assert_allclose(lowered, np.tile(0.1 * centre, (FRAMES, 1)), atol=2e-3)


def test_the_ground_bears_a_heavier_body_and_another_vertical(body: OsimBody) -> None:
    still = np.zeros((FRAMES, len(body.coordinates)))
    heavier = BodyMass(kind="body_mass", where=("world",), parameters={"factor": 1.1}).body(body)
    tilted = GravityTilt(kind="gravity_tilt", where=("world",), parameters={"x_deg": 0.0, "z_deg": 2.0})
    weight = 1.1 * body.mass * np.array(tilted.body(heavier).gravity)
    wrench = OsimEngine(tilted.body(heavier)).ground_wrench(still, still, still)
    np.testing.assert_allclose(wrench[:, :3], np.tile(-weight, (FRAMES, 1)), atol=1e-6)


def outcome(case: Case, folder: Path) -> Record:
    """What the command line says of a case."""
    assert DATA is not None
    subject = make(case, folder, DATA)
    assert main(["discover", str(subject), "--start", "none", "--out", str(folder / "out")]) == 0
    truth = json.loads((folder / "labels" / f"{case.id}.json").read_text(encoding="utf-8"))
    result = json.loads((folder / "out" / "discovery.json").read_text(encoding="utf-8"))
    return Outcome(truth, result, None).record


def test_the_bank_has_two_sizes_and_a_dozen_disturbances() -> None:
    kinds = {group: {c.kinds[0] for c in cases() if c.group == group} for group in ("effect", "stranger")}
    assert len(kinds["effect"]) >= 22
    assert len(kinds["stranger"]) >= 12
    assert len({c.id for c in cases()}) == len(cases())


@pytest.mark.costly
@pytest.mark.parametrize("case", sample(), ids=lambda case: case.kinds[0])
def test_a_sample_is_named_silent_or_unexplained_as_it_should_be(case: Case, tmp_path: Path) -> None:
    found = outcome(case, tmp_path)
    if case.group == "effect":
        assert found.right, found.named
    else:
        assert not found.named
    if case.group == "stranger":
        assert found.verdict == "unexplained"
