"""The volume is bent: places far from its middle are pushed out with the cube of the distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import Array, Body
from tests.blind.hidden import Effect, Hidden, Scene, sign

MIDDLE = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True, kw_only=True)
class LensDistortion(Hidden):
    """``mm_at_1_m``: how far a point 1 m from the middle of the volume (0, 1, 0) is pushed."""

    def seen(self, scene: Scene, markers: Array) -> Array:
        away = markers - MIDDLE
        return markers + 1e-3 * self.parameters["mm_at_1_m"] * away * (away**2).sum(axis=-1, keepdims=True)


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """All markers."""
    parameters = {"mm_at_1_m": sign(rng) * size}
    return LensDistortion(
        kind="lens_distortion", where=("markers",), parameters=parameters, also_where=body.marker_names
    )


EFFECT = Effect("lens_distortion", "markers", "mm", (8.0, 15.0, 30.0), draw)
