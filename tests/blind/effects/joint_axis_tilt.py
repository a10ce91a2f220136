"""The axis of a hinge is turned: its R becomes T R T^-1 with T = Ry(y) Rx(x) in the parent's frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.blind.body import Body, Move
from tests.blind.hidden import Effect, Hidden, one


@dataclass(frozen=True, kw_only=True)
class JointAxisTilt(Hidden):
    """``x_deg``, ``y_deg``: true minus modelled."""

    def body(self, body: Body) -> Body:
        segment = body.of_joint(self.where[0])
        x, y = (float(np.deg2rad(self.parameters[f"{a}_deg"])) for a in "xy")
        X, Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
        there = (Move("turn", Y, constant=y), Move("turn", X, constant=x))
        back = (Move("turn", X, constant=-x), Move("turn", Y, constant=-y))
        return body.with_segment(replace(segment, moves=(*there, *segment.moves, *back)))


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """A knee, turned in any direction across its axis."""
    angle = rng.uniform(0, 2 * np.pi)
    parameters = {"x_deg": float(size * np.cos(angle)), "y_deg": float(size * np.sin(angle))}
    return JointAxisTilt(
        kind="joint_axis_tilt", where=(one(rng, ["knee_r", "knee_l"]),), parameters=parameters
    )


EFFECT = Effect("joint_axis_tilt", "markers", "deg", (1.3, 4.0, 12.0), draw)
