"""Effects on forces against their closed forms: the same movement with and without them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.blind.bodies import person, whole_body
from tests.blind.body import GRAVITY, Array, Body
from tests.blind.clutter import NONE
from tests.blind.effects import EFFECTS
from tests.blind.engine import Engine, Poses
from tests.blind.forces import PLATE_NAMES, Plates
from tests.blind.hidden import Hidden
from tests.blind.motions.motion import Motion
from tests.blind.motions.planted import Pressing, planted
from tests.blind.recording import record
from tests.blind.strangers import STRANGERS
from tests.blind.wobble import accelerations

FORCE_N = 0.3
"""N; tolerance where a second derivative of a spline of positions stands for the engine's exact one."""


@dataclass(frozen=True)
class Pair:
    """A movement, and plates without and with an effect."""

    body: Body
    hidden: Hidden
    motion: Motion
    poses: Poses
    without: Plates
    with_it: Plates

    @property
    def plate(self) -> int:
        return PLATE_NAMES.index(self.hidden.where[0])

    def added(self) -> tuple[Array, Array]:
        """Total force and moment with the effect less those without, at the frames, (n, 3)."""
        every = slice(None, None, 5)
        force = (self.with_it.force - self.without.force).sum(axis=1)[every]
        moment = (self.with_it.moment - self.without.moment).sum(axis=1)[every]
        return force[: len(self.motion.times)], moment[: len(self.motion.times)]


@lru_cache
def movement(kind: str) -> tuple[Body, Motion, Pressing, Poses, Plates]:
    rng = np.random.default_rng(21)
    body = whole_body(person(rng))
    motion, pressing = planted(kind, kind, body, rng, 4.0)
    plates = record(body, motion, pressing, (), NONE, rng).plates
    assert plates is not None
    return body, motion, pressing, Engine(body).poses(motion.q), plates


def compared(kind: str, moving: str = "squat", seed: int = 0) -> Pair:
    body, motion, pressing, poses, without = movement(moving)
    rng = np.random.default_rng(seed)
    effect = {**EFFECTS, **STRANGERS}[kind]
    hidden = effect.draw(body, effect.sizes[2], rng)
    with_it = record(body, motion, pressing, (hidden,), NONE, rng).plates
    assert with_it is not None
    return Pair(body, hidden, motion, poses, without, with_it)


def pressed(plates: Plates, plate: int) -> Array:
    return plates.pressed()[plates.loaded[:, plate], plate]


def test_plates_together_give_what_the_body_needs() -> None:
    body, motion, _, _, plates = movement("gait")
    engine = Engine(body)
    total = engine.ground_wrench(motion.q, motion.qd, motion.qdd)
    here = np.concatenate([plates.force, plates.moment], axis=2).sum(axis=1)[::5]
    np.testing.assert_allclose(here, total[: len(here)], atol=1e-6)


def test_late_forces_are_those_of_before() -> None:
    pair = compared("force_delay", "gait")
    samples = round(pair.hidden.parameters["delay_s"] * 500)
    assert abs(samples) == 10
    a, b = pair.with_it.force, np.roll(pair.without.force, samples, axis=0)
    np.testing.assert_allclose(a[20:-20], b[20:-20], atol=1e-9)


def test_moved_plate_shifts_the_centre_of_pressure_back() -> None:
    pair = compared("plate_position", "gait")
    shift = 1e-3 * np.array([pair.hidden.parameters[f"{a}_mm"] for a in "xyz"])
    moved = pressed(pair.with_it, pair.plate) - pressed(pair.without, pair.plate)
    np.testing.assert_allclose(moved, np.tile(-shift, (len(moved), 1)), atol=1e-9)
    np.testing.assert_array_equal(pair.with_it.force, pair.without.force)
    np.testing.assert_array_equal(
        pair.with_it.moment[:, 1 - pair.plate], pair.without.moment[:, 1 - pair.plate]
    )


