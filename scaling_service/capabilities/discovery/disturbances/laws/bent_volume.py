"""A measured volume that is bent: a lens whose distortion is not corrected."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.evidence.spots import BentSpot, Spot, VolumeSpot
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column, Part
from scaling_service.capabilities.discovery.search.option import Option


def candidates(now: Account, _scene: Scene) -> Iterator[Candidate]:
    """All markers pushed away from a middle, or towards it, with the cube of their distance."""
    seen = np.concatenate([item.task.measured.reshape(-1, 3) for item in now.watched])
    x, y, z = np.nanmean(seen, axis=0).tolist()
    spots: list[Spot] = [VolumeSpot(), *(BentSpot((x, y, z), toward) for toward in (None, 0, 1, 2))]
    columns = tuple(Column(str(spot), 1.0, (Part(spot),)) for spot in spots)
    yield Candidate("bent_volume", ("markers",), columns)


def told(option: Option) -> tuple[tuple[str, ...], str]:
    """Where, and in words."""
    way = "away from" if option.fitted.size[1] > 0.0 else "towards"
    law = f"the measured volume is bent: markers are pushed {way} its middle by the cube of the distance"
    return option.candidate.where, law
