"""The models before and after a search, as they are played back."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scaling_service.capabilities.discovery.observations.tracked import MotionFit
from scaling_service.capabilities.discovery.result import DiscoverResults
from scaling_service.capabilities.playback import scene
from scaling_service.capabilities.playback.document import SceneDocument
from scaling_service.capabilities.playback.drawing import coarsen, place_bones
from scaling_service.model.trial import Bone

BEFORE, AFTER = "as given", "with what was named"
"""Bodies of a search."""


def write_discovery_scene(
    results: DiscoverResults, outputs: Path, detail: scene.Detail = scene.WHOLE
) -> SceneDocument:
    """Write the model as given, and with what was named, in all recordings, into a job's folder."""
    pairs = list(zip(results.before.tracked, results.after.tracked, strict=True))
    # The person's bones where the model was scaled from images
    images, calibration = results.prepared.loaded.session.images, results.prepared.calibration
    bones: dict[str, Bone] = {}
    if images is not None and calibration is not None:
        coarse = {segment: coarsen(bone, detail.most_faces) for segment, bone in images.bones.items()}
        bones = place_bones(calibration, coarse)
    bodies = [
        scene.Body(name, item.task.model, bones) for name, item in zip((BEFORE, AFTER), pairs[0], strict=True)
    ]
    recorded = [
        scene.Recorded(
            trial=before.trial,
            role="calibration" if before.role == "fit" else "evaluation",
            played=(_play_recording(BEFORE, before), _play_recording(AFTER, after)),
        )
        for before, after in pairs
    ]
    return scene.write_scene(results.prepared.subject.id, bodies, recorded, None, outputs, detail.most_frames)


def _play_recording(name: str, item: MotionFit) -> scene.Played:
    return scene.Played(
        body=name,
        model=item.task.model,
        q=item.q,
        markers=item.markers,
        distances=np.linalg.norm(item.residuals, axis=2),
        estimated=frozenset(item.task.model.coordinate_names),
    )
