"""The laboratory's vertical is not vertical."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from tests.blind.body import Body
from tests.blind.hidden import Effect, Hidden


@dataclass(frozen=True, kw_only=True)
class GravityTilt(Hidden):
    """``x_deg``, ``z_deg``: the true vertical is the file's Y turned by the vector (x, 0, z)."""

    def body(self, body: Body) -> Body:
        turn = np.deg2rad([self.parameters["x_deg"], 0.0, self.parameters["z_deg"]])
        x, y, z = Rotation.from_rotvec(turn).apply(body.gravity)
        return replace(body, gravity=(float(x), float(y), float(z)))


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """In any direction."""
    angle = rng.uniform(0, 2 * np.pi)
    parameters = {"x_deg": float(size * np.cos(angle)), "z_deg": float(size * np.sin(angle))}
    return GravityTilt(kind="gravity_tilt", where=("world",), parameters=parameters)


EFFECT = Effect("gravity_tilt", "forces", "deg", (0.2, 0.7, 2.0), draw)
