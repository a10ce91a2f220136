"""A marker falls off half way through the trial and is stuck on again beside its place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import Array, Body
from tests.blind.hidden import Effect, Hidden, Scene, direction, one, xyz


@dataclass(frozen=True, kw_only=True)
class MarkerRestuck(Hidden):
    """Right until ``from_s``, then off by ``x_mm`` ... in the segment's frame."""

    def on_skin(self, scene: Scene, markers: Array) -> Array:
        name = self.where[0]
        shift = 1e-3 * np.array([self.parameters[f"{a}_mm"] for a in "xyz"])
        after = (scene.times >= self.parameters["from_s"])[:, None]
        moved = markers.copy()
        moved[:, scene.marker(name)] += scene.poses.turned(scene.body.marker(name).segment, after * shift)
        return moved


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """Any marker."""
    parameters = {"from_s": float(np.round(rng.uniform(2.0, 3.0), 2)), **xyz(size * direction(rng), "mm")}
    return MarkerRestuck(kind="marker_restuck", where=(one(rng, body.marker_names),), parameters=parameters)


EFFECT = Effect("marker_restuck", "markers", "mm", (8.0, 15.0, 30.0), draw)
