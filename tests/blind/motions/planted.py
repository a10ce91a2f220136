"""From a plan to a movement whose centre of pressure stays where the feet press, and the force of each foot.

The horizontal path of the pelvis is corrected as humanoid robots do it: the error of the zero-moment point is
removed by a shift dx of the centre of mass with ``dx - (h / g) dx'' = -error`` (Kajita et al. 2003, dynamics
filter).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator, make_interp_spline
from scipy.linalg import solve_banded
from scipy.spatial.transform import Rotation

from tests.blind.bodies.whole_body import ANKLE_HEIGHT_M, BALL_X_M
from tests.blind.body import Array, Body
from tests.blind.engine import Engine
from tests.blind.motions.legs import leg_angles
from tests.blind.motions.motion import MARGIN_S, RATE_HZ, Motion, low_passed, rates
from tests.blind.motions.plans import Foot, Plan, plan, rise

CUTOFF_HZ = 6.0
"""Of the coordinates: voluntary movement lies below (Winter 2009)."""

ROUNDS = 4
"""Of the correction (chosen: by then the pressed point is as near as it gets, see the tests)."""


@dataclass(frozen=True)
class Pressing:
    """Where the feet press, (n, 2, 3), m, right first; and the right one's share of the force (n,)."""

    times: Array
    points: Array
    right_share: Array

    def at(self, times: Array) -> Pressing:
        """On another clock, without overshoot."""
        points = PchipInterpolator(self.times, self.points, axis=0)(times)
        return Pressing(times, points, PchipInterpolator(self.times, self.right_share)(times))


def planted(
    kind: str, name: str, body: Body, rng: np.random.Generator, duration_s: float = 5.0
) -> tuple[Motion, Pressing]:
    """A movement on the ground, and where the feet press."""
    made = plan(kind, body, rng, duration_s)
    engine = Engine(body)
    dt = 1 / RATE_HZ
    feet = (made.right, made.left)
    pressed = np.stack([f.pressed for f in feet], axis=1)
    share = np.stack([made.right_share, 1 - made.right_share], axis=1)
    wanted = np.einsum("nk,nka->na", share, pressed)
    pelvis = _first_path(made)
    height = _centre_height(body)
    inside = rise((made.times - made.times[0]) / MARGIN_S) * rise((made.times[-1] - made.times) / MARGIN_S)
    for _ in range(ROUNDS):
        q = _coordinates(body, made, feet, pelvis, engine.coordinates)
        found = engine.ground_wrench(*rates(made.times, q))
        error = inside[:, None] * (centre_of_pressure(found) - wanted)
        for axis in (0, 2):
            pelvis[:, axis] -= _undone(error[:, axis], height / 9.80665 / dt**2)
        pelvis = np.column_stack(
            [low_passed(pelvis[:, 0], CUTOFF_HZ), pelvis[:, 1], low_passed(pelvis[:, 2], CUTOFF_HZ)]
        )
    q = _coordinates(body, made, feet, pelvis, engine.coordinates)
    q, qd, qdd = rates(made.times, q)
    kept = (made.times > -1e-9) & (made.times < made.times[-1] - MARGIN_S + 1e-9)
    motion = Motion(name, made.times[kept], engine.coordinates, q[kept], qd[kept], qdd[kept])
    return motion, Pressing(made.times[kept], pressed[kept], made.right_share[kept])


def centre_of_pressure(wrench: Array) -> Array:
    """Where the floor y = 0 is pressed, (n, 3), m, from force and moment about the origin (n, 6)."""
    fy, mx, mz = wrench[:, 1], wrench[:, 3], wrench[:, 5]
    return np.stack([mz / fy, np.zeros(len(fy)), -mx / fy], axis=1)


