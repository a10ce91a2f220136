"""A plate is turned about the vertical through its centre, and the file does not know."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from tests.blind.body import Body
from tests.blind.forces import PLATE_NAMES, Plates
from tests.blind.hidden import Effect, Hidden, one, sign


@dataclass(frozen=True, kw_only=True)
class PlateRotation(Hidden):
    """``about_vertical_deg``: how the plate lies minus how the file has it; readings turn the other way.

    A MOT file knows no plate, so the centre is the mean centre of pressure of each trial.
    """

    def measured(self, plates: Plates) -> Plates:
        plate = PLATE_NAMES.index(self.where[0])
        if not plates.loaded[:, plate].any():
            return plates
        back = Rotation.from_euler("y", -self.parameters["about_vertical_deg"], degrees=True)
        return plates.turned(plate, back, plates.centre(plate))


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """One plate."""
    parameters = {"about_vertical_deg": sign(rng) * size}
    return PlateRotation(kind="plate_rotation", where=(one(rng, list(PLATE_NAMES)),), parameters=parameters)


EFFECT = Effect("plate_rotation", "forces", "deg", (1.3, 4.0, 12.0), draw)
