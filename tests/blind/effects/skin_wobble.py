"""The skin under a marker oscillates when the segment accelerates: a spring and damper in between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import Array, Body
from tests.blind.hidden import Effect, Hidden, Scene, one
from tests.blind.wobble import accelerations, lag


@dataclass(frozen=True, kw_only=True)
class SkinWobble(Hidden):
    """Isotropic, in an inertial frame; the constant sag under gravity is part of where the marker was put."""

    def on_skin(self, scene: Scene, markers: Array) -> Array:
        moved = markers.copy()
        for name in self.where:
            k = scene.marker(name)
            shaking = accelerations(scene.times, markers[:, k])
            moved[:, k] += lag(
                scene.times, shaking, self.parameters["frequency_hz"], self.parameters["damping"]
            )[0]
        return moved


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """A thigh or shank marker, or all of that segment; the size is the period, for softer skin moves more."""
    segment = one(rng, [f"{s}_{side}" for s in ("femur", "tibia") for side in ("r", "l")])
    markers = body.on(segment)
    where = tuple(sorted(markers)) if rng.random() < 0.3 else (one(rng, markers),)
    parameters = {"frequency_hz": 1.0 / size, "damping": float(rng.uniform(0.1, 0.3))}
    return SkinWobble(kind="skin_wobble", where=where, parameters=parameters)


EFFECT = Effect("skin_wobble", "markers", "s", (1 / 10, 1 / 7, 1 / 5), draw)
