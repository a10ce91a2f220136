"""Joints and segments whose centres, axes, lengths or ways of moving are other than the model has them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scaling_service.capabilities.discovery.effects._columns import (
    DEG,
    make_shifts,
    make_turns,
    shift_of,
    turn_of,
)
from scaling_service.capabilities.discovery.effects.catalogue import Effect
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column, Part
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.laws.spots import LETTERS, At, JointSpot, SizeSpot
from scaling_service.capabilities.discovery.ordinary.body import list_sized
from scaling_service.model.body import Segment

_THIRD = 2  # of a joint of two turns: the axis about which neither is taken to go
AXIS_TILT = "joint_axis_tilt"

_AROUND: tuple[At, At] = ("before", "after")


def propose_centre_offsets(scene: Scene) -> Iterator[Candidate]:
    """Every joint that turns."""
    for segment in scene.jointed:
        columns = make_shifts(shift_of(segment.name))
        yield Candidate(kind="joint_centre_offset", where=(segment.joint_name,), columns=columns)


def propose_axis_tilts(scene: Scene) -> Iterator[Candidate]:
    """Every joint with one or two coordinates that turn it; one with three takes any direction anyhow.

    The turn goes before the joint's own and back after them, so that the neutral pose stays. About the
    joint's own axis it would change nothing.
    """
    for segment in scene.jointed:
        across = list_across(segment)
        if len(across) < 3:
            columns = tuple(
                Column(name=f"{LETTERS[k]}_deg", unit=DEG, parts=_shift_and_return(segment.name, k))
                for k in across
            )
            yield Candidate(kind=AXIS_TILT, where=(segment.joint_name,), columns=columns)


def list_across(segment: Segment) -> list[int]:
    """Axes about which a joint does not turn anyhow; all three of one that takes any direction."""
    own = [j for j in segment.joints if j.turns]
    if len({t.coordinate for j in own for t in j.law.terms} - {None}) >= 3:
        return [0, 1, 2]
    main = int(np.argmax(np.abs(own[0].axis))) if len(own) != 2 else _THIRD
    return [k for k in range(3) if k != main]


def _shift_and_return(segment: str, axis: int) -> tuple[Part, Part]:
    before, after = (JointSpot(segment, at, "rotation", axis) for at in _AROUND)
    return Part(before), Part(after, gain=-1.0)


def propose_coupled_motions(scene: Scene) -> Iterator[Candidate]:
    """Every joint that turns, gliding or turning with each of its own coordinates."""
    for segment in scene.jointed:
        for driver in scene.coordinates_of(segment):
            where = (segment.joint_name,)
            gliding = make_shifts(shift_of(segment.name), driver=driver)
            turning = tuple(make_turns(turn_of(segment.name), driver=driver)[k] for k in list_across(segment))
            yield Candidate(kind="coupled_motion", where=where, columns=gliding, driver=(driver,))
            yield Candidate(
                kind="coupled_motion", where=where, columns=turning, driver=(driver,), note="turning"
            )


def propose_segment_lengths(scene: Scene) -> Iterator[Candidate]:
    """Every segment that has a size."""
    for name in list_sized(scene):
        column = Column(name="factor", unit=1.0, parts=(Part(SizeSpot(name)),), neutral=1.0)
        yield Candidate(kind="segment_length", where=(name,), columns=(column,))


EFFECTS = (
    Effect(
        kind="joint_centre_offset",
        meaning="the joint's centre lies elsewhere in the parent segment",
        candidates=propose_centre_offsets,
    ),
    Effect(kind=AXIS_TILT, meaning="the joint's axis is turned", candidates=propose_axis_tilts),
    Effect(
        kind="coupled_motion",
        meaning="the joint glides or turns along with a coordinate",
        candidates=propose_coupled_motions,
    ),
    Effect(
        kind="segment_length",
        meaning="the segment is longer or shorter, its markers following",
        candidates=propose_segment_lengths,
    ),
)
