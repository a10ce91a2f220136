"""A plate adds a constant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import Body
from tests.blind.forces import PLATE_NAMES, Plates
from tests.blind.hidden import Effect, Hidden, direction, one


@dataclass(frozen=True, kw_only=True)
class PlateBias(Hidden):
    """``fx_N`` ... added to the readings at the trial's mean centre of pressure.

    A trial in which nobody steps on the plate keeps its zeros.
    """

    def measured(self, plates: Plates) -> Plates:
        plate = PLATE_NAMES.index(self.where[0])
        if not plates.loaded[:, plate].any():
            return plates
        bias = np.array([self.parameters[f"f{a}_N"] for a in "xyz"])
        force = plates.force[:, plate] + bias
        return plates.changed(plate, force, plates.moment[:, plate] + np.cross(plates.centre(plate), bias))


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """One plate, any direction."""
    bias = size * direction(rng)
    parameters = {f"f{a}_N": float(v) for a, v in zip("xyz", bias, strict=True)}
    return PlateBias(kind="plate_bias", where=(one(rng, list(PLATE_NAMES)),), parameters=parameters)


EFFECT = Effect("plate_bias", "forces", "N", (3.5, 10.0, 32.0), draw)
