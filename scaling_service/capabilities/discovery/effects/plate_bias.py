"""A plate with something constant added."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.laws.loads import PlateBias
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column

KIND = "plate_bias"
MEANING = "something constant is added to what the plate measures"
_NAMES = ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")
_MOST = (300.0,) * 3 + (30.0,) * 3  # chosen: about the mean centre of pressure, 300 N some 0.1 m beside it


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Every plate, of its forces alone and of its moments too, in all recordings and in each."""
    for plate in scene.plates:
        columns = tuple(
            Column(name, 1.0, load=PlateBias(plate, k), low=-most, high=most)
            for k, (name, most) in enumerate(zip(_NAMES, _MOST, strict=True))
        )
        for trials in scene.scopes_of_forces:
            yield Candidate(KIND, (plate,), columns[:3], trials=trials)
            yield Candidate(KIND, (plate,), columns, trials=trials, note="with moments")
