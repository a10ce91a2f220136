"""All that is needed to play a result back: a document, tables of numbers, and surfaces."""

from __future__ import annotations

import dataclasses
from collections import abc
from pathlib import Path
from typing import Literal

import numpy as np

from scaling_service.capabilities.playback import document as playing
from scaling_service.capabilities.playback import drawing
from scaling_service.core.arrays import Array
from scaling_service.documents.base import ArrayEntry
from scaling_service.documents.writing import write_json
from scaling_service.files import table_files
from scaling_service.model import compile as compiling
from scaling_service.model import poses
from scaling_service.model import trial as trials
from scaling_service.model.anatomy.lengths import find_joint_centres
from scaling_service.model.body import BodyModel
from scaling_service.model.forces import GroundForces

FOLDER = "scene"
FILE_NAME = f"{FOLDER}/scene.json"

_MM = 1e3


@dataclasses.dataclass(frozen=True, slots=True)
class Detail:
    """How much of a scene is kept: triangles of a bone, and frames of a recording (None: all)."""

    most_faces: int = 20_000  # fine enough to fill a screen, and two legs of them turn smoothly
    most_frames: int | None = None


WHOLE = Detail()
INSIDE = Detail(most_faces=1_500, most_frames=150)
"""Of a report. Chosen: bones keep their shape and movements their course, in about a megabyte for six models
of six recordings."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Body:
    """One model of the person.

    ``bones``: segment to its bone in the segment's frame, m, with few faces.
    """

    name: str
    model: BodyModel
    bones: abc.Mapping[str, trials.Bone] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Played:
    """How a body moves in a recording.

    ``model``: as it was followed in this recording.
    ``q``: (n_frames, n_coordinates), rad or m.
    ``distances`` ((n_frames, n_markers), m): of measured and model marker; NaN where not seen.
    ``estimated``: coordinates that the recording determines.
    """

    body: str
    model: BodyModel
    q: Array
    markers: tuple[str, ...]
    distances: Array
    estimated: frozenset[str]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Recorded:
    """A recording with all bodies in it.

    ``trial``: its labels are the models' marker names.
    ``role``: 'calibration' or 'evaluation'.
    ``forces``: in our axes, on their own clock.
    ``corners``: (n_plates, 4, 3), m.
    """

    trial: trials.Trial
    role: Literal["calibration", "evaluation"]
    played: tuple[Played, ...]
    forces: GroundForces | None = None
    corners: Array | None = None


def write_scene(
    subject: str,
    bodies: abc.Sequence[Body],
    recorded: abc.Sequence[Recorded],
    gait: playing.GaitScene | None,
    outputs: Path,
    most_frames: int | None = None,
) -> playing.SceneDocument:
    """Write ``scene/scene.json`` with its tables and surfaces.

    ``outputs``: the folder of the job's files.
    ``most_frames``: of a recording; of a longer one every second, third, … frame is kept, in brief.
    """
    files = table_files.ArrayFiles(outputs, FOLDER, brief=most_frames is not None)
    document = playing.SceneDocument(
        subject=subject,
        bodies=[_make_body(body, outputs) for body in bodies],
        trials=[
            _make_trial(item, files, 1 if most_frames is None else -(-item.trial.n_frames // most_frames))
            for item in recorded
        ],
        gait=gait,
    )
    write_json(outputs / FILE_NAME, document)
    return document


def _make_body(body: Body, outputs: Path) -> playing.BodyEntry:
    model, values = body.model, poses.list_model_values(body.model)
    found, shapes = drawing.build_surfaces(model, body.bones)
    name = f"{FOLDER}/{_make_plain_name(body.name)}.glb"
    (outputs / name).parent.mkdir(parents=True, exist_ok=True)
    (outputs / name).write_bytes(drawing.to_glb(found))
    return playing.BodyEntry(
        name=body.name,
        bones=name,
        segments=[
            playing.SegmentEntry(name=s.name, parent=s.parent, shape=shapes[s.name]) for s in model.segments
        ],
        markers=[
            playing.BodyMarker(
                name=m.name,
                segment=m.segment,
                xyz_m=_point(poses.evaluate_marker(m, values)),
                anatomical=m.anatomical,
            )
            for m in model.markers
            if m.weight > 0.0
        ],
        centres=[
            playing.PlacedEntry(name=centre, segment=segment, xyz_m=_point(np.array(at)))
            for centre, (segment, at) in find_joint_centres(model).items()
        ],
        axes=[
            playing.AxisEntry(segment=segment, ends_m=ends)
            for segment, ends in drawing.find_knee_axes(model).items()
        ],
    )


def _make_trial(item: Recorded, files: table_files.ArrayFiles, step: int) -> playing.SceneTrial:
    trial = item.trial
    labels = tuple(dict.fromkeys(name for played in item.played for name in played.markers))
    return playing.SceneTrial(
        name=trial.name,
        role=item.role,
        frames=-(-trial.n_frames // step),
        rate_hz=trial.rate_hz / step,
        start_s=float(trial.times[0]),
        labels=list(labels),
        measured=files.write(f"{trial.name}.measured", trial.select(labels).markers[::step], "m"),
        motions={p.body: _make_motion(p, labels, trial.name, files, step) for p in item.played},
        plates=table_files.list_plates(item.forces, item.corners),
        force=_of_plates(item, files, "N", step),
        centre_of_pressure=_of_plates(item, files, "m", step),
    )


def _make_motion(
    played: Played, labels: tuple[str, ...], trial: str, files: table_files.ArrayFiles, step: int
) -> playing.MotionEntry:
    model, q = played.model, played.q[::step]
    stem = f"{trial}.{_make_plain_name(played.body)}"
    errors = np.full((len(played.q), len(labels)), np.nan)
    errors[:, [labels.index(name) for name in played.markers]] = _MM * played.distances
    # where frames are left out, the largest error of a stretch stands for it: no moment is missed
    largest = np.fmax.reduceat(errors, np.arange(0, len(errors), step), axis=0)
    turns = np.array([c.kind == "rotation" for c in model.coordinates])
    ranges = compiling.list_kept_ranges(model)
    return playing.MotionEntry(
        poses=files.write(f"{stem}.poses", poses.pose_segments(model, q), "m, quaternion x y z w"),
        errors=files.write(f"{stem}.errors", largest, "mm", first_look="largest"),
        coordinates=[
            playing.CoordinateEntry(
                name=c.name,
                unit="deg" if c.kind == "rotation" else "m",
                estimated=c.name in played.estimated,
                range=ranges.get(c.name),
            )
            for c in model.coordinates
        ],
        angles=files.write(f"{stem}.angles", np.where(turns, np.degrees(q), q), "deg or m"),
        placed=files.write(f"{stem}.placed", poses.place_markers(model, labels, q), "m")
        if poses.is_gliding(model, labels)
        else None,
    )


def _of_plates(item: Recorded, files: table_files.ArrayFiles, unit: str, step: int) -> ArrayEntry | None:
    forces, trial = item.forces, item.trial
    if forces is None:
        return None
    name, values = ("force", forces.force) if unit == "N" else ("pressure", forces.centre_of_pressure())
    return files.write(
        f"{trial.name}.{name}", table_files.sample_at(forces.times, values, trial.times[::step]), unit
    )


def _point(values: Array) -> playing.Point:
    x, y, z = (round(float(v), 6) for v in values)
    return (x, y, z)


def _make_plain_name(name: str) -> str:
    """A body's name as part of a file's."""
    return name.replace(" ", "_")
