"""Forces arrive late or early against the markers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import Body
from tests.blind.forces import Plates
from tests.blind.hidden import Effect, Hidden, sign


@dataclass(frozen=True, kw_only=True)
class ForceDelay(Hidden):
    """``delay_s`` > 0: the file says now what was true ``delay_s`` ago."""

    def measured(self, plates: Plates) -> Plates:
        return plates.resampled(plates.times - self.parameters["delay_s"])


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """Both plates alike."""
    return ForceDelay(kind="force_delay", where=("forces",), parameters={"delay_s": sign(rng) * size})


EFFECT = Effect("force_delay", "forces", "s", (0.002, 0.007, 0.020), draw)
