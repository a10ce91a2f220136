"""A joint whose axis points elsewhere."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.effects._columns import DEG
from scaling_service.capabilities.discovery.evidence.spots import LETTERS, JointSpot
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column, Part

KIND = "joint_axis_tilt"
MEANING = "the joint's axis is turned"


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Every joint of one or two turns; one of three takes any direction anyhow.

    The turn goes before the joint's own and back after them, so that the neutral pose stays.
    """
    for segment in scene.jointed:
        turns = [j for j in segment.joints if j.kind == "rotation" and not j.law.is_constant]
        if len(turns) < 3:
            columns = tuple(
                Column(
                    f"{LETTERS[k]}_deg",
                    DEG,
                    (
                        Part(JointSpot(segment.name, "before", "rotation", k)),
                        Part(JointSpot(segment.name, "after", "rotation", k), gain=-1.0),
                    ),
                    low=-45.0,
                    high=45.0,
                )
                for k in (0, 1)
            )
            yield Candidate(KIND, (segment.joint_name,), columns)
