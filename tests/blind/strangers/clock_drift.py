"""The plates' clock runs faster than the cameras': in step at first, late in the end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import Body
from tests.blind.forces import Plates
from tests.blind.hidden import Effect, Hidden, sign

COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")
"""Of the ground wrench."""


@dataclass(frozen=True, kw_only=True)
class ClockDrift(Hidden):
    """``ms_per_s``: how much later the forces are with each second."""

    def measured(self, plates: Plates) -> Plates:
        return plates.resampled(plates.times * (1 - 1e-3 * self.parameters["ms_per_s"]))


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """Both plates."""
    return ClockDrift(
        kind="clock_drift",
        where=("forces",),
        parameters={"ms_per_s": sign(rng) * size},
        also_where=COMPONENTS,
    )


EFFECT = Effect("clock_drift", "forces", "ms/s", (2.0, 4.0, 8.0), draw)
