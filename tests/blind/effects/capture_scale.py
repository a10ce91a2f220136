"""The whole volume is scaled, as by a wrong wand length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import Array, Body
from tests.blind.hidden import Effect, Hidden, Scene, sign


@dataclass(frozen=True, kw_only=True)
class CaptureScale(Hidden):
    """``factor``: measured over true, about the laboratory's origin."""

    def seen(self, scene: Scene, markers: Array) -> Array:
        return markers * self.parameters["factor"]


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """All markers."""
    return CaptureScale(kind="capture_scale", where=("markers",), parameters={"factor": 1 + sign(rng) * size})


EFFECT = Effect("capture_scale", "markers", "-", (0.002, 0.007, 0.02), draw)