def feet_wrenches(total: Array, pressing: Pressing) -> Array:
    """Share the total wrench (n, 6) between the feet, (n, 2, 6): force, and moment about the origin.

    Each foot presses on its planned point, both moved alike by what the total asks for; what is left is a
    moment about the vertical, shared as the force.
    """
    share = np.stack([pressing.right_share, 1 - pressing.right_share], axis=1)
    planned = np.einsum("nk,nka->na", share, pressing.points)
    points = pressing.points + (centre_of_pressure(total) - planned)[:, None]
    force = share[..., None] * total[:, None, :3]
    moment = np.cross(points, force)
    moment += share[..., None] * (total[:, 3:] - moment.sum(axis=1))[:, None]
    return np.concatenate([force, moment], axis=2)


def upsampled(times: Array, values: Array, new: Array) -> Array:
    """Values on a finer clock by a quintic spline."""
    fine: Array = make_interp_spline(times, values, k=5)(new)
    return fine


def _first_path(made: Plan) -> Array:
    middle = (
        made.right_share[:, None] * made.right.pressed + (1 - made.right_share[:, None]) * made.left.pressed
    )
    path = np.zeros((len(made.times), 3))
    path[:, 0] = middle[:, 0].mean() + made.ahead
    path[:, 2] = 0.6 * (middle[:, 2] - middle[:, 2].mean()) + middle[:, 2].mean()
    return low_passed(path, 1.5)


def _coordinates(
    body: Body, made: Plan, feet: tuple[Foot, Foot], pelvis: Array, order: tuple[str, ...]
) -> Array:
    angles = [made.turns[c] for c in ("pelvis_rotation", "pelvis_list", "pelvis_tilt")]
    R_pelvis = Rotation.from_euler("YXZ", np.stack(angles, axis=1)).as_matrix()
    placed = [_ankle(body, foot, s) for foot, s in zip(feet, (1.0, -1.0), strict=True)]
    pelvis[:, 1] = _reach(body, pelvis, R_pelvis, placed) - made.lowered
    columns = {**made.turns, **{f"pelvis_t{a}": pelvis[:, k] for k, a in enumerate("xyz")}}
    for side, (ankle, R_foot) in zip(("r", "l"), placed, strict=True):
        columns |= leg_angles(body, side, pelvis, R_pelvis, ankle, R_foot)
    return low_passed(np.stack([columns[c] for c in order], axis=1), CUTOFF_HZ)


def _ankle(body: Body, foot: Foot, s: float) -> tuple[Array, Array]:
    size = body.marker("RTOE").at[0] / 0.130
    yaw = np.full(len(foot.pitch), -s * foot.yaw)
    R = Rotation.from_euler("YZ", np.stack([yaw, foot.pitch], axis=1)).as_matrix()
    ball = np.array([BALL_X_M, -ANKLE_HEIGHT_M, 0.0]) * size
    return foot.ball - R @ ball, R


def _reach(body: Body, pelvis: Array, R_pelvis: Array, placed: list[tuple[Array, Array]]) -> float:
    """The greatest constant height of the pelvis at which both legs stay bent by a few degrees."""
    lowest = np.inf
    for side, (ankle, _) in zip(("r", "l"), placed, strict=True):
        length = -0.998 * (body.of_joint(f"knee_{side}").centre[1] + body.of_joint(f"ankle_{side}").centre[1])
        offset = R_pelvis @ np.array(body.of_joint(f"hip_{side}").centre)
        away = (pelvis + offset - ankle)[:, [0, 2]]
        up = ankle[:, 1] + np.sqrt(np.maximum(length**2 - (away**2).sum(axis=1), 0.0)) - offset[:, 1]
        lowest = min(lowest, float(up.min()))
    return lowest


def _centre_height(body: Body) -> float:
    """Of the centre of mass in standing, m: 0.55 of the stature, 1.15 leg lengths (Winter 2009)."""
    return -1.15 * (body.of_joint("knee_r").centre[1] + body.of_joint("ankle_r").centre[1])


def _undone(error: Array, stiffness: float) -> Array:
    """The shift dx with ``dx - stiffness * second difference = error``, ends without acceleration."""
    n = len(error)
    bands = np.zeros((3, n))
    bands[1] = 1.0
    bands[1, 1:-1] += 2 * stiffness
    bands[0, 2:] = -stiffness
    bands[2, :-2] = -stiffness
    shift: Array = solve_banded((1, 1), bands, error)
    return shift
