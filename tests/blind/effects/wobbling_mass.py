"""Part of a segment's own mass hangs on a spring and lags behind the bone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import GRAVITY, Array, Body
from tests.blind.hidden import Effect, Hidden, Scene
from tests.blind.wobble import accelerations, lag

DAMPING = 0.2
"""Of the critical (chosen; Liu and Nigg 2000 use 0.2 to 0.4 for soft tissue)."""


@dataclass(frozen=True, kw_only=True)
class WobblingMass(Hidden):
    """``kg`` of the segment's mass at its centre of mass, on an isotropic spring of ``frequency_hz``."""

    def shaken(self, scene: Scene) -> Array:
        segment = scene.body.segment(self.where[0])
        kg = self.parameters["kg"]
        place = scene.poses.point(segment.name, np.array(segment.com))
        shaking = accelerations(scene.times, place)
        s, s_acceleration = lag(scene.times, shaking, self.parameters["frequency_hz"], DAMPING)
        rigid = kg * (shaking - np.array(GRAVITY))
        soft = rigid + kg * s_acceleration
        return np.hstack([soft - rigid, np.cross(place + s, soft) - np.cross(place, rigid)])


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """The trunk's soft parts (Gruber et al. 1998; Liu and Nigg 2000: a few hertz)."""
    parameters = {"kg": size, "frequency_hz": float(rng.uniform(3.0, 4.5))}
    return WobblingMass(kind="wobbling_mass", where=("torso",), parameters=parameters)


EFFECT = Effect("wobbling_mass", "forces", "kg", (4.0, 8.0, 16.0), draw)
