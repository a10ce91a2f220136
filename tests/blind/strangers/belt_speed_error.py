"""A treadmill's belt slows down under load, and its motor's pull appears in the plate as a force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import Body
from tests.blind.forces import PLATE_NAMES, Plates
from tests.blind.hidden import Effect, Hidden, one
from tests.blind.motions.motion import low_passed


@dataclass(frozen=True, kw_only=True)
class BeltSpeedError(Hidden):
    """``newton_s``: forward force per rate of loading (dFy/dt over the highest Fy), in the belt's plane."""

    def measured(self, plates: Plates) -> Plates:
        plate = PLATE_NAMES.index(self.where[0])
        if not plates.loaded[:, plate].any():
            return plates
        force = plates.force[:, plate].copy()
        loading = np.gradient(low_passed(force[:, 1], 10.0, 500.0), plates.times) / force[:, 1].max()
        pull = np.zeros_like(force)
        pull[:, 0] = np.where(force[:, 1] > 20.0, self.parameters["newton_s"] * loading, 0.0)
        centre = np.nan_to_num(plates.pressed()[:, plate])
        return plates.changed(plate, force + pull, plates.moment[:, plate] + np.cross(centre, pull))


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """One belt."""
    parameters = {"newton_s": size}
    return BeltSpeedError(
        kind="belt_speed_error",
        where=(one(rng, list(PLATE_NAMES)),),
        parameters=parameters,
        also_where=("fx",),
    )


EFFECT = Effect("belt_speed_error", "forces", "N s", (3.0, 6.0, 12.0), draw)
