"""Motions with their uncertainty onto disk: OpenSim files, with the coordinates that follow others, too."""

from __future__ import annotations

import csv
from collections import abc
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from scaling_service.capabilities.motion import result, unshown
from scaling_service.capabilities.motion.clinical_angles import ClinicalAngles
from scaling_service.core.arrays import Array
from scaling_service.documents import writing
from scaling_service.files import sto
from scaling_service.files.tables import format_rows
from scaling_service.model import body
from scaling_service.model import compile as compiling
from scaling_service.model.anatomy import frames
from scaling_service.model.poses import pose_segments
from scaling_service.model.results import Motion

CLINICAL = "_clinical.csv"
HELD = "_opensim.mot"
"""End of a motion's name whose numbers are whole: OpenSim's tools stop reading at a NaN."""

FILE_NAME = "ik.json"


def write_motion(path: Path, motion: Motion, model: body.BodyModel) -> None:
    """Write a motion as ``.mot``: degrees and m, dependent coordinates after the independent ones.

    A dependent coordinate of OpenSim's motion type "coupled" stays in radians where the file is in degrees.
    Coordinates that markers do not show, in a frame or ever, are written as NaN. Where there are any, a
    second file (``HELD``) has those that are never shown at their neutral value, and leaves out other frames
    with one.
    """
    told = replace(motion, q=unshown.hide_unshown(motion, model, motion.q))
    _write(path, told, told.q, _follow(told, model), model)
    lost = np.isnan(told.q)
    if lost.any():
        never = lost.all(axis=0)
        q = np.where(never, [c.default for c in model.coordinates], told.q)
        rows = np.flatnonzero(~lost[:, ~never].any(axis=1))
        held = replace(motion, times=motion.times[rows], q=q[rows], residuals=motion.residuals[rows])
        _write(path.with_name(f"{path.stem}{HELD}"), held, held.q, _follow(held, model), model)


def _follow(motion: Motion, model: body.BodyModel) -> list[Array]:
    """Dependent coordinates, each (n_frames,)."""
    return [
        compiling.evaluate_law_at(coupler.law, _express_leading(coupler, motion))
        for coupler in model.couplers
    ]


def write_motion_sd(path: Path, motion: Motion, sd: Array, model: body.BodyModel) -> None:
    """Write standard deviations (n_frames, n_coordinates) in the columns and units of :func:`write_motion`.

    A dependent coordinate's is that of the leading one times the slope of its law. Infinite where markers do
    not show a coordinate.
    """
    sd = unshown.hide_unshown(motion, model, np.where(np.isnan(motion.q), np.inf, sd), np.inf)
    followed = []
    for coupler in model.couplers:
        slopes = compiling.differentiate_law_at(coupler.law, _express_leading(coupler, motion))
        leading = sd[:, motion.coordinates.index(coupler.independent)]
        followed.append(np.where(np.isinf(leading), np.inf, np.abs(slopes) * leading))
    _write(path, motion, sd, followed, model)


def _write(
    path: Path, motion: Motion, values: Array, followed: abc.Sequence[Array], model: body.BodyModel
) -> None:
    names = [*motion.coordinates, *(c.dependent for c in model.couplers)]
    kinds = [model.coordinate(name).kind for name in motion.coordinates]
    kinds += [coupler.kind for coupler in model.couplers]
    sto.write_sto(
        path,
        sto.tabulate_motion(motion.trial, motion.times, names, kinds, np.column_stack([values, *followed])),
    )


def _express_leading(coupler: body.Coupler, motion: Motion) -> Array:
    """The coordinate that a dependent one follows, (n_frames,)."""
    return motion.q[:, motion.coordinates.index(coupler.independent)]


def tabulate_poses(motion: Motion, model: body.BodyModel) -> sto.Table:
    """Where every segment is, in the columns of OpenSim's BodyKinematics.

    Origin in ground (m), and body-fixed X-Y-Z angles (deg); NaN where a coordinate that carries the segment
    is not determined.
    """
    poses = pose_segments(model, motion.q)
    lost = np.asarray(np.isnan(poses).any(axis=2))
    turns = np.where(lost[..., None], Rotation.identity().as_quat(), poses[..., 3:])
    turned = Rotation.from_quat(turns.reshape(-1, 4))
    angles = turned.as_euler("XYZ", degrees=True, suppress_warnings=True).reshape(*lost.shape, 3)
    angles[lost] = np.nan
    columns = (f"{s}_{part}" for s in model.segment_names for part in ("X", "Y", "Z", "Ox", "Oy", "Oz"))
    values = np.concatenate([poses[..., :3], angles], axis=2).reshape(len(poses), -1)
    data = np.column_stack([motion.times, values])
    return sto.Table(name=motion.trial, columns=("time", *columns), data=data, in_degrees=True)


def write_clinical_angles(folder: Path, angles: ClinicalAngles) -> None:
    """``<trial>_clinical.csv``: every angle over time, its standard deviation after it where that is known.

    Nothing is written where the model tells none.
    """
    columns = {
        f"{name}_{side}_{what}deg": np.degrees(values[side][name])
        for side in frames.SIDES
        for name in frames.ANGLES
        for what, values in (("", angles.values), ("sd_", angles.sd))
        if name in angles.values[side] and name in values.get(side, {})
    }
    if columns:
        rows = np.column_stack([angles.times, *columns.values()])
        write_numbers(folder / f"{angles.trial}{CLINICAL}", ["time_s", *columns], format_numbers(rows))


def format_numbers(table: Array) -> abc.Iterator[list[str]]:
    """Rows of a table, (n_rows, n_columns), as text; empty where a number is not known."""
    for lines in format_rows(",".join(["%.4f"] * table.shape[1]), table):
        yield from (line.split(",") for line in lines.replace("nan", "").splitlines())


def write_numbers(path: Path, heads: abc.Sequence[str], rows: abc.Iterable[abc.Sequence[str]]) -> None:
    """A table of comma-separated values."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(heads)
        writer.writerows(rows)


def save_motions(tracked: result.Tracked, folder: str | Path) -> result.MotionDocument:
    """Write every trial's motion and standard deviations, ``ik.json``, and what else is asked for.

    Parameters
    ----------
    tracked : Tracked
        From :func:`ik`.
    folder : path
        Made if it does not exist. Other files in it stay.

    Returns
    -------
    MotionDocument
        What was written as ``ik.json``: errors in mm.

    Raises
    ------
    InputError
        The folder cannot be made or written to.

    Examples
    --------
    >>> import scaling_service as ss
    >>> document = ss.save_motions(ss.ik("compared/MB/model.json", ["lab/gait_1.trc"]), "followed")
    >>> list(document.trials)
    ['gait_1']
    """
    model = tracked.loaded.session.model
    with writing.all_or_nothing(Path(folder)) as scratch:
        for name, trial in tracked.trials.items():
            write_motion(scratch / f"{name}_ik.mot", trial.motion, model)
            write_motion_sd(scratch / f"{name}_ik_sd.mot", trial.motion, trial.uncertainty.sd, model)
            if trial.angles is not None:
                write_clinical_angles(scratch, trial.angles)
            if tracked.options.poses:
                sto.write_sto(scratch / f"{name}_poses.sto", tabulate_poses(trial.motion, model))
        files = sorted(path.name for path in scratch.iterdir())
        document = tracked.make_document(files)
        writing.write_json(scratch / FILE_NAME, document)
    return document
