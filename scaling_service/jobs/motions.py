"""Motions as OpenSim files, with the coordinates that follow others written out."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scaling_service.formats.osim.shapes import values
from scaling_service.formats.sto import motion_table, write_sto
from scaling_service.models.body import BodyModel, Coupler, Law
from scaling_service.models.results import Array, Motion


def write_motion(path: Path, motion: Motion, model: BodyModel) -> None:
    """Write a motion as ``.mot``: degrees and m, dependent coordinates after the independent ones.

    A dependent coordinate is of OpenSim's motion type "coupled": it stays in radians where the file
    is in degrees.

    Parameters
    ----------
    path : Path
    motion : Motion
        Coordinates that a frame does not determine are NaN, and are written so.
    model : BodyModel
        Says which coordinates turn, and which follow others.
    """
    names = [*motion.coordinates, *(c.dependent for c in model.couplers)]
    kinds = [model.coordinate(name).kind for name in motion.coordinates]
    kinds += ["translation" for _ in model.couplers]  # OpenSim reads what follows as it is, never in degrees
    q = np.column_stack([motion.q, *(_followed(coupler, motion) for coupler in model.couplers)])
    write_sto(path, motion_table(motion.trial, motion.times, names, kinds, q))


def _followed(coupler: Coupler, motion: Motion) -> Array:
    x = motion.q[:, motion.coordinates.index(coupler.independent)]
    return law_values(coupler.law, x)


def law_values(law: Law, x: Array) -> Array:
    """A law of one coordinate at all its values, (n_frames,).

    Raises
    ------
    ValueError
        The law holds a parameter or a signal.
    """
    total = np.zeros_like(x)
    for term in law.terms:
        if term.parameter is not None or term.signal is not None:
            raise ValueError("a coordinate follows another one only")
        if term.coordinate is None:
            total += term.gain
        else:
            total += term.gain * (x if term.shape is None else values(term.shape, x))
    return total
