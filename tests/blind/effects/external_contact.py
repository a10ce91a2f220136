"""Something that no plate measures touches a segment for a while."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import Array, Body
from tests.blind.hidden import Effect, Hidden, Scene, direction, one
from tests.blind.motions.plans import rise


@dataclass(frozen=True, kw_only=True)
class ExternalContact(Hidden):
    """A force of constant direction at a point of the segment, rising and falling between start and end.

    ``rms_N`` is the root mean square over the interval; it acts at the same time of every
    trial that it affects.
    """

    toward: tuple[float, float, float]
    at: tuple[float, float, float]

    def force(self, times: Array) -> Array:
        """In ground, (n, 3), N."""
        start, end = self.parameters["start_s"], self.parameters["end_s"]
        ramp = 0.3 * (end - start)
        fine = np.linspace(start, end, 2001)

        def shape(t: Array) -> Array:
            return rise((t - start) / ramp) * rise((end - t) / ramp)

        peak = self.parameters["rms_N"] / np.sqrt(np.mean(shape(fine) ** 2))
        force: Array = peak * shape(times)[:, None] * np.array(self.toward)
        return force

    def borne_elsewhere(self, scene: Scene) -> Array:
        force = self.force(scene.times)
        point = scene.poses.point(self.where[0], np.array(self.at))
        return np.hstack([force, np.cross(point, force)])

    def label(self) -> dict[str, object]:
        return {**super().label(), "toward": list(self.toward), "at_m": list(self.at)}


ASIDE = 0.15
"""Share of a touch that is not upright. Who is pushed aside leans, so that pressure stays under the feet.
Here the motion goes on as it is: 65 N aside at the pelvis put it 100 mm beside a foot, which nobody does."""


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """What bears some of the trunk, the pelvis or a thigh; in all trials or in the first only."""
    where = one(rng, ["torso", "torso", "pelvis", "femur_r", "femur_l"])
    at = {"torso": (0.05, 0.30, 0.0), "pelvis": (-0.08, -0.02, 0.0)}.get(where, (-0.05, -0.20, 0.0))
    toward = np.array([0.0, 1.0, 0.0]) + ASIDE * direction(rng)
    toward /= np.linalg.norm(toward)
    start = float(np.round(rng.uniform(0.8, 1.5), 2))
    parameters = {"start_s": start, "end_s": start + float(np.round(rng.uniform(1.5, 2.5), 2)), "rms_N": size}
    return ExternalContact(
        kind="external_contact",
        where=(where,),
        parameters=parameters,
        toward=tuple(map(float, toward)),
        trials=None if rng.random() < 0.5 else (0,),
        at=at,
    )


EFFECT = Effect("external_contact", "forces", "N", (9.0, 27.0, 80.0), draw)
