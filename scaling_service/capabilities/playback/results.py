"""From results of scaling or of a search to what is played back."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from scaling_service.capabilities.discovery.observations.tracked import TrackedTrial
from scaling_service.capabilities.discovery.run import DiscoverResults
from scaling_service.capabilities.discovery.start import Prepared
from scaling_service.capabilities.playback.document import CycleScene, GaitScene, SceneDocument, TestEntry
from scaling_service.capabilities.playback.scene import Body, Played, Recorded, write_scene
from scaling_service.capabilities.playback.shapes import MOST_FACES
from scaling_service.capabilities.scaling.bone_files import local_bones
from scaling_service.capabilities.scaling.curves import gait_curves
from scaling_service.capabilities.scaling.report.data import CycleCurves
from scaling_service.capabilities.scaling.run import Results, Scaling
from scaling_service.core.errors import InputError
from scaling_service.files.c3d import read_c3d_file
from scaling_service.files.c3d_plates import read_c3d_plates
from scaling_service.files.forces import read_forces
from scaling_service.model.forces import GroundForces
from scaling_service.model.images import Bone
from scaling_service.model.subject import Subject
from scaling_service.model.trial import Array, Trial
from scaling_service.numerics.statistics.waveform_clusters import CurveTest
from scaling_service.recording.orientation import Orientation
from scaling_service.recording.plates import ground_forces, orient_forces
from scaling_service.report.coarse import coarsened

BEFORE, AFTER = "as given", "with what was named"
"""Bodies of a search."""


def scene_of_results(results: Results, outputs: Path) -> SceneDocument:
    """Write the models of all methods in all recordings.

    Parameters
    ----------
    results : Results
    outputs : Path
        The folder of the job's files.
    """
    session = results.session
    images = {} if session.images is None else session.images.bones
    coarse = {segment: coarsened(bone, MOST_FACES) for segment, bone in images.items()}
    fitted = {trial.name for trial in session.calibration}
    recorded = []
    for trial in session.dynamic:
        forces, corners = _ground(session.subject, trial, results.loaded.orientation)
        played = tuple(_played(name, scaling, trial) for name, scaling in results.scalings.items())
        recorded.append(
            Recorded(
                trial,
                "calibration" if trial.name in fitted else "evaluation",
                played,
                forces,
                corners,
            )
        )
    bodies = [_body(name, scaling, coarse) for name, scaling in results.scalings.items()]
    return write_scene(session.subject.id, bodies, recorded, _gait(results), outputs)


def _body(name: str, scaling: Scaling, bones: Mapping[str, Bone]) -> Body:
    return Body(name, scaling.calibration.model, local_bones(scaling.calibration, bones))


def _played(name: str, scaling: Scaling, trial: Trial) -> Played:
    motion = scaling.motions[trial.name]
    model = scaling.calibration.model
    return Played(name, model, motion.q, motion.markers, motion.distances, frozenset(motion.estimated))


def _ground(
    subject: Subject, trial: Trial, axes: Orientation | None
) -> tuple[GroundForces | None, Array | None]:
    """Forces and corners of plates in our axes; none where they cannot be used, as the proof tells."""
    paths = {path.stem: path for path in (*subject.calibration, *subject.evaluation)}
    path = paths.get(trial.name)
    if path is None or axes is None:
        return None, None
    named = subject.forces.get(path.name)
    try:
        if named is not None:
            return (orient_forces(axes, read_forces(named)), None) if axes.up == "+y" else (None, None)
        if path.suffix.lower() != ".c3d":
            return None, None
        plates = read_c3d_plates(read_c3d_file(path))
        corners = axes.rotate(np.stack([plate.corners for plate in plates.plates]))
        return orient_forces(axes, ground_forces(plates)), corners
    except InputError:
        return None, None


def _gait(results: Results) -> GaitScene:
    reference = next(iter(results.scalings))
    found = gait_curves(results, reference)
    return GaitScene(
        trials=list(found.trials),
        held_out=found.held_out,
        reason=found.reason,
        reference=reference,
        angles={curve.name: _cycle(curve) for curve in found.curves},
    )


def _cycle(curve: CycleCurves) -> CycleScene:
    test = _test(curve.anova)
    return CycleScene(
        cycles=curve.n_cycles,
        mean_deg={name: _rounded(values) for name, values in curve.mean.items()},
        sd_deg={name: _rounded(values) for name, values in curve.sd.items()},
        pairs={name: _test(pair) for name, pair in curve.pairs.items()},
        p=test.p,
        can_decide=test.can_decide,
        differ_percent=test.differ_percent,
    )


def _test(test: CurveTest | None) -> TestEntry:
    if test is None:
        return TestEntry(p=None, can_decide=False, differ_percent=[])
    return TestEntry(
        p=test.p, can_decide=test.can_decide, differ_percent=[(c.start, c.end) for c in test.clusters]
    )


def _rounded(values: Array) -> list[float]:
    return [round(float(v), 3) for v in values]


def scene_of_discovery(results: DiscoverResults, outputs: Path) -> SceneDocument:
    """Write the model as given, and with what was named, in all recordings.

    Parameters
    ----------
    results : DiscoverResults
    outputs : Path
        The folder of the job's files.
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
