"""A plate is elsewhere than the file says, so that its centre of pressure is shifted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import Body
from tests.blind.forces import PLATE_NAMES, Plates
from tests.blind.hidden import Effect, Hidden, one


@dataclass(frozen=True, kw_only=True)
class PlatePosition(Hidden):
    """``x_mm`` ...: where the plate truly is minus where the file has it; readings are off the other way."""

    def measured(self, plates: Plates) -> Plates:
        shift = 1e-3 * np.array([self.parameters[f"{a}_mm"] for a in "xyz"])
        return plates.moved(PLATE_NAMES.index(self.where[0]), -shift)


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """One plate, in the floor."""
    angle = rng.uniform(0, 2 * np.pi)
    parameters = {"x_mm": float(size * np.cos(angle)), "y_mm": 0.0, "z_mm": float(size * np.sin(angle))}
    return PlatePosition(kind="plate_position", where=(one(rng, list(PLATE_NAMES)),), parameters=parameters)


EFFECT = Effect("plate_position", "forces", "mm", (2.0, 7.0, 20.0), draw)
