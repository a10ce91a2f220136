"""A joint glides with a coordinate: the shank slides in the thigh as the knee bends."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.blind.body import Body, Move
from tests.blind.hidden import Effect, Hidden, direction, one


@dataclass(frozen=True, kw_only=True)
class CoupledMotion(Hidden):
    """``x_mm_per_deg`` ... along the axes of the parent, times the driver in degrees from its zero."""

    def body(self, body: Body) -> Body:
        segment = body.of_joint(self.where[0])
        gains = [1e-3 * np.rad2deg(self.parameters[f"{a}_mm_per_deg"]) for a in "xyz"]
        axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        glides = tuple(
            Move("slide", axis, ((self.driver[0], float(gain)),))
            for axis, gain in zip(axes, gains, strict=True)
        )
        return body.with_segment(replace(segment, moves=(*glides, *segment.moves)))


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """A knee, driven by its flexion."""
    side = one(rng, ["r", "l"])
    parameters = {f"{a}_mm_per_deg": float(v) for a, v in zip("xyz", size * direction(rng), strict=True)}
    return CoupledMotion(
        kind="coupled_motion", where=(f"knee_{side}",), parameters=parameters, driver=(f"knee_angle_{side}",)
    )


EFFECT = Effect("coupled_motion", "markers", "mm/deg", (0.022, 0.067, 0.2), draw)
