"""Lengths and moment arms of an OpenSim model's muscles over a motion, by OpenSim in its own process."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.files.osim.process import TIME_LIMIT_S, ask
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import law_slopes, law_values

Array = NDArray[np.float64]

_FRAME_S = 0.1  # chosen: of time allowed for each frame; 80 muscles take 4 ms on a quiet machine


@dataclass(frozen=True, slots=True, eq=False)
class MuscleGeometry:
    """Muscles of one model over one motion; NaN in frames that do not determine the pose."""

    muscles: tuple[str, ...]
    lengths: Array  # (n_frames, n_muscles), m: of muscle and tendon together
    arms: Mapping[tuple[str, str], Array]
    """Muscle and coordinate to the moment arm, (n_frames,), m; pairs that are always zero are left out."""


def measure_muscles(osim: str, model: BodyModel, q: Array) -> MuscleGeometry:
    """Lengths and moment arms over a motion, as OpenSim's muscle analysis has them.

    A moment arm is the generalised force of a unit tension at a coordinate, that of coordinates coupled to it
    included (Sherman, Seth and Delp 2013, "What is a moment arm?").

    ``osim``: text of the ``.osim`` file. ``model``: what it holds.
    ``q``: (n_frames, n_coordinates), rad or m, in the order of the model's coordinates.
    Raises DependencyMissing, FileUnreadable: as for reading a model.
    """
    known = np.asarray(np.isfinite(q).all(axis=1))
    columns = dict(zip(model.coordinate_names, q[known].T, strict=True))
    followed = {c.dependent: law_values(c.law, columns[c.independent]) for c in model.couplers}
    turning = [c.name for c in model.coordinates if c.kind == "rotation" and not c.locked]
    request = {
        "operation": "muscles",
        "file": model.source or None,
        "text": osim,
        "q": {name: values.tolist() for name, values in (columns | followed).items()},
        "coordinates": turning,
        "couplings": [
            [c.dependent, c.independent, law_slopes(c.law, columns[c.independent]).tolist()]
            for c in model.couplers
        ],
    }
    answer = ask(request, time_limit_s=TIME_LIMIT_S + _FRAME_S * int(known.sum()))
    muscles = tuple(answer["muscles"])
    lengths = _spread(known, np.reshape(answer["lengths"], (-1, len(muscles))))
    arms = {
        (muscle, coordinate): _spread(known, np.asarray(values))
        for muscle, coordinate, values in answer["arms"]
    }
    return MuscleGeometry(muscles, lengths, arms)


def _spread(known: NDArray[np.bool_], values: Array) -> Array:
    """Values of the known frames among all frames, NaN elsewhere."""
    full = np.full((len(known), *values.shape[1:]), np.nan)
    full[known] = values
    return full
