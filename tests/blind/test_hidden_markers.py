"""Effects on markers against their closed forms: the same movement with and without them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.blind.bodies import lower_limb, person
from tests.blind.body import Array, Body
from tests.blind.clutter import NONE
from tests.blind.effects import EFFECTS
from tests.blind.effects.missing_dof import MissingDof
from tests.blind.engine import Engine, Poses
from tests.blind.hidden import Hidden
from tests.blind.motions.free import free
from tests.blind.motions.motion import Motion
from tests.blind.recording import record
from tests.blind.strangers import STRANGERS
from tests.blind.wobble import lag


@dataclass(frozen=True)
class Pair:
    """A movement, and markers (n, m, 3) without and with an effect."""

    body: Body
    motion: Motion
    poses: Poses
    without: Array
    with_it: Array

    def shift(self, marker: str) -> Array:
        """How far a marker moved, in its segment's frame of the given body, m."""
        k = self.body.marker_names.index(marker)
        R = self.poses.R[:, self.poses.segments.index(self.body.marker(marker).segment)]
        moved: Array = np.einsum("nji,nj->ni", R, self.with_it[:, k] - self.without[:, k])
        return moved


def drawn(kind: str, seed: int = 0) -> tuple[Body, Hidden]:
    rng = np.random.default_rng(seed)
    body = lower_limb(person(rng))
    effect = {**EFFECTS, **STRANGERS}[kind]
    return body, effect.draw(body, effect.sizes[2], rng)


def compared(body: Body, hidden: Hidden, movement: str = "gait") -> Pair:
    rng = np.random.default_rng(5)
    engine = Engine(body)
    motion = free(movement, movement, rng, 4.0).ordered(engine.coordinates)
    without, with_it = (record(body, motion, None, h, NONE, rng).markers for h in ([], [hidden]))
    return Pair(body, motion, engine.poses(motion.q), without, with_it)


def true_poses(body: Body, hidden: Hidden, motion: Motion) -> Poses:
    engine = Engine(hidden.body(body))
    return engine.poses(motion.ordered(engine.coordinates).q)


def vector(hidden: Hidden, unit: str) -> Array:
    return np.array([hidden.parameters[f"{a}_{unit}"] for a in "xyz"])


def test_marker_offset_is_constant_in_its_segment() -> None:
    body, hidden = drawn("marker_offset")
    pair = compared(body, hidden)
    np.testing.assert_allclose(
        pair.shift(hidden.where[0]), np.tile(1e-3 * vector(hidden, "mm"), (400, 1)), atol=1e-12
    )
    others = [k for k, m in enumerate(body.marker_names) if m not in hidden.where]
    np.testing.assert_array_equal(pair.with_it[:, others], pair.without[:, others])


def test_marker_swap_exchanges_two_labels_within_its_interval_only() -> None:
    body, hidden = drawn("marker_swap")
    pair = compared(body, hidden)
    a, b = (body.marker_names.index(m) for m in hidden.where)
    when = (pair.motion.times >= hidden.parameters["start_s"]) & (
        pair.motion.times <= hidden.parameters["end_s"]
    )
    assert when.any()
    assert not when.all()
    np.testing.assert_array_equal(pair.with_it[when, a], pair.without[when, b])
    np.testing.assert_array_equal(pair.with_it[when, b], pair.without[when, a])
    np.testing.assert_array_equal(pair.with_it[~when], pair.without[~when])


@pytest.mark.parametrize("seed", range(3))
def test_artefact_is_linear_in_the_drivers_degrees(seed: int) -> None:
    body, hidden = drawn("soft_tissue_artefact", seed)
    pair = compared(body, hidden, "squat")
    degrees = np.rad2deg(pair.motion.column(hidden.driver[0]))
    for marker in hidden.where:
        wanted = 1e-3 * np.outer(degrees, vector(hidden, "mm_per_deg"))
        np.testing.assert_allclose(pair.shift(marker), wanted, atol=1e-12)


