"""What a standing or walking person plans: where the feet go, which one bears, how pelvis and trunk move."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.blind.body import Array, Body
from tests.blind.motions.motion import clock, wander

FEET_APART_M = 0.20
"""Chosen: between the balls of the feet in standing; 0.14 in walking."""


@dataclass(frozen=True)
class Foot:
    """One foot: ball and pressed point (n, 3) in ground, m; pitch (n,), toes up, and yaw, outward, rad."""

    ball: Array
    pressed: Array
    pitch: Array
    yaw: float


@dataclass(frozen=True)
class Plan:
    """A movement before the body's dynamics have their say.

    Parameters
    ----------
    times : ndarray, shape (n,), s
    right, left : Foot
    right_share : ndarray, shape (n,)
        Of the vertical force that the right foot bears.
    lowered : ndarray, shape (n,), m
        Of the pelvis, below the highest place that the legs reach.
    turns : mapping
        Pelvis and lumbar angles, rad.
    ahead : ndarray, shape (n,), m
        Of the pelvis origin before the middle of the feet, to begin with.
    """

    times: Array
    right: Foot
    left: Foot
    right_share: Array
    lowered: Array
    turns: dict[str, Array]
    ahead: Array


def plan(kind: str, body: Body, rng: np.random.Generator, duration_s: float) -> Plan:
    """A plan of one of the kinds of PLANS."""
    times = clock(duration_s)
    made = PLANS[kind](_size(body), rng, times)
    names = (
        "pelvis_rotation",
        "pelvis_list",
        "pelvis_tilt",
        "lumbar_extension",
        "lumbar_bending",
        "lumbar_rotation",
    )
    swayed = {n: made.turns.get(n, 0.0) + np.deg2rad(wander(rng, times, 0.5, 0.2, 0.8)) for n in names}
    return replace(made, turns=swayed)


def _size(body: Body) -> float:
    """Length of the legs against the reference person's."""
    return -(body.of_joint("knee_r").centre[1] + body.of_joint("ankle_r").centre[1]) / 0.84765


def rise(u: Array) -> Array:
    """0 to 1 with first and second derivatives zero at both ends."""
    v = np.clip(u, 0.0, 1.0)
    smooth: Array = v**3 * (10 - 15 * v + 6 * v**2)
    return smooth


def _planted(times: Array, size: float, s: float, apart: float = FEET_APART_M) -> Foot:
    """A foot that stays; pressed 4 cm before the ankle, as in quiet standing (chosen)."""
    ball = np.tile([0.125 * size, 0.0, s * apart / 2], (len(times), 1))
    return Foot(ball, ball - [0.085 * size, 0.0, 0.0], np.zeros(len(times)), np.deg2rad(6.0))


def _standing(size: float, rng: np.random.Generator, times: Array) -> Plan:
    share = 0.5 + wander(rng, times, 0.02, 0.1, 0.6)
    feet = [_planted(times, size, s) for s in (1.0, -1.0)]
    return Plan(times, *feet, share, np.full(len(times), 0.005), {}, np.full(len(times), 0.04 * size))


def _squat(size: float, rng: np.random.Generator, times: Array) -> Plan:
    period, depth = rng.uniform(2.0, 2.8), size * rng.uniform(0.24, 0.32)
    down = 0.5 - 0.5 * np.cos(2 * np.pi * times / period + rng.uniform(0, 6))
    turns = {"pelvis_tilt": -0.45 * down, "lumbar_extension": -0.20 * down}
    standing = _standing(size, rng, times)
    return replace(standing, lowered=0.006 + depth * down, turns=turns, ahead=0.04 - 0.12 * down)


def _bounce(size: float, rng: np.random.Generator, times: Array) -> Plan:
    """Quick knee bends: the force goes from about 0.6 to 1.4 times the weight."""
    rate, half = 2 * np.pi * rng.uniform(1.2, 1.5), size * rng.uniform(0.04, 0.06)
    down = 0.5 - 0.5 * np.cos(rate * times)
    standing = _standing(size, rng, times)
    return replace(standing, lowered=0.012 + 2 * half * down, turns={"pelvis_tilt": -0.12 * down})


