"""The shoe slips on the foot: its markers jump back in each swing and creep forward while the foot bears."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import Array, Body
from tests.blind.hidden import Effect, Hidden, Scene, one
from tests.blind.motions.motion import low_passed


@dataclass(frozen=True, kw_only=True)
class SlippingSole(Hidden):
    """``creep_mm`` forward in the foot's frame over each time on the floor (sole below 15 mm)."""

    def on_skin(self, scene: Scene, markers: Array) -> Array:
        segment = self.also_where[0]
        sole = scene.poses.point(segment, np.array([0.0, -0.0687, 0.0]))[:, 1]
        down = sole < np.quantile(sole, 0.05) + 0.015
        slipped = _since(down) * scene.motion.times[1]
        shift = np.zeros((len(sole), 3))
        shift[:, 0] = low_passed(1e-3 * self.parameters["creep_mm"] * np.minimum(slipped / 0.6, 1.0), 12.0)
        moved = markers.copy()
        for name in self.where:
            moved[:, scene.marker(name)] += scene.poses.turned(segment, shift)
        return moved


def _since(down: Array) -> Array:
    """Frames since the foot came down, 0 in the air."""
    count = np.arange(1, len(down) + 1)
    last_up = np.maximum.accumulate(np.where(down, 0, count))
    since: Array = (count - last_up).astype(float)
    return since


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """One foot."""
    foot = one(rng, ["calcn_r", "calcn_l"])
    also = (foot, f"ankle_{foot[-1]}")
    return SlippingSole(
        kind="slipping_sole", where=body.on(foot), parameters={"creep_mm": size}, also_where=also
    )


EFFECT = Effect("slipping_sole", "forces", "mm", (8.0, 15.0, 30.0), draw)
