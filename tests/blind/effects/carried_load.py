"""A rigid load is carried at a point of a segment."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.blind.body import Array, Body
from tests.blind.hidden import Effect, Hidden, one, xyz


@dataclass(frozen=True, kw_only=True)
class CarriedLoad(Hidden):
    """``kg`` at ``x_mm`` ... in the segment's frame, without inertia of its own."""

    def body(self, body: Body) -> Body:
        segment = body.segment(self.where[0])
        kg, at = self.parameters["kg"], 1e-3 * np.array([self.parameters[f"{a}_mm"] for a in "xyz"])
        mass = segment.mass + kg
        com = (segment.mass * np.array(segment.com) + kg * at) / mass
        inertia = np.array(segment.inertia) + segment.mass * _about(com - segment.com) + kg * _about(com - at)
        rows = tuple(tuple(float(v) for v in row) for row in inertia)
        return body.with_segment(replace(segment, mass=mass, com=tuple(map(float, com)), inertia=rows))


def _about(d: Array) -> Array:
    """Inertia of a unit mass at d."""
    inertia: Array = np.dot(d, d) * np.eye(3) - np.outer(d, d)
    return inertia


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """On the trunk, 0.15 to 0.3 m from its axis on any side; or a third of the mass at a shank."""
    if rng.random() < 0.75:
        angle, distance = rng.uniform(0, 2 * np.pi), rng.uniform(150, 300)
        at = [distance * np.cos(angle), rng.uniform(150, 400), distance * np.sin(angle)]
        parameters = {"kg": size, **xyz(np.array(at), "mm")}
        return CarriedLoad(kind="carried_load", where=("torso",), parameters=parameters)
    at = [rng.uniform(40, 70), rng.uniform(-350, -250), rng.uniform(-30, 30)]
    parameters = {"kg": size / 3, **xyz(np.array(at), "mm")}
    return CarriedLoad(kind="carried_load", where=(one(rng, ["tibia_r", "tibia_l"]),), parameters=parameters)


EFFECT = Effect("carried_load", "forces", "kg", (0.9, 2.7, 8.0), draw)