def _shift(size: float, rng: np.random.Generator, times: Array) -> Plan:
    """From foot to foot, with the trunk bending and turning."""
    side = np.sin(2 * np.pi * times / rng.uniform(2.2, 3.0) + rng.uniform(0, 6))
    turns = {
        "lumbar_bending": 0.15 * side,
        "lumbar_rotation": 0.5 * np.sin(2 * np.pi * times / rng.uniform(2.5, 3.5)),
    }
    standing = _standing(size, rng, times)
    return replace(standing, right_share=0.5 + 0.35 * side, turns=turns, lowered=np.full(len(times), 0.012))


def _hips(size: float, rng: np.random.Generator, times: Array) -> Plan:
    """Standing on the left leg, the right foot circling in the air."""
    rate, radius = 2 * np.pi * rng.uniform(0.45, 0.6), size * rng.uniform(0.14, 0.18)
    right, left = (_planted(times, size, s, 0.16) for s in (1.0, -1.0))
    circle = np.stack([np.cos(rate * times), 0 * times, np.sin(rate * times)], axis=1)
    ball = right.ball + radius * circle + [0.05, 0.09 * size, 0.14 * size]
    ball[:, 1] += 0.03 * np.cos(rate * times + 1.0)
    moved = replace(right, ball=ball, pitch=np.deg2rad(12 * np.cos(rate * times)))
    bending = {"lumbar_bending": np.full(len(times), -0.08)}
    lowered, ahead = np.full(len(times), 0.01), np.full(len(times), 0.03 * size)
    return Plan(times, moved, left, np.zeros(len(times)), lowered, bending, ahead)


STANCE = 0.62
"""Share of the stride; Schwartz et al. 2008: toe-off at 59 %, later in slow walking."""


def _gait(size: float, rng: np.random.Generator, times: Array) -> Plan:
    """Slow walking on two belts, one under each foot (0.8-0.95 m/s): the feet go back, the pelvis stays."""
    stride, speed = rng.uniform(1.15, 1.3), size * rng.uniform(0.8, 0.95)
    phase = times / stride + rng.uniform()
    right = _walking_foot(phase, size, speed * stride, 1.0)
    left = _walking_foot(phase + 0.5, size, speed * stride, -1.0)
    both = STANCE - 0.5  # both feet are down for this share after each contact
    p = phase % 1.0
    early = 0.015  # a sole is soft: it bears a little before its middle is at rest
    share = rise((p + early) / both) - rise((p + early - 0.5) / both) + rise((p + early - 1.0) / both)
    angle = 2 * np.pi * phase
    turns = {
        "pelvis_rotation": np.deg2rad(4) * np.cos(angle),
        "pelvis_list": np.deg2rad(-3) * np.sin(angle),
        "lumbar_rotation": np.deg2rad(-8) * np.cos(angle),
        "lumbar_bending": np.deg2rad(4) * np.sin(angle),
    }
    lowered = 0.013 * size + 0.012 * size * np.cos(2 * angle)
    return Plan(times, right, left, share, lowered, turns, np.zeros(len(times)))


def _walking_foot(phase: Array, size: float, stride_m: float, s: float) -> Foot:
    p = phase % 1.0
    half = stride_m * STANCE / 2
    u = np.clip((p - STANCE) / (1 - STANCE), 0, 1)
    x = np.where(p < STANCE, half - stride_m * p, -half + _swung(u, 2 * half, stride_m * (1 - STANCE)))
    y = 0.055 * size * (4 * u * (1 - u)) ** 2
    ball = np.stack([x + 0.010 * size, y, np.full(len(p), s * 0.07)], axis=1)
    heel_off = rise((p - 0.34) / 0.30) * (1 - rise((p - 0.64) / 0.28))
    along = np.clip(p / 0.45, 0, 1)
    forward = size * (-0.145 + 0.145 * rise(along))  # from 2 cm behind the ankle to the ball
    pressed = np.stack([ball[:, 0] + forward, np.zeros(len(p)), ball[:, 2]], axis=1)
    return Foot(ball, pressed, np.deg2rad(-32) * heel_off, np.deg2rad(6.0))


def _swung(u: Array, ahead: float, back: float) -> Array:
    """The cubic from 0 to ``ahead`` that starts and ends with velocity ``-back`` per unit of u.

    Its acceleration jumps at contact, as a real foot's does; the coordinates are low-passed afterwards.
    """
    path: Array = ahead * u**2 * (3 - 2 * u) - back * u * (1 - u) * (1 - 2 * u)
    return path


PLANS = {
    "gait": _gait, "squat": _squat, "hips": _hips, "standing": _standing, "bounce": _bounce, "shift": _shift,
}  # fmt: skip
