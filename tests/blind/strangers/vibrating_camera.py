"""A camera mount shakes: all markers tremble together along one direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import Array, Body
from tests.blind.hidden import Effect, Hidden, Scene, direction


@dataclass(frozen=True, kw_only=True)
class VibratingCamera(Hidden):
    """``amplitude_mm`` at ``frequency_hz``, for places 1 m high; a tilt, so it grows with the height."""

    toward: tuple[float, float, float]

    def seen(self, scene: Scene, markers: Array) -> Array:
        phase = 2 * np.pi * self.parameters["frequency_hz"] * scene.times
        shake = 1e-3 * self.parameters["amplitude_mm"] * np.sin(phase)[:, None] * markers[..., 1]
        return markers + shake[..., None] * np.array(self.toward)


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """Between 9 and 14 Hz."""
    parameters = {"amplitude_mm": size, "frequency_hz": float(rng.uniform(9.0, 14.0))}
    toward = direction(rng)
    return VibratingCamera(
        kind="vibrating_camera",
        where=("markers",),
        parameters=parameters,
        also_where=body.marker_names,
        toward=tuple(map(float, toward)),
    )


EFFECT = Effect("vibrating_camera", "markers", "mm", (2.0, 4.0, 8.0), draw)
