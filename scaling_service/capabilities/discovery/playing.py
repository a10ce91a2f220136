"""The models before and after a search, as they are played back."""

from __future__ import annotations

from pathlib import Path

from scaling_service.capabilities.discovery.observations.tracked import MotionFit
from scaling_service.capabilities.discovery.result import DiscoverResults
from scaling_service.capabilities.playback import scene
from scaling_service.capabilities.playback.drawing import coarsen, place_bones
from scaling_service.capabilities.playback.result import SceneDocument
from scaling_service.documents.writing import write_json
from scaling_service.model.body import BodyModel
from scaling_service.model.results import Motion
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
    files = scene.make_files(outputs, detail)
    document = SceneDocument(
        subject=results.prepared.subject.id,
        bodies=[
            scene.write_body(name, item.task.model, bones, outputs)
            for name, item in zip((BEFORE, AFTER), pairs[0], strict=True)
        ],
        trials=[
            scene.write_trial(
                before.trial,
                "calibration" if before.role == "fit" else "evaluation",
                {BEFORE: _tell_motion(before), AFTER: _tell_motion(after)},
                files,
                detail,
            )
            for before, after in pairs
        ],
        gait=None,
    )
    write_json(outputs / scene.FILE_NAME, document)
    return document


def _tell_motion(item: MotionFit) -> tuple[BodyModel, Motion]:
    """The model as it was followed, and how it moves; all coordinates count as determined."""
    model = item.task.model
    motion = Motion(
        trial=item.name,
        times=item.times,
        coordinates=model.coordinate_names,
        q=item.q,
        markers=item.markers,
        residuals=item.residuals,
        estimated=model.coordinate_names,
    )
    return model, motion
