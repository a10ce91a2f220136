"""How skin slides over the bones of a knee as it flexes: the mean of people's, by where a marker sits.

Laboratories that saw bones and skin at once (``reference_models/skin_over_knee.yaml``) agree on a part of it:
beside the epicondyles skin stays behind, in front it follows the patella. The mean is a Gaussian process over
the place (kriging; Rasmussen and Williams 2006, Gaussian Processes for Machine Learning, eqs. 2.23 and 2.24).
By how much one person departs from it is what ``people.yaml`` says of skin, so far from any marker that was
ever measured nothing is expected.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scaling_service.model import body, reference
from scaling_service.model.anatomy.knees import list_knees
from scaling_service.model.anatomy.lengths import find_centre
from scaling_service.model.people import read_people
from scaling_service.numerics.multibody.laws import Array

Part = Literal["thigh", "shank"]

MEAN_PER_RAD, LENGTH_M = 0.015, 0.15
"""Standard deviation of the mean's slope along an axis, m per rad, and the distance over which it is alike.
Chosen by leaving out each laboratory in turn, by how far the bones were off; the evidence of the slopes alone
is largest at 0.015 to 0.02 and, by how far markers go their own ways, at 0.12 to 0.3 m."""

_BONES = {"thigh": "femur", "shank": "tibia"}

_PIN = "pin"  # part of a label, between underscores


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredSkin:
    """Markers on one part of a leg of which it was seen how they slide, by movement."""

    laboratories: NDArray[np.str_]  # (n,)
    persons: NDArray[np.str_]
    movements: NDArray[np.intp]
    places: Array  # (n, 3), m: forward, up and outward from the knee's centre
    slopes: Array  # (n, 3), m per rad of flexion
    noise: Array  # (n,), m per rad: of what one movement tells of a slope, alike in markers that are near

    def without(self, laboratory: str) -> MeasuredSkin:
        """What the other laboratories saw."""
        kept = self.laboratories != laboratory
        return MeasuredSkin(
            laboratories=self.laboratories[kept],
            persons=self.persons[kept],
            movements=self.movements[kept],
            places=self.places[kept],
            slopes=self.slopes[kept],
            noise=self.noise[kept],
        )


@lru_cache(maxsize=2)
def read_measured_skin(part: Part) -> MeasuredSkin:
    """What is known of a thigh or a shank.

    Examples
    --------
    >>> sorted(set(read_measured_skin("thigh").laboratories.tolist()))
    ['Bologna', 'Ottawa', 'Taipei']
    """
    movements = reference.read_reference(reference.find_reference_folder() / "skin_over_knee.yaml")[
        "movements"
    ]
    rows = [
        (movement["laboratory"], movement["person"], number, marker)
        for number, movement in enumerate(movements)
        for marker in movement[part]
    ]
    numbers = 1e-3 * np.array([marker for *_, marker in rows])
    return MeasuredSkin(
        laboratories=np.array([row[0] for row in rows]),
        persons=np.array([row[1] for row in rows]),
        movements=np.array([row[2] for row in rows]),
        places=numbers[:, :3],
        slopes=numbers[:, 3:6],
        noise=numbers[:, 6],
    )


def expect_slopes(part: Part, places: Array, measured: MeasuredSkin | None = None) -> Array:
    """How far skin slides over the bone per flexion of the knee, (m, 3), m per rad: forward, up, outward.

    ``places`` (m, 3), m: forward, up and outward from the knee's centre in the bone's axes.
    ``measured``: other than all laboratories'.

    Examples
    --------
    >>> beside, far = expect_slopes("thigh", np.array([[0.0, 0.0, 0.06], [0.0, 2.0, 0.06]]))
    >>> bool(beside[0] < -0.005), bool(np.abs(far).max() < 1e-6)
    (True, True)
    """
    known = measured or read_measured_skin(part)
    people = read_people()
    size = people.skin(_BONES[part]).times(1.0 / people.reach_mediolateral)
    alike = _compare(known.places, known.places)
    one_person = known.persons[:, None] == known.persons
    one_movement = known.movements[:, None] == known.movements
    spread = MEAN_PER_RAD**2 + size.shift**2 * one_person + np.outer(known.noise, known.noise) * one_movement
    covariance = alike * spread + size.single**2 * np.eye(len(alike))
    follows = MEAN_PER_RAD**2 * _compare(places, known.places)
    return np.asarray(follows @ np.linalg.solve(covariance, known.slopes))


def _compare(a: Array, b: Array) -> Array:
    squares = np.square(a[:, None] - b).sum(axis=2)
    return np.asarray(np.exp(-squares / (2.0 * LENGTH_M**2)))


def slide_skin(model: body.BodyModel) -> dict[str, tuple[body.Law, body.Law, body.Law]]:
    """How markers on the bones of a model's knees slide with flexion: what to add to their laws, by name.

    Pins do not slide, nor does what slides already. Of a leg whose side is not known, the mean of both sides
    is taken.
    """
    found = {}
    for knee in list_knees(model):
        centres = find_centre(model, [model.segment(knee.shank)])
        parts: dict[Part, str] = {"thigh": knee.thigh, "shank": knee.shank}
        for part, segment in parts.items():
            own = [m for m in model.markers if m.segment == segment]
            if any(not law.is_constant for m in own for law in m.laws):
                continue
            markers = [m for m in own if not is_pin(m.name)]
            places = np.array([m.nominal for m in markers]).reshape(-1, 3) - centres[segment]
            mirrors = [np.array([1.0, 1.0, side]) for side in ((knee.side,) if knee.side else (1, -1))]
            slopes = np.mean([mirror * expect_slopes(part, mirror * places) for mirror in mirrors], axis=0)
            for marker, slope in zip(markers, (-knee.extends * slopes).tolist(), strict=True):
                x, y, z = (body.Law((body.Term(gain, coordinate=knee.flexion),)) for gain in slope)
                found[marker.name] = (x, y, z)
    return found


def is_pin(marker: str) -> bool:
    """Whether a label says that its marker is fixed to the bone.

    Examples
    --------
    >>> is_pin("tibia_LM_pin"), is_pin("SPINE")
    (True, False)
    """
    return _PIN in marker.lower().split("_")
