"""The skin under one marker, or all markers of a segment, moves with a joint angle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import Array, Body
from tests.blind.hidden import Effect, Hidden, Scene, direction, one


@dataclass(frozen=True, kw_only=True)
class SoftTissueArtefact(Hidden):
    """``x_mm_per_deg`` ... in the segment's frame, times the driver in degrees from zero (Camomilla 2013)."""

    def on_skin(self, scene: Scene, markers: Array) -> Array:
        gain = np.array([self.parameters[f"{a}_mm_per_deg"] for a in "xyz"])
        degrees = np.rad2deg(scene.motion.column(self.driver[0]))
        moved = markers.copy()
        for name in self.where:
            shift = 1e-3 * degrees[:, None] * gain
            moved[:, scene.marker(name)] += scene.poses.turned(scene.body.marker(name).segment, shift)
        return moved


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """Thigh markers with hip flexion, shank markers with the knee; one marker or all of the segment."""
    side = one(rng, ["r", "l"])
    segment = one(rng, [f"femur_{side}", f"tibia_{side}"])
    driver = f"{'hip_flexion' if segment.startswith('femur') else 'knee_angle'}_{side}"
    markers = body.on(segment)
    where = tuple(sorted(markers)) if rng.random() < 0.3 else (one(rng, markers),)
    parameters = {f"{a}_mm_per_deg": float(v) for a, v in zip("xyz", size * direction(rng), strict=True)}
    return SoftTissueArtefact(
        kind="soft_tissue_artefact", where=where, parameters=parameters, driver=(driver,)
    )


EFFECT = Effect("soft_tissue_artefact", "markers", "mm/deg", (0.045, 0.13, 0.4), draw)
