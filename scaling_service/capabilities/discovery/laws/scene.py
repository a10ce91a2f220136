"""What an effect must know to say where it could sit."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np

from scaling_service.capabilities.discovery.laws.spots import find_turning_joints
from scaling_service.core.arrays import Array
from scaling_service.model.body import GROUND, BodyModel, Segment
from scaling_service.model.poses import follow

_SOFT = 0.2
"""Of the way from a joint to the segment's farthest marker: nearer, a marker sits on bone (chosen:
epicondyles and malleoli lie at 0.10 to 0.18, clusters at 0.22 and more)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Scene:
    """The body and what the recordings show of it."""

    model: BodyModel  # without parameters
    markers: tuple[str, ...]  # those that a recording shows
    moving: tuple[str, ...]  # coordinates that move enough to drive something
    trials: tuple[str, ...]
    plates: tuple[str, ...] = ()  # those that a recording loads; none where there are no forces
    wrenches: tuple[str, ...] = ()  # trials with forces
    loaded: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # by plate: trials that tell of it

    def on(self, segment: str) -> tuple[str, ...]:
        """The markers shown on a segment."""
        return tuple(m for m in self.markers if self.model.marker(m).segment == segment)

    def groups_on(self, segment: str) -> tuple[tuple[str, ...], ...]:
        """What may move together there: each marker, those on its soft middle, and all of them."""
        markers = self.on(segment)
        # Where joints lie in their parent's frame, as far as that does not move
        children = [
            follow([j for j in child.joints if j.kind == "translation" and j.law.is_constant], {})[1]
            for child in self.model.children(segment)
        ]
        ends = np.array([(0.0, 0.0, 0.0), *children])
        far = max((d for m in markers for d in self._from(m, ends)), default=0.0)
        soft = tuple(m for m in markers if min(self._from(m, ends)) > _SOFT * far) if len(ends) > 1 else ()
        together = [group for group in (soft, markers) if len(group) > 1]
        return (*((m,) for m in markers), *dict.fromkeys(together))

    def _from(self, marker: str, ends: Array) -> list[float]:
        """How far a marker is from each end, m."""
        apart: Array = np.linalg.norm(ends - np.array(self.model.marker(marker).nominal), axis=1)
        return [float(d) for d in apart]

    @property
    def heavy(self) -> tuple[Segment, ...]:
        """Segments with mass, where forces are known."""
        return tuple(s for s in self.model.segments if s.mass > 0.0) if self.plates else ()

    @property
    def scopes(self) -> tuple[tuple[str, ...], ...]:
        """Trials in which something that does not change in a trial may be; () for all of them."""
        return _list_scopes(self.trials)

    @property
    def scopes_with_forces(self) -> tuple[tuple[str, ...], ...]:
        """The same of trials with forces."""
        return _list_scopes(self.wrenches)

    def scopes_of_plate(self, plate: str) -> tuple[tuple[str, ...], ...]:
        """The same for a plate, which is told of by the trials alone in which its load counts."""
        return _list_scopes(self.loaded.get(plate, self.wrenches))

    @property
    def bearing(self) -> tuple[Segment, ...]:
        """Segments that carry shown markers, themselves or beyond."""
        wanted = {self.model.marker(m).segment for m in self.markers}
        for segment in reversed(self.model.segments):
            if segment.name in wanted:
                wanted.add(segment.parent)
        return tuple(s for s in self.model.segments if s.name in wanted)

    def list_bearing(self, markers: Collection[str], *, beside: bool = False) -> set[str]:
        """Segments that bear any of some markers, and those beside them, and the joints that move them."""
        bearing = {m.segment for m in self.model.markers if m.name in markers}
        if beside:
            pairs = [(s.name, s.parent) for s in self.model.segments if s.parent != GROUND]
            bearing |= {name for pair in pairs if bearing & {*pair} for name in pair}
        return bearing | {s.joint_name for s in self.model.segments if s.name in bearing}

    @property
    def jointed(self) -> tuple[Segment, ...]:
        """Bearing segments that hang on another segment by a joint that turns."""
        return tuple(s for s in self.bearing if s.parent != GROUND and find_turning_joints(s) is not None)

    def coordinates_of(self, segment: Segment) -> tuple[str, ...]:
        """The moving coordinates of the joint that carries a segment."""
        used = {t.coordinate for joint in segment.joints for t in joint.law.terms}
        return tuple(c for c in self.moving if c in used)

    def drivers_of(self, segment: str) -> tuple[str, ...]:
        """Moving coordinates of the joints at both ends of a segment: what its skin could follow."""
        own = self.model.segment(segment)
        near = (() if own.parent == GROUND else (own,)) + tuple(self.model.children(segment))
        return tuple(dict.fromkeys(c for s in near for c in self.coordinates_of(s)))


def _list_scopes(trials: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
    """All trials, each by itself, and all since the second, the third and so on."""
    if len(trials) < 2:
        return ((),)
    return ((), *((trial,) for trial in trials), *(trials[k:] for k in range(1, len(trials) - 1)))
