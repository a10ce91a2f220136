"""Scaled models in motion: the overlay of a report, and what is played back."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scaling_service.capabilities.playback.document import CycleScene, GaitScene, SceneDocument, TestEntry
from scaling_service.capabilities.playback.drawing import (
    MOST_FACES,
    draw_body,
    follow_person,
    place_bones,
    place_points,
)
from scaling_service.capabilities.playback.scene import Body, Played, Recorded, write_scene
from scaling_service.capabilities.scaling.comparison.curves import describe_test, make_gait_curves
from scaling_service.capabilities.scaling.result import Results, Scaling
from scaling_service.core.errors import InputError
from scaling_service.files.forces import read_forces
from scaling_service.model.body import BodyModel, Marker, Vector
from scaling_service.model.forces import GroundForces, PlateRecording
from scaling_service.model.results import Array
from scaling_service.model.trial import ImagePose, Trial
from scaling_service.recording.plates import compute_ground_forces, orient_forces
from scaling_service.report.methods import list_styles
from scaling_service.report.scene import Scene, coarsen

MOST_FRAMES = 60
"""Chosen: a second of walking at 60 per second, or a minute of slow movement at one per second."""

_CORNERS: tuple[Vector, ...] = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def make_overlay(results: Results, trial: Trial, chosen: str) -> Scene | None:
    """All models in one trial, with the measured markers and bones; None where no frame shows anything.

    ``chosen``: the method that is seen at first, beside the first one computed.
    """
    rows = np.unique(np.linspace(0, trial.n_frames - 1, min(trial.n_frames, MOST_FRAMES)).astype(np.intp))
    scalings = {name: s for name, s in results.scalings.items() if trial.name in s.motions}
    labels = tuple(dict.fromkeys(m for s in scalings.values() for m in s.motions[trial.name].markers))
    measured = trial.select(labels).markers[rows]
    if not np.isfinite(measured).any():
        return None
    images = {} if results.session.images is None else results.session.images.bones
    colours, shown = list_styles(list(results.scalings)), (chosen, next(iter(scalings)))
    bodies = []
    for name, scaling in scalings.items():
        calibration, motion = scaling.calibration, scaling.motions[trial.name]
        model, q = calibration.model, motion.q[rows]
        poses = {s: _pose_image(model, s, pose, q) for s, pose in calibration.image_poses.items()}
        bodies.append(
            draw_body(
                name, colours[name].colour, model, q, motion.markers, labels, poses, shown=name in shown
            )
        )
    imaged = dict.fromkeys(segment for body in bodies for segment in body.bones)
    return follow_person(
        Scene(
            caption=f"{trial.name}, {'not fitted' if trial in results.session.evaluation else 'used to fit'}",
            description=f"Models of {', '.join(scalings)} with measured markers in {trial.name}, turned by "
            "dragging.",
            times=trial.times[rows],
            labels=labels,
            measured=measured,
            bodies=bodies,
            surfaces={segment: coarsen(images[segment]) for segment in imaged if segment in images},
        )
    )


def _pose_image(model: BodyModel, segment: str, image: ImagePose, q: Array) -> Array:
    """From the image to the laboratory with a segment: rotation by rows and origin, (n_frames, 12), m."""
    corners = tuple(Marker.at(f"point {k}", segment, at) for k, at in enumerate(_CORNERS))
    placed = place_points(model, corners, q)
    R_ground_segment = np.transpose(placed[:, 1:] - placed[:, :1], (0, 2, 1))
    R_ground_image = R_ground_segment @ image.rotation.T
    origin = placed[:, 0] - R_ground_image @ image.origin
    return np.concatenate([R_ground_image.reshape(len(q), 9), origin], axis=1)


def write_results_scene(results: Results, outputs: Path) -> SceneDocument:
    """Write the models of all methods in all recordings into the folder of a job's files."""
    session = results.session
    images = {} if session.images is None else session.images.bones
    coarse = {segment: coarsen(bone, MOST_FACES) for segment, bone in images.items()}
    bodies = [
        Body(name, scaling.calibration.model, place_bones(scaling.calibration, coarse))
        for name, scaling in results.scalings.items()
    ]
    recorded = [_record(results, trial) for trial in session.dynamic]
    return write_scene(session.subject.id, bodies, recorded, _make_gait(results), outputs)


def _play_recording(name: str, scaling: Scaling, trial: Trial) -> Played:
    motion, model = scaling.motions[trial.name], scaling.calibration.model
    return Played(
        body=name,
        model=model,
        q=motion.q,
        markers=motion.markers,
        distances=motion.distances,
        estimated=frozenset(motion.estimated),
    )


def _record(results: Results, trial: Trial) -> Recorded:
    forces, corners = _prepare_ground(results, trial)
    return Recorded(
        trial=trial,
        role="evaluation" if trial.name in results.held_out else "calibration",
        played=tuple(_play_recording(name, scaling, trial) for name, scaling in results.scalings.items()),
        forces=forces,
        corners=corners,
    )


def _prepare_ground(results: Results, trial: Trial) -> tuple[GroundForces | None, Array | None]:
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


def _make_gait(results: Results) -> GaitScene:
    reference = next(iter(results.scalings))
    found = make_gait_curves(results, reference)
    return GaitScene(
        trials=list(found.trials),
        held_out=found.held_out,
        reason=found.reason,
        reference=reference,
        angles={
            curve.name: CycleScene(
                **curve.describe(3),
                pairs={name: TestEntry(**describe_test(pair)) for name, pair in curve.pairs.items()},
            )
            for curve in found.curves
        },
    )