def test_lag_of_a_shaken_mass_is_that_of_the_harmonic_oscillator() -> None:
    times = np.arange(0, 20, 0.005)
    natural, shaken, damping, amplitude = 2 * np.pi * 5.0, 2 * np.pi * 2.0, 0.2, 3.0
    shaking = amplitude * np.cos(shaken * times)[:, None]
    s, second = lag(times, shaking, 5.0, damping)
    gain = -amplitude / (natural**2 - shaken**2 + 2j * damping * natural * shaken)
    steady = np.real(gain * np.exp(1j * shaken * times))
    late = times > 5.0  # the start has died out: exp(-2 pi) cubed
    np.testing.assert_allclose(s[late, 0], steady[late], atol=2e-3 * abs(gain))
    np.testing.assert_allclose(
        second[late, 0], -(shaken**2) * steady[late], atol=5e-3 * abs(gain) * shaken**2
    )


def test_wobbling_skin_follows_its_equation() -> None:
    body, hidden = drawn("skin_wobble")
    pair = compared(body, hidden)
    k = body.marker_names.index(hidden.where[0])
    dt = 0.01
    s = pair.with_it[:, k] - pair.without[:, k]
    w, damping = 2 * np.pi * hidden.parameters["frequency_hz"], hidden.parameters["damping"]
    # Fourth-order differences over the inner frames; the equation's terms are of several m/s^2.
    rate = (s[:-4] - 8 * s[1:-3] + 8 * s[3:-1] - s[4:]) / (12 * dt)
    second = (-s[:-4] + 16 * s[1:-3] - 30 * s[2:-2] + 16 * s[3:-1] - s[4:]) / (12 * dt**2)
    p = pair.without[:, k]
    support = (-p[:-4] + 16 * p[1:-3] - 30 * p[2:-2] + 16 * p[3:-1] - p[4:]) / (12 * dt**2)
    left = second + 2 * damping * w * rate + w**2 * s[2:-2] + support
    assert np.sqrt(np.mean(left[10:-10] ** 2)) < 0.02 * np.sqrt(np.mean(support**2))
    assert np.linalg.norm(s, axis=1).max() > 1e-3


def test_longer_segment_carries_its_markers_and_the_next_joint() -> None:
    body, hidden = drawn("segment_length", 3)
    name, factor = hidden.where[0], hidden.parameters["factor"]
    pair = compared(body, hidden)
    there = true_poses(body, hidden, pair.motion)
    child = next(s.name for s in body.segments if s.parent == name)

    def length(poses: Poses) -> Array:
        a, b = (poses.segments.index(s) for s in (name, child))
        return np.linalg.norm(poses.origin[:, a] - poses.origin[:, b], axis=1)

    np.testing.assert_allclose(length(there) / length(pair.poses), factor, rtol=1e-12)
    a, b = (body.marker_names.index(m) for m in body.on(name)[:2])
    spans = [np.linalg.norm(m[:, a] - m[:, b], axis=1) for m in (pair.without, pair.with_it)]
    np.testing.assert_allclose(spans[1] / spans[0], factor, rtol=1e-12)


def test_joint_centre_moves_in_the_parent() -> None:
    body, hidden = drawn("joint_centre_offset")
    pair = compared(body, hidden)
    there = true_poses(body, hidden, pair.motion)
    segment = body.of_joint(hidden.where[0])
    parent, child = (there.segments.index(s) for s in (segment.parent, segment.name))
    moved = there.origin[:, child] - pair.poses.origin[:, child]
    in_parent = np.einsum("nji,nj->ni", there.R[:, parent], moved)
    np.testing.assert_allclose(in_parent, np.tile(1e-3 * vector(hidden, "mm"), (400, 1)), atol=1e-12)


