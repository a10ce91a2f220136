"""How skin glides with a movement: what drives it, and how far it may go.

A marker's displacement in its segment follows the angles of the joints at the segment's ends (Camomilla et
al. 2013, Bonci et al. 2014). It says the same in every repetition, so it does not average out: it is
estimated with the motion, with the artefact that literature expects as its prior. What it costs the markers
is told to the balance.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from scaling_service.model.body import GROUND, BodyModel, Segment
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.marker_shifts import MarkerShifts
from scaling_service.numerics.signals.splines import SplineBasis

FULL_RAD = np.radians(45.0)
"""Range of the angles from which on the whole artefact is expected (chosen: that of table 1 is of large
movements;
below, it grows with the angle)."""


def artefact_shifts(
    model: BodyModel,
    names: tuple[str, ...],
    q: Array,
    basis: SplineBasis,
    expected_m: Mapping[str, float],
    *,
    axes: tuple[int, ...],
    placed_m: float,
) -> MarkerShifts:
    """Shared shifts of all markers: one that follows the joints at the segment's ends, and a constant one.

    Parameters
    ----------
    model : BodyModel
    names : tuple of str
        Markers in the order of the tree.
    q : ndarray, shape (n, n_coordinates), rad or m
        The motion as far as it is known: it drives the skin.
    basis : SplineBasis
        Over the same times.
    expected_m : mapping
        Marker to its artefact.
    axes : tuple of int
        Local axes along which markers may shift.
    placed_m : float
        Standard deviation of what is wrong with a marker's place on its segment, m. Zero: no constant shifts.
    """
    driven = {s.name: _driver(model, s, q) for s in model.segments}
    moving = {name: k for k, name in enumerate(n for n, way in driven.items() if way is not None)}
    rows: list[tuple[int, int, int, float]] = []
    for k, name in enumerate(names):
        signal, expected = moving.get(model.marker(name).segment), expected_m[name]
        if signal is not None:
            rows += [(k, axis, 1 + signal, expected) for axis in axes]
            rows += [(k, axis, 0, min(placed_m, expected)) for axis in axes if placed_m > 0.0]
    columns = np.stack([np.ones(len(q)), *(way for way in driven.values() if way is not None)], axis=1)
    signals = np.stack(basis.evaluate(basis.fit(columns)))
    table = np.array(rows, dtype=float).reshape(-1, 4)
    marker, axis, which = (table[:, i].astype(np.intp) for i in range(3))
    return MarkerShifts(marker, axis, which, table[:, 3], signals)


def _driver(model: BodyModel, segment: Segment, q: Array) -> Array | None:
    """First principal component of the angles at a segment's ends, of range one or less, (n,)."""
    joints = [
        *(segment.joints if segment.parent != GROUND else ()),
        *(j for c in model.children(segment.name) for j in c.joints),
    ]
    names = {
        t.coordinate for j in joints if j.kind == "rotation" for t in j.law.terms if t.coordinate is not None
    }
    rows = [k for k, c in enumerate(model.coordinates) if c.name in names and c.kind == "rotation"]
    angles = q[:, rows] - q[:, rows].mean(axis=0)
    if not rows or not np.ptp(angles, axis=0).max() > 0:
        return None
    score = angles @ np.linalg.svd(angles, full_matrices=False)[2][0]
    return np.asarray(score / max(float(np.ptp(score)), FULL_RAD))
