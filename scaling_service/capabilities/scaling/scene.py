"""Scaled models in motion, as they are played back."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scaling_service.capabilities.playback import drawing, scene
from scaling_service.capabilities.playback import result as playing
from scaling_service.capabilities.scaling import result
from scaling_service.capabilities.scaling.comparison import curves
from scaling_service.capabilities.scaling.muscles.playing import write_muscle_scene
from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError
from scaling_service.documents.writing import write_json
from scaling_service.files.forces import read_forces
from scaling_service.model.forces import GroundForces, PlateRecording
from scaling_service.model.trial import Trial
from scaling_service.recording.plates import compute_ground_forces, orient_forces


def write_results_scene(
    results: result.Results, outputs: Path, detail: scene.Detail = scene.WHOLE
) -> playing.SceneDocument:
    """Write the models of all methods in all recordings into the folder of a job's files."""
    session, files = results.session, scene.make_files(outputs, detail)
    images = {} if session.images is None else session.images.bones
    coarse = {segment: drawing.coarsen(bone, detail.most_faces) for segment, bone in images.items()}
    if results.muscles is not None:
        write_muscle_scene(results.muscles, outputs, brief=detail.most_frames is not None)
    trials = []
    for trial in session.dynamic:
        forces, corners = _prepare_ground(results, trial)
        followed = {
            name: (scaling.calibration.model, scaling.motions[trial.name])
            for name, scaling in results.scalings.items()
        }
        trials.append(
            scene.write_trial(
                trial,
                "evaluation" if trial.name in results.held_out else "calibration",
                followed,
                files,
                detail,
                forces=forces,
                corners=corners,
            )
        )
    reference = next(iter(results.scalings))
    found = curves.make_gait_curves(results, reference)
    document = playing.SceneDocument(
        subject=session.subject.id,
        bodies=[
            scene.write_body(name, c.model, drawing.place_bones(c, coarse), outputs)
            for name, c in ((name, scaling.calibration) for name, scaling in results.scalings.items())
        ],
        trials=trials,
        gait=playing.GaitScene(
            trials=list(found.trials),
            held_out=found.held_out,
            reason=found.reason,
            reference=reference,
            angles={
                curve.name: playing.CycleScene(
                    **curve.describe(3),
                    pairs={
                        name: playing.TestEntry(**curves.describe_test(pair))
                        for name, pair in curve.pairs.items()
                    },
                )
                for curve in found.curves
            },
        ),
    )
    write_json(outputs / scene.FILE_NAME, document)
    return document


def _prepare_ground(results: result.Results, trial: Trial) -> tuple[GroundForces | None, Array | None]:
    """Forces and corners of plates in our axes; none where they cannot be used, as the file check tells."""
    subject, axes = results.session.subject, results.loaded.orientation
    paths = {path.stem: path for path in (*subject.calibration, *subject.evaluation)}
    path = paths.get(trial.name)
    if path is None or axes is None:
        return None, None
    named, plates = subject.forces.get(path.name), results.loaded.plates.get(path)
    try:
        if named is not None:
            return (orient_forces(axes, read_forces(named)), None) if axes.up == "+y" else (None, None)
        if not isinstance(plates, PlateRecording):
            return None, None
        corners = axes.rotate(np.stack([plate.corners for plate in plates.plates]))
        return orient_forces(axes, compute_ground_forces(plates)), corners
    except InputError:
        return None, None
