"""Who is recorded: size, mass and proportions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import Vector

REFERENCE_HEIGHT_M = 1.762
"""Mean stature of Puchaud et al. 2019, whom the lengths below depict."""


@dataclass(frozen=True)
class Person:
    """A person; ``sizes`` are factors on the reference lengths of pelvis, thigh, shank, foot and trunk."""

    height_m: float
    mass_kg: float
    sizes: dict[str, float]

    def scaled(self, part: str, at: Vector) -> Vector:
        """A place of the reference person in this one."""
        x, y, z = (v * self.sizes[part] for v in at)
        return (x, y, z)


def person(rng: np.random.Generator) -> Person:
    """Draw a person.

    Notes
    -----
    Stature 1.69 (0.09) m: between the sexes of ANSUR II. Body mass index 23 (2.5) kg/m^2 (chosen: healthy
    adults). Proportions vary by 3 % (Puchaud et al. 2019: lengths by 5.5 %, of which stature explains most).
    """
    height = float(np.clip(rng.normal(1.69, 0.09), 1.5, 1.95))
    index = float(np.clip(rng.normal(23.0, 2.5), 18.5, 29.0))
    general = height / REFERENCE_HEIGHT_M
    parts = ("pelvis", "thigh", "shank", "foot", "trunk")
    return Person(height, index * height**2, {p: general * float(rng.normal(1.0, 0.03)) for p in parts})
