"""A joint moves in a way that the model locks, in a pattern of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.blind.body import Body, Move, Vector, slide, turn
from tests.blind.hidden import Effect, Hidden, one
from tests.blind.motions.motion import Motion, wander

_AXES: dict[str, Vector] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
HIDDEN_COORDINATE = "hidden_motion"


@dataclass(frozen=True, kw_only=True)
class MissingDof(Hidden):
    """``rms_deg`` about, or ``rms_mm`` along, ``axis``; turns after, slides before the joint's own turn."""

    axis: str

    @property
    def _move(self) -> Move:
        make = turn if "rms_deg" in self.parameters else slide
        return make(_AXES[self.axis], HIDDEN_COORDINATE)

    def body(self, body: Body) -> Body:
        segment = body.of_joint(self.where[0])
        moves = (*segment.moves, self._move) if self._move.kind == "turn" else (self._move, *segment.moves)
        return body.with_segment(replace(segment, moves=moves))

    def motion(self, motion: Motion, rng: np.random.Generator) -> Motion:
        if "rms_deg" in self.parameters:
            rms = float(np.deg2rad(self.parameters["rms_deg"]))
        else:
            rms = 1e-3 * self.parameters["rms_mm"]
        return motion.with_coordinate(HIDDEN_COORDINATE, wander(rng, motion.times, rms, 0.3, 1.5))

    def label(self) -> dict[str, object]:
        return {**super().label(), "axis": self.axis}


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """A knee turns inward or to varus (deg), or glides forward or sideways (mm: twice the number)."""
    kind, axis = [("deg", "x"), ("deg", "y"), ("mm", "x"), ("mm", "z")][rng.integers(4)]
    parameters = {"rms_deg": size} if kind == "deg" else {"rms_mm": 2 * size}
    where = (one(rng, ["knee_r", "knee_l"]),)
    return MissingDof(kind="missing_dof", where=where, parameters=parameters, axis=axis)


EFFECT = Effect("missing_dof", "markers", "deg", (0.9, 2.7, 8.0), draw)
