"""Motions and poses as OpenSim files, with the coordinates that follow others written out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from scaling_service.files.sto import Table, motion_table, write_sto
from scaling_service.model.body import BodyModel, Coupler, Law
from scaling_service.model.compile import law_value
from scaling_service.model.poses import segment_poses
from scaling_service.model.results import Array, Motion

_STEP = 1e-5  # rad or m; chosen: the laws are cubic pieces, so rounding and curvature both stay below 1e-9


def write_motion(path: Path, motion: Motion, model: BodyModel) -> None:
    """Write a motion as ``.mot``: degrees and m, dependent coordinates after the independent ones.

    A dependent coordinate is of OpenSim's motion type "coupled": it stays in radians where the file is in
    degrees. Coordinates that a frame does not determine are NaN, and are written so.
    """
    followed = [law_values(coupler.law, _leading(coupler, motion)) for coupler in model.couplers]
    _write(path, motion, motion.q, followed, model)


def write_motion_sd(path: Path, motion: Motion, sd: Array, model: BodyModel) -> None:
    """Write standard deviations (n_frames, n_coordinates) in the columns and units of :func:`write_motion`.

    A dependent coordinate's is that of the leading one times the slope of its law.
    """
    followed = []
    for coupler in model.couplers:
        x, k = _leading(coupler, motion), motion.coordinates.index(coupler.independent)
        rise = law_values(coupler.law, x + _STEP) - law_values(coupler.law, x - _STEP)
        followed.append(np.abs(rise / (2.0 * _STEP)) * sd[:, k])
    _write(path, motion, sd, followed, model)


def _write(path: Path, motion: Motion, values: Array, followed: Sequence[Array], model: BodyModel) -> None:
    names = [*motion.coordinates, *(c.dependent for c in model.couplers)]
    kinds = [model.coordinate(name).kind for name in motion.coordinates]
    kinds += ["translation" for _ in model.couplers]  # OpenSim reads what follows as it is, never in degrees
    write_sto(
        path, motion_table(motion.trial, motion.times, names, kinds, np.column_stack([values, *followed]))
    )


def _leading(coupler: Coupler, motion: Motion) -> Array:
    """The coordinate that a dependent one follows, (n_frames,)."""
    x: Array = motion.q[:, motion.coordinates.index(coupler.independent)]
    return x


def law_values(law: Law, x: Array) -> Array:
    """A law of one coordinate at all its values, (n_frames,).

    ValueError where it holds a parameter.
    """
    if any(term.parameter is not None for term in law.terms):
        raise ValueError("a coordinate follows another one only")
    names = {term.coordinate for term in law.terms if term.coordinate is not None}
    return np.asarray(np.zeros_like(x) + law_value(law, dict.fromkeys(names, x)))


def poses_table(motion: Motion, model: BodyModel) -> Table:
    """Where every segment is, in the columns of OpenSim's BodyKinematics.

    Origin in ground (m), and body-fixed X-Y-Z angles (deg); NaN where a coordinate that carries the segment
    is not determined.
    """
    poses = segment_poses(model, motion.q)
    lost = np.asarray(np.isnan(poses).any(axis=2))
    turns = np.where(lost[..., None], Rotation.identity().as_quat(), poses[..., 3:])
    turned = Rotation.from_quat(turns.reshape(-1, 4))
    angles = turned.as_euler("XYZ", degrees=True, suppress_warnings=True).reshape(*lost.shape, 3)
    angles[lost] = np.nan
    columns = (f"{s}_{part}" for s in model.segment_names for part in ("X", "Y", "Z", "Ox", "Oy", "Oz"))
    values = np.concatenate([poses[..., :3], angles], axis=2).reshape(len(poses), -1)
    data = np.column_stack([motion.times, values])
    return Table(motion.trial, ("time", *columns), data, in_degrees=True)
