"""How far soft tissue lets markers stray, and what drives it.

A marker's displacement in its segment follows the angles of the joints at the segment's ends (Camomilla et
al. 2013, Bonci et al. 2014). It says the same in every repetition, so it does not average out: it is
estimated with the motion, with the artefact that literature expects as its prior. What it costs the markers
is told to the balance.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from scaling_service.model.anatomy.markers import canonical
from scaling_service.model.body import GROUND, BodyModel, Joint, Segment
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.marker_rates import MarkerShifts
from scaling_service.numerics.signals.splines import SplineBasis

ARTEFACT_M: Mapping[str, float] = {
    "toe": 0.001,
    "ankle": 0.010,
    "shank": 0.015,
    "knee": 0.030,
    "pelvis": 0.017,
    "T10": 0.0107,
    "sternum": 0.015,
    "acromion": 0.010,
}
"""Futamure et al., table 1, m."""

_OF_MARKERS: Mapping[str, str] = {
    name: row
    for row, names in {
        "toe": "TOE",
        "ankle": "ANK RLM RMM",
        "knee": "KNE RLFE RMFE",
        "T10": "C7 T10",
        "sternum": "CLAV STRN RSC",
        "acromion": "SHO RSHO",
    }.items()
    for name in names.split()
}
"""Rows for markers by name. C7 and CLAV are not in the table: chosen as the nearest site."""

_OF_SEGMENTS: Mapping[str, tuple[str, ...]] = {
    "pelvis": ("pelvis",),
    "knee": ("femur", "thigh"),
    "shank": ("tibia", "shank"),
    "ankle": ("talus", "calcn", "foot", "toes"),
    "acromion": ("head", "humerus", "ulna", "radius", "hand", "arm"),
}
"""Rows for all other markers, by how their segment's name begins. Chosen: thighs as the knee, the largest;
feet as the ankle (the table's toe is that of a foot that cannot move), head and arms as the acromion."""

_ELSE = "sternum"
"""Any other segment is a part of the trunk."""

FULL_RAD = np.radians(45.0)
"""Range of the angles from which on the whole artefact is expected (chosen: that of table 1 is of large
movements; below, it grows with the angle)."""


def artefact_m(model: BodyModel) -> dict[str, float]:
    """The expected error of every marker of a model, m."""
    still = {s.name for s in model.segments if s.parent == GROUND and not any(map(_moves, s.joints))}
    found = {}
    for marker in model.markers:
        row = _OF_MARKERS.get(_right(marker.name))
        if row is None or (row == "toe" and marker.segment not in still):
            row = next((r for r, starts in _OF_SEGMENTS.items() if marker.segment.startswith(starts)), _ELSE)
        found[marker.name] = ARTEFACT_M[row]
    return found


def _right(name: str) -> str:
    """The landmark's name on the right-hand side."""
    known = canonical(name) or name
    mirrored = f"R{known[1:]}"
    return mirrored if known.startswith("L") and mirrored in _OF_MARKERS else known


def _moves(joint: Joint) -> bool:
    return any(term.coordinate is not None for term in joint.law.terms)


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

    The motion ``q`` (n, n_coordinates), as far as it is known, drives the skin along the local ``axes``.
    ``placed_m`` is the standard deviation of what is wrong with a marker's place on its segment; where zero,
    there are no constant shifts.
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