def test_bias_is_a_constant_force_through_the_mean_centre_of_pressure() -> None:
    pair = compared("plate_bias")
    bias = np.array([pair.hidden.parameters[f"f{a}_N"] for a in "xyz"])
    added = pair.with_it.force - pair.without.force
    np.testing.assert_allclose(added[:, pair.plate], np.tile(bias, (len(added), 1)), atol=1e-9)
    moment = (pair.with_it.moment - pair.without.moment)[:, pair.plate]
    centre = pressed(pair.without, pair.plate).mean(axis=0)
    np.testing.assert_allclose(moment, np.tile(np.cross(centre, bias), (len(added), 1)), atol=1e-9)


def test_gain_multiplies_force_and_leaves_the_centre_of_pressure() -> None:
    pair = compared("plate_gain")
    factor = pair.hidden.parameters["factor"]
    np.testing.assert_allclose(pair.with_it.force[:, pair.plate], factor * pair.without.force[:, pair.plate])
    np.testing.assert_allclose(
        pressed(pair.with_it, pair.plate), pressed(pair.without, pair.plate), atol=1e-12
    )


def test_turned_plate_turns_readings_the_other_way_about_its_centre() -> None:
    pair = compared("plate_rotation", "gait")
    back = Rotation.from_euler("y", -pair.hidden.parameters["about_vertical_deg"], degrees=True)
    a, b = pressed(pair.without, pair.plate), pressed(pair.with_it, pair.plate)
    centre = a.mean(axis=0)
    np.testing.assert_allclose(b.mean(axis=0), centre, atol=1e-9)
    np.testing.assert_allclose(b - centre, back.apply(a - centre), atol=1e-9)
    np.testing.assert_allclose(
        pair.with_it.force[:, pair.plate], back.apply(pair.without.force[:, pair.plate]), atol=1e-9
    )
    loaded = pair.without.loaded
    np.testing.assert_allclose(
        pair.with_it.free_moment()[loaded], pair.without.free_moment()[loaded], atol=1e-6
    )


def test_heavier_segment_asks_for_its_own_momentum() -> None:
    pair = compared("segment_mass", seed=2)
    segment = pair.body.segment(pair.hidden.where[0])
    place = pair.poses.point(segment.name, np.array(segment.com))
    wanted = pair.hidden.parameters["kg"] * (accelerations(pair.motion.times, place) - np.array(GRAVITY))
    np.testing.assert_allclose(pair.added()[0][10:-10], wanted[10:-10], atol=FORCE_N)


def test_shifted_centre_of_mass_asks_for_the_shifts_momentum_and_weight() -> None:
    pair = compared("segment_com")
    segment = pair.body.segment(pair.hidden.where[0])
    shift = 1e-3 * np.array([pair.hidden.parameters[f"{a}_mm"] for a in "xyz"])
    a, b = (pair.poses.point(segment.name, np.array(segment.com) + s) for s in (0 * shift, shift))
    pushes = [segment.mass * (accelerations(pair.motion.times, p) - np.array(GRAVITY)) for p in (a, b)]
    force, moment = pair.added()
    np.testing.assert_allclose(force[10:-10], (pushes[1] - pushes[0])[10:-10], atol=FORCE_N)
    wanted = np.cross(b, pushes[1]) - np.cross(a, pushes[0])
    np.testing.assert_allclose(moment[10:-10], wanted[10:-10], atol=FORCE_N)


@pytest.mark.parametrize("seed", [0, 7])
def test_carried_load_is_a_point_mass(seed: int) -> None:
    pair = compared("carried_load", "bounce", seed)
    at = 1e-3 * np.array([pair.hidden.parameters[f"{a}_mm"] for a in "xyz"])
    place = pair.poses.point(pair.hidden.where[0], at)
    push = pair.hidden.parameters["kg"] * (accelerations(pair.motion.times, place) - np.array(GRAVITY))
    force, moment = pair.added()
    np.testing.assert_allclose(force[10:-10], push[10:-10], atol=FORCE_N)
    np.testing.assert_allclose(moment[10:-10], np.cross(place, push)[10:-10], atol=FORCE_N)


