"""A segment's centre of mass lies elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.blind.body import Body, add
from tests.blind.hidden import Effect, Hidden, direction, one, xyz


@dataclass(frozen=True, kw_only=True)
class SegmentCom(Hidden):
    """``x_mm`` ... in the segment's frame: true minus modelled; the inertia about it stays."""

    def body(self, body: Body) -> Body:
        segment = body.segment(self.where[0])
        shift = [1e-3 * self.parameters[f"{a}_mm"] for a in "xyz"]
        return body.with_segment(replace(segment, com=add(segment.com, shift)))


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """The trunk, or a thigh by twice as much."""
    where = one(rng, ["torso", "torso", "femur_r", "femur_l"])
    length = size if where == "torso" else 2 * size
    return SegmentCom(kind="segment_com", where=(where,), parameters=xyz(length * direction(rng), "mm"))


EFFECT = Effect("segment_com", "forces", "mm", (4.5, 13.0, 40.0), draw)
