"""A measured volume that is bent: a lens whose distortion is not corrected."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scaling_service.discovery.candidates import Candidate, Column, Part
from scaling_service.discovery.findings import Foreign
from scaling_service.discovery.fitting import Account
from scaling_service.discovery.options import compared
from scaling_service.discovery.scene import Scene
from scaling_service.discovery.spots import BentSpot, Spot, VolumeSpot


def found(now: Account, _scene: Scene, stretch_s: float) -> Iterator[Foreign]:
    """All markers pushed away from a middle, or towards it, with the cube of their distance."""
    seen = np.concatenate([item.task.measured.reshape(-1, 3) for item in now.watched])
    x, y, z = np.nanmean(seen, axis=0).tolist()
    spots: list[Spot] = [VolumeSpot(), *(BentSpot((x, y, z), toward) for toward in (None, 0, 1, 2))]
    columns = tuple(Column(str(spot), 1.0, (Part(spot),)) for spot in spots)
    for option in compared(now, [Candidate("bent_volume", ("markers",), columns)], stretch_s, 1):
        cube = 1e3 * float(option.fitted.size[1])
        law = (
            f"the measured volume is bent: {cube:+.3g} mm at 1 m from its middle, as the cube of the distance"
        )
        yield Foreign(("markers",), law, option.fitted.expected, option.fitted.p, option.unseen.p)
