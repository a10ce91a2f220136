"""A segment is longer or shorter than the model's, its markers and its next joint following."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.blind.body import Body, times
from tests.blind.hidden import Effect, Hidden, one, sign


@dataclass(frozen=True, kw_only=True)
class SegmentLength(Hidden):
    """``factor``: true over modelled; all places in the segment's frame times it, masses as they were."""

    def body(self, body: Body) -> Body:
        factor, name = self.parameters["factor"], self.where[0]
        markers = tuple(replace(m, at=times(m.at, factor)) if m.segment == name else m for m in body.markers)
        segments = []
        for s in body.segments:
            if s.parent == name:
                s = replace(s, centre=times(s.centre, factor))
            if s.name == name:
                s = replace(s, com=times(s.com, factor))
            segments.append(s)
        return replace(body, markers=markers, segments=tuple(segments))


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """Thigh, shank or pelvis."""
    where = one(rng, ["pelvis", "femur_r", "femur_l", "tibia_r", "tibia_l"])
    parameters = {"factor": 1.0 + sign(rng) * size}
    return SegmentLength(kind="segment_length", where=(where,), parameters=parameters)


EFFECT = Effect("segment_length", "markers", "-", (0.007, 0.02, 0.06), draw)