def test_tilted_hinge_turns_about_the_turned_axis_by_the_same_angle() -> None:
    body, hidden = drawn("joint_axis_tilt")
    pair = compared(body, hidden, "squat")
    there = true_poses(body, hidden, pair.motion)
    segment = body.of_joint(hidden.where[0])
    parent, child = (there.segments.index(s) for s in (segment.parent, segment.name))
    turn = Rotation.from_matrix(np.swapaxes(there.R[:, parent], 1, 2) @ there.R[:, child]).as_rotvec()
    x, y = (np.deg2rad(hidden.parameters[f"{a}_deg"]) for a in "xy")
    axis = (Rotation.from_euler("y", y) * Rotation.from_euler("x", x)).apply([0.0, 0.0, -1.0])
    angle = pair.motion.column(f"knee_angle_{hidden.where[0][-1]}")
    np.testing.assert_allclose(turn, np.outer(angle, axis), atol=1e-9)


@pytest.mark.parametrize(("unit", "axis"), [("deg", "y"), ("mm", "x")])
def test_hidden_freedom_has_its_axis_and_size(unit: str, axis: str) -> None:
    body = lower_limb(person(np.random.default_rng(1)))
    hidden = MissingDof(kind="missing_dof", where=("knee_r",), parameters={f"rms_{unit}": 8.0}, axis=axis)
    rng = np.random.default_rng(2)
    motion = free("squat", "squat", rng, 4.0)
    extended = hidden.motion(motion, rng)
    engine, true = Engine(body), Engine(hidden.body(body))
    before = engine.poses(motion.ordered(engine.coordinates).q)
    after = true.poses(extended.ordered(true.coordinates).q)
    k, parent = before.segments.index("tibia_r"), before.segments.index("femur_r")
    if unit == "deg":
        turn = Rotation.from_matrix(np.swapaxes(before.R[:, k], 1, 2) @ after.R[:, k]).as_rotvec(degrees=True)
        np.testing.assert_allclose(turn[:, [0, 2]], 0.0, atol=1e-9)
        size = turn[:, 1]
    else:
        glide = np.einsum("nji,nj->ni", before.R[:, parent], after.origin[:, k] - before.origin[:, k])
        np.testing.assert_allclose(glide[:, 1:], 0.0, atol=1e-12)
        size = 1e3 * glide[:, 0]
    assert np.sqrt(np.mean(size**2)) == pytest.approx(8.0, rel=1e-6)
    knee = motion.column("knee_angle_r")
    assert abs(np.corrcoef(size, knee)[0, 1]) < 0.8  # a pattern of its own


def test_coupled_glide_is_linear_in_the_knee() -> None:
    body, hidden = drawn("coupled_motion")
    pair = compared(body, hidden, "squat")
    there = true_poses(body, hidden, pair.motion)
    segment = body.of_joint(hidden.where[0])
    parent, child = (there.segments.index(s) for s in (segment.parent, segment.name))
    moved = there.origin[:, child] - pair.poses.origin[:, child]
    in_parent = np.einsum("nji,nj->ni", there.R[:, parent], moved)
    degrees = np.rad2deg(pair.motion.column(hidden.driver[0]))
    np.testing.assert_allclose(in_parent, 1e-3 * np.outer(degrees, vector(hidden, "mm_per_deg")), atol=1e-12)


def test_capture_scale_scales_every_distance() -> None:
    body, hidden = drawn("capture_scale")
    pair = compared(body, hidden)
    np.testing.assert_allclose(pair.with_it, hidden.parameters["factor"] * pair.without, rtol=1e-14)


def test_restuck_marker_is_right_until_it_is_not() -> None:
    body, hidden = drawn("marker_restuck")
    pair = compared(body, hidden)
    shift, after = pair.shift(hidden.where[0]), pair.motion.times >= hidden.parameters["from_s"]
    assert after.any()
    np.testing.assert_array_equal(shift[~after], 0.0)
    wanted = np.tile(1e-3 * vector(hidden, "mm"), (int(after.sum()), 1))
    np.testing.assert_allclose(shift[after], wanted, atol=1e-12)
