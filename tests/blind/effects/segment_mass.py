"""A segment is heavier or lighter than the model's."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.blind.body import Body, times
from tests.blind.hidden import Effect, Hidden, one, sign


@dataclass(frozen=True, kw_only=True)
class SegmentMass(Hidden):
    """``kg``: true minus modelled; the centre of mass stays, the inertia follows in proportion."""

    @property
    def own_kg(self) -> float:
        return self.parameters["kg"]

    def body(self, body: Body) -> Body:
        segment = body.segment(self.where[0])
        ratio = 1 + self.parameters["kg"] / segment.mass
        xx, yy, zz = (times(row, ratio) for row in segment.inertia)
        return body.with_segment(replace(segment, mass=segment.mass * ratio, inertia=(xx, yy, zz)))


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """Trunk or a thigh or a shank; never lighter by more than half."""
    where = one(rng, ["torso", "femur_r", "femur_l", "tibia_r", "tibia_l"])
    change = max(sign(rng) * size, -0.5 * body.segment(where).mass)
    return SegmentMass(kind="segment_mass", where=(where,), parameters={"kg": change})


EFFECT = Effect("segment_mass", "forces", "kg", (0.7, 2.0, 6.0), draw)
