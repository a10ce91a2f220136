"""A plate's amplifier saturates: its vertical force never goes above a limit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import Body
from tests.blind.forces import PLATE_NAMES, Plates
from tests.blind.hidden import Effect, Hidden, one


@dataclass(frozen=True, kw_only=True)
class PlateSaturation(Hidden):
    """``limit``: share of each trial's own highest force at which it stops; the other channels go on."""

    def measured(self, plates: Plates) -> Plates:
        plate = PLATE_NAMES.index(self.where[0])
        force = plates.force[:, plate].copy()
        force[:, 1] = np.minimum(force[:, 1], self.parameters["limit"] * force[:, 1].max())
        return plates.changed(plate, force, plates.moment[:, plate])


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """One plate; the size is the share that is lost."""
    parameters = {"limit": 1 - size}
    return PlateSaturation(
        kind="plate_saturation",
        where=(one(rng, list(PLATE_NAMES)),),
        parameters=parameters,
        also_where=("fy",),
    )


EFFECT = Effect("plate_saturation", "forces", "-", (0.05, 0.1, 0.2), draw)