def test_contact_takes_from_the_plates_what_it_bears_at_its_point() -> None:
    pair = compared("external_contact")
    force, moment = pair.added()
    start, end, rms = (pair.hidden.parameters[k] for k in ("start_s", "end_s", "rms_N"))
    inside = (pair.motion.times >= start) & (pair.motion.times <= end)
    np.testing.assert_allclose(force[~inside], 0.0, atol=0.05)  # N: the spline between frames
    assert np.sqrt(np.mean((force[inside] ** 2).sum(axis=1))) == pytest.approx(rms, rel=0.01)
    point = pair.poses.point(pair.hidden.where[0], np.array(pair.hidden.at))
    np.testing.assert_allclose(moment, np.cross(point, force), atol=0.05)
    toward = force[inside].sum(axis=0) / np.linalg.norm(force[inside].sum(axis=0))
    np.testing.assert_allclose(toward, -np.array(pair.hidden.toward), atol=1e-3)


def test_wobbling_mass_hangs_on_its_spring() -> None:
    pair = compared("wobbling_mass", "bounce")
    kg, w = pair.hidden.parameters["kg"], 2 * np.pi * pair.hidden.parameters["frequency_hz"]
    force, _ = pair.added()
    segment = pair.body.segment("torso")
    support = accelerations(pair.motion.times, pair.poses.point("torso", np.array(segment.com)))
    # Transfer from the support to the force: one harmonic at the rate of the bounce, of the vertical.
    times = pair.motion.times
    rate = _main_rate(times, support[:, 1])
    gain = _amplitude(times, force[:, 1], rate) / _amplitude(times, support[:, 1], rate)
    wanted = kg * rate**2 / (w**2 - rate**2 + 2j * 0.2 * w * rate)
    assert abs(gain - wanted) < 0.1 * abs(wanted)
    assert abs(wanted) > 0.5


def _main_rate(times: Array, signal: Array) -> float:
    """rad/s of the strongest harmonic."""
    rates = 2 * np.pi * np.arange(0.8, 2.0, 0.005)
    return float(rates[np.argmax([abs(_amplitude(times, signal, r)) for r in rates])])


def _amplitude(times: Array, signal: Array, rate: float) -> complex:
    """Complex amplitude of one frequency by least squares with a window against the others."""
    n = int(len(times) - len(times) % round(2 * np.pi / rate / (times[1] - times[0])))
    window = np.hanning(n)
    return complex(np.sum(window * signal[:n] * np.exp(-1j * rate * times[:n])) / window.sum())


def test_tilted_vertical_tilts_the_mean_force() -> None:
    pair = compared("gravity_tilt", "standing")
    mean = pair.with_it.force.sum(axis=1).mean(axis=0)
    turn = Rotation.from_rotvec(
        [pair.hidden.parameters["x_deg"], 0.0, pair.hidden.parameters["z_deg"]], degrees=True
    )
    up = mean / np.linalg.norm(mean)
    np.testing.assert_allclose(up, turn.apply([0.0, 1.0, 0.0]), atol=1e-3)


def test_saturated_plate_never_passes_its_limit() -> None:
    pair = compared("plate_saturation", "gait")
    limit = pair.hidden.parameters["limit"] * pair.without.force[:, pair.plate, 1].max()
    true, read = pair.without.force[:, pair.plate, 1], pair.with_it.force[:, pair.plate, 1]
    np.testing.assert_array_equal(read, np.minimum(true, limit))
    assert (read < true).any()


def test_drifting_clock_is_later_with_every_second() -> None:
    pair = compared("clock_drift", "gait")
    rate = 1e-3 * pair.hidden.parameters["ms_per_s"]
    k = 1500
    t = pair.with_it.times[k] * (1 - rate)
    wanted = [np.interp(t, pair.without.times, pair.without.force[:, 0, a]) for a in range(3)]
    np.testing.assert_allclose(pair.with_it.force[k, 0], wanted, atol=1e-9)
