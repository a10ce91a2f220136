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
        yield Candidate("joint_centre_offset", (segment.joint_name,), make_shifts(shift_of(segment.name)))


def propose_axis_tilts(scene: Scene) -> Iterator[Candidate]:
    """Every joint with one or two coordinates that turn it; one with three takes any direction anyhow.

    The turn goes before the joint's own and back after them, so that the neutral pose stays. About the
    joint's own axis it would change nothing.
    """
    for segment in scene.jointed:
        across = list_across(segment)
        if len(across) < 3:
            columns = []
            for k in across:
                before, after = (JointSpot(segment.name, at, "rotation", k) for at in _AROUND)
                parts = Part(before), Part(after, gain=-1.0)
                columns.append(Column(name=f"{LETTERS[k]}_deg", unit=DEG, parts=parts))
            yield Candidate(AXIS_TILT, (segment.joint_name,), tuple(columns))


def list_across(segment: Segment) -> list[int]:
    """Axes about which a joint does not turn anyhow; all three of one that takes any direction."""
    own = [j for j in segment.joints if j.turns]
    if len({t.coordinate for j in own for t in j.law.terms} - {None}) >= 3:
        return [0, 1, 2]
    main = int(np.argmax(np.abs(own[0].axis))) if len(own) != 2 else _THIRD
    return [k for k in range(3) if k != main]


def propose_coupled_motions(scene: Scene) -> Iterator[Candidate]:
    """Every joint that turns, gliding or turning with each of its own coordinates."""
    for segment in scene.jointed:
        for driver in scene.coordinates_of(segment):
            where = (segment.joint_name,)
            gliding = make_shifts(shift_of(segment.name), driver=driver)
            turning = tuple(make_turns(turn_of(segment.name), driver=driver)[k] for k in list_across(segment))
            yield Candidate("coupled_motion", where, gliding, driver=(driver,))
            yield Candidate("coupled_motion", where, turning, driver=(driver,), note="turning")


def propose_segment_lengths(scene: Scene) -> Iterator[Candidate]:
    """Every segment that has a size."""
    for name in list_sized(scene):
        column = Column(name="factor", unit=1.0, parts=(Part(SizeSpot(name)),), neutral=1.0)
        yield Candidate("segment_length", (name,), (column,))


EFFECTS = (
    Effect(
        "joint_centre_offset",
        "the joint's centre lies elsewhere in the parent segment",
        propose_centre_offsets,
    ),
    Effect(AXIS_TILT, "the joint's axis is turned", propose_axis_tilts),
    Effect("coupled_motion", "the joint glides or turns along with a coordinate", propose_coupled_motions),
    Effect(
        "segment_length", "the segment is longer or shorter, its markers following", propose_segment_lengths
    ),
)
