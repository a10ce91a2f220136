"""Writes what a result is played back with: tables of numbers, and surfaces, each told by its entry."""

from __future__ import annotations

import dataclasses
from collections import abc
from pathlib import Path
from typing import Literal

import numpy as np

from scaling_service.capabilities.playback import drawing
from scaling_service.capabilities.playback import result as playing
from scaling_service.core.arrays import Array
from scaling_service.documents.base import ArrayEntry
from scaling_service.files import table_files
from scaling_service.model import compile as compiling
from scaling_service.model import poses
from scaling_service.model import trial as trials
from scaling_service.model.anatomy.lengths import find_joint_centres
from scaling_service.model.body import BodyModel
from scaling_service.model.forces import GroundForces
from scaling_service.model.results import Motion

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


def make_files(outputs: Path, detail: Detail) -> table_files.ArrayFiles:
    """For the tables of a scene in the folder of a job's files."""
    return table_files.ArrayFiles(outputs, FOLDER, brief=detail.most_frames is not None)


def write_body(
    name: str, model: BodyModel, bones: abc.Mapping[str, trials.Bone], outputs: Path
) -> playing.BodyEntry:
    """One model of the person, its surfaces written into the folder of a job's files.

    ``bones``: segment to its bone in the segment's frame, m, with few faces.
    """
    values = poses.list_model_values(model)
    found, shapes = drawing.build_surfaces(model, bones)
    file = f"{FOLDER}/{_make_plain_name(name)}.glb"
    (outputs / file).parent.mkdir(parents=True, exist_ok=True)
    (outputs / file).write_bytes(drawing.to_glb(found))
    return playing.BodyEntry(
        name=name,
        bones=file,
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


def write_trial(
    trial: trials.Trial,
    role: Literal["calibration", "evaluation"],
    followed: abc.Mapping[str, tuple[BodyModel, Motion]],
    files: table_files.ArrayFiles,
    detail: Detail,
    *,
    forces: GroundForces | None = None,
    corners: Array | None = None,
) -> playing.SceneTrial:
    """A recording with all bodies in it, its tables written.

    ``trial``: its labels are the models' marker names. ``followed``: body to its model, as it was followed
    in this recording, and how it moves. ``forces``: in our axes, on their own clock. ``corners``:
    (n_plates, 4, 3), m.
    """
    step = 1 if detail.most_frames is None else -(-trial.n_frames // detail.most_frames)
    labels = tuple(dict.fromkeys(name for _, motion in followed.values() for name in motion.markers))
    times, sampled = trial.times[::step], dict[str, ArrayEntry]()
    if forces is not None:
        courses = {"force": (forces.force, "N"), "pressure": (forces.centre_of_pressure(), "m")}
        for name, (values, unit) in courses.items():
            values = table_files.sample_at(forces.times, values, times)
            sampled[name] = files.write(f"{trial.name}.{name}", values, unit)
    return playing.SceneTrial(
        name=trial.name,
        role=role,
        frames=len(times),
        rate_hz=trial.rate_hz / step,
        start_s=float(trial.times[0]),
        labels=list(labels),
        measured=files.write(f"{trial.name}.measured", trial.select(labels).markers[::step], "m"),
        motions={
            body: _write_motion(f"{trial.name}.{_make_plain_name(body)}", model, motion, labels, files, step)
            for body, (model, motion) in followed.items()
        },
        plates=table_files.list_plates(forces, corners),
        force=sampled.get("force"),
        centre_of_pressure=sampled.get("pressure"),
    )


def _write_motion(
    stem: str,
    model: BodyModel,
    motion: Motion,
    labels: tuple[str, ...],
    files: table_files.ArrayFiles,
    step: int,
) -> playing.MotionEntry:
    q = motion.q[::step]
    errors = np.full((len(motion.q), len(labels)), np.nan)
    errors[:, [labels.index(name) for name in motion.markers]] = _MM * motion.distances
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
                estimated=c.name in motion.estimated,
                range=ranges.get(c.name),
            )
            for c in model.coordinates
        ],
        angles=files.write(f"{stem}.angles", np.where(turns, np.degrees(q), q), "deg or m"),
        placed=files.write(f"{stem}.placed", poses.place_markers(model, labels, q), "m")
        if poses.is_gliding(model, labels)
        else None,
    )


def _point(values: Array) -> playing.Point:
    x, y, z = (round(float(v), 6) for v in values)
    return (x, y, z)


def _make_plain_name(name: str) -> str:
    """A body's name as part of a file's."""
    return name.replace(" ", "_")
