"""A plate reads too much or too little of everything."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import Body
from tests.blind.forces import PLATE_NAMES, Plates
from tests.blind.hidden import Effect, Hidden, one, sign


@dataclass(frozen=True, kw_only=True)
class PlateGain(Hidden):
    """``factor``: measured over true; the centre of pressure stays."""

    def measured(self, plates: Plates) -> Plates:
        plate, factor = PLATE_NAMES.index(self.where[0]), self.parameters["factor"]
        return plates.changed(plate, factor * plates.force[:, plate], factor * plates.moment[:, plate])


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """One plate."""
    parameters = {"factor": 1 + sign(rng) * size}
    return PlateGain(kind="plate_gain", where=(one(rng, list(PLATE_NAMES)),), parameters=parameters)


EFFECT = Effect("plate_gain", "forces", "-", (0.009, 0.027, 0.08), draw)
