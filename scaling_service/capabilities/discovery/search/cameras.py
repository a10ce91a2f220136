"""Cameras whose readings of places are off as no fault of the catalogue has it: as an instrument's may be.

They may stretch the volume, bend it as lenses do, and take its parts one after the other, in all recordings:
they are one instrument. What fits such cameras best says where the fault is, not what it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column, Part
from scaling_service.capabilities.discovery.laws.spots import LETTERS, FieldSpot
from scaling_service.capabilities.discovery.observations.tracked import MotionFit
from scaling_service.core.arrays import Array

OFF_M, LATE_S = 0.005, 0.005
"""SD, of each term at the reach of what was measured (chosen: a calibration that failed)."""

EVERYDAY = 0.3  # of these, what every volume is off by (chosen: 1.5 mm, and a tenth of a frame or so)
_DEGREES = 3  # of polynomials: to the third, as the first term of a lens (Brown 1971)
_POWERS = range(_DEGREES + 1)
_TERMS = tuple((i, j, k) for i, j, k in product(_POWERS, _POWERS, _POWERS) if 0 < i + j + k <= _DEGREES)


def propose_cameras(tracked: Sequence[MotionFit]) -> Iterator[tuple[Candidate, Array]]:
    """Cameras that misread, in each way, with the deviations of its numbers."""
    places = np.concatenate([item.task.measured.reshape(-1, 3) for item in tracked])
    places = places[np.isfinite(places).all(axis=1)]
    middle, reach = places.mean(axis=0), 2.0 * math.sqrt(places.var(axis=0).mean())
    of = (tuple(middle.tolist()), max(reach, np.finfo(float).tiny))
    first = [p for p in _TERMS if sum(p) == 1]
    bent = [FieldSpot(p, *of, axis=axis) for p in _TERMS for axis in range(3)]
    yield _make("stretched", [spot for spot in bent if sum(spot.powers) == 1], OFF_M)
    yield _make("bent", bent, OFF_M)
    yield _make("late", [FieldSpot(p, *of, late=True) for p in first], LATE_S)


def _make(note: str, spots: Sequence[FieldSpot], sd: float) -> tuple[Candidate, Array]:
    columns = tuple(Column(str(k), 1.0, parts=(Part(spot),)) for k, spot in enumerate(spots))
    return Candidate("camera_readings", ("markers",), columns, note=note), np.full(len(spots), sd)


def describe_cameras(candidate: Candidate, size: Array) -> str:
    """The largest number of it."""
    if not len(size):
        return "the volume's size comes and goes"
    k = int(np.abs(size).argmax())
    spot = candidate.columns[k].parts[0].spot
    assert isinstance(spot, FieldSpot)
    along = LETTERS[int(np.argmax(spot.powers))]
    if spot.late:
        late_ms = 1e3 * size[k] / spot.reach
        when = "later" if late_ms > 0.0 else "earlier"
        return f"they come {abs(late_ms):.1f} ms {when} for each metre along {along}"
    if sum(spot.powers) == 1:
        return f"{LETTERS[spot.axis]} is off by {size[k] / spot.reach:+.1%} of {along}"
    return f"{LETTERS[spot.axis]} is off by {1e3 * abs(size[k]):.0f} mm at {spot.reach:.1f} m, as by a lens"
