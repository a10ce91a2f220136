"""Models before and after a search, as they are played back."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scaling_service.capabilities.discovery.observations.tracked import TrackedTrial
from scaling_service.capabilities.discovery.run import DiscoverResults
from scaling_service.capabilities.discovery.start import Prepared
from scaling_service.capabilities.playback.document import SceneDocument
from scaling_service.capabilities.playback.scene import Body, Played, Recorded, write_scene
from scaling_service.capabilities.playback.shapes import MOST_FACES, local_bones
from scaling_service.model.trial import Bone
from scaling_service.report.scene import coarsened

BEFORE, AFTER = "as given", "with what was named"
"""Bodies of a search."""


def scene_of_discovery(results: DiscoverResults, outputs: Path) -> SceneDocument:
    """Write the model as given, and with what was named, in all recordings.

    ``outputs``: the folder of the job's files.
    """
    pairs = list(zip(results.before.tracked, results.after.tracked, strict=True))
    bones = _bones(results.prepared)
    bodies = [
        Body(name, item.task.model, bones) for name, item in zip((BEFORE, AFTER), pairs[0], strict=True)
    ]
    recorded = [
        Recorded(
            before.trial,
            "calibration" if before.role == "fit" else "evaluation",
            (_watched(BEFORE, before), _watched(AFTER, after)),
        )
        for before, after in pairs
    ]
    return write_scene(results.prepared.loaded.session.subject.id, bodies, recorded, None, outputs)


def _bones(prepared: Prepared) -> dict[str, Bone]:
    """The person's bones where the model was scaled from images."""
    images = prepared.loaded.session.images
    if images is None or prepared.calibration is None:
        return {}
    coarse = {segment: coarsened(bone, MOST_FACES) for segment, bone in images.bones.items()}
    return local_bones(prepared.calibration, coarse)


def _watched(name: str, item: TrackedTrial) -> Played:
    distances = np.linalg.norm(item.residuals, axis=2)
    model = item.task.model
    return Played(name, model, item.q, item.markers, distances, frozenset(model.coordinate_names))
