"""A marker sits elsewhere on its segment than the model says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import Body
from tests.blind.hidden import Effect, Hidden, direction, one, xyz


@dataclass(frozen=True, kw_only=True)
class MarkerOffset(Hidden):
    """``x_mm`` ... in the segment's frame: true minus modelled."""

    def body(self, body: Body) -> Body:
        x, y, z = (1e-3 * self.parameters[f"{a}_mm"] for a in "xyz")
        return body.with_markers_moved({self.where[0]: (x, y, z)})


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """Any marker, any direction."""
    parameters = xyz(size * direction(rng), "mm")
    return MarkerOffset(kind="marker_offset", where=(one(rng, body.marker_names),), parameters=parameters)


EFFECT = Effect("marker_offset", "markers", "mm", (2.0, 7.0, 20.0), draw)
