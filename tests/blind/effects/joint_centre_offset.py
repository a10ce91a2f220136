"""A joint's centre lies elsewhere in the parent segment, all beyond it following."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.blind.body import Body, add
from tests.blind.hidden import Effect, Hidden, direction, one, xyz


@dataclass(frozen=True, kw_only=True)
class JointCentreOffset(Hidden):
    """``x_mm`` ... in the parent's frame: true minus modelled."""

    def body(self, body: Body) -> Body:
        segment = body.of_joint(self.where[0])
        shift = [1e-3 * self.parameters[f"{a}_mm"] for a in "xyz"]
        return body.with_segment(replace(segment, centre=add(segment.centre, shift)))


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """A hip or a knee, any direction."""
    where = one(rng, ["hip_r", "hip_l", "knee_r", "knee_l"])
    parameters = xyz(size * direction(rng), "mm")
    return JointCentreOffset(kind="joint_centre_offset", where=(where,), parameters=parameters)


EFFECT = Effect("joint_centre_offset", "markers", "mm", (2.0, 7.0, 20.0), draw)
