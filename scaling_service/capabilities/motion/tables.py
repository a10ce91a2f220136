"""Coordinates over time as a table with units."""

from __future__ import annotations

import numpy as np

from scaling_service.capabilities.motion.unshown import hide_unshown
from scaling_service.core.tables import MotionTable
from scaling_service.model import results
from scaling_service.model.body import BodyModel


def tabulate_coordinates(
    trial: str, motion: results.Motion, model: BodyModel, sd: results.Array | None = None, *, system: str
) -> MotionTable:
    """Coordinates of a trial, degrees and m, each with its standard deviation where these are given.

    What markers do not show is NaN, its deviation infinite.

    ``sd``: (n_frames, n_coordinates), rad or m. ``system``: what the motion is by.
    """
    kinds = {c.name: c.kind for c in model.coordinates}
    q = hide_unshown(motion, model, motion.q)
    columns, values = ["time_s"], [motion.times]
    for k, name in enumerate(motion.coordinates):
        unit, factor = ("deg", 180.0 / np.pi) if kinds[name] == "rotation" else ("m", 1.0)
        columns.append(f"{name}_{unit}")
        values.append(factor * q[:, k])
        if sd is not None:
            columns.append(f"{name}_sd_{unit}")
            values.append(factor * np.where(np.isnan(q[:, k]), np.inf, sd[:, k]))
    rows = tuple(map(tuple, np.column_stack(values).tolist()))
    return MotionTable(trial, tuple(columns), rows, trial=trial, system=system)
