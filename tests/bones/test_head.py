"""Which pairs of balls are condyles."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.bones.femur import _are_twins
from scaling_service.bones.fits import SphereOnBone
from scaling_service.bones.surface import prepare
from tests.bones import bones


@pytest.mark.parametrize(
    ("first", "second", "condyles"),
    [((0.0, 0.022), (0.0, -0.024), True), ((0.015, 0.040), (0.0, -0.004), False)],
    ids=["condyles", "head and round trochanter"],
)
def test_condyles_stand_on_both_sides_of_the_shaft(
    first: tuple[float, float], second: tuple[float, float], condyles: bool
) -> None:
    shaft = prepare(
        *bones.metres(
            bones.meshed([bones.rod([-200, 0, 0], [200, 0, 0], 14)], [-220, -20, -20], [220, 20, 20])
        )
    )
    balls = [
        SphereOnBone(
            centre=np.array([0.2 + along, aside, 0.0]),
            radius=0.021,
            rms=1e-4,
            covered=0.5,
            support=np.zeros(0),
        )
        for along, aside in (first, second)
    ]
    assert _are_twins(shaft, *balls) is condyles
