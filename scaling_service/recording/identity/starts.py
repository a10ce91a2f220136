"""Upright bodies over the points of a standing person, whatever way they face and however tall."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy

from scaling_service.core.arrays import Array
from scaling_service.model.compile import compile_model, list_parameter_values, repeat_default_pose
from scaling_service.numerics.multibody.rigid import rotate_about
from scaling_service.numerics.multibody.tree import pose_markers
from scaling_service.recording.identity import landmarks

_HEADINGS = np.radians(np.arange(0.0, 360.0, 45.0))
_COARSE_M = (0.15, 0.12, 0.10, 0.08)  # chosen: half of how far label and landmark may be apart, by round
FIRST_M = 0.08  # the same of the first round that bends limbs, too
_UNPLACED_M = 0.08  # chosen: a label at no landmark costs as much as one so far from it
_TOPS = (1.05, 1.22, 1.75, 1.92)
"""Stature over the height of all markers: the highest is on the head, a shoulder or an iliac crest, or they
go from spines to malleoli (Winter 2009: .82, .57 and .57 less .05 of stature)."""
_STATURES_M = (0.95, 2.15)  # of people who walk: ANSUR II and children from three years on
RARE_M = 0.04  # chosen: the landmarks that only some laboratories mark count as so much farther away
_ANKLES = 0.045  # of stature: malleoli above the floor, where feet have no markers (ANSUR II)
FEWEST = 6  # labels with which a body can be placed


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Start:
    """An upright body at one heading: its places (n_landmarks, 3), and how badly it suits (m2)."""

    stature: float
    heading: float
    origin: Array
    cost: float

    def resembles(self, other: Start) -> bool:
        """Whether another start is the same one over again."""
        level = abs(self.origin[1] - other.origin[1]) < _ANKLES * self.stature / 2.0
        turned = np.cos(self.heading - other.heading) < 0.5
        return bool(level and not turned and abs(self.stature / other.stature - 1.0) < 0.08)


def place_rigidly(at: Array, stature: float | None, fixed: abc.Mapping[int, str]) -> abc.Iterator[Start]:
    """The upright body at every heading, each moved and turned over the points nearest to it."""
    body = landmarks.read_body()
    names = list(body.marker_names)
    rise = float(np.ptp(at[:, 1]))
    tree = compile_model(body, names)
    upright = pose_markers(tree, repeat_default_pose(body, 1), list_parameter_values(body))[0]
    low, high = _STATURES_M
    guesses = [top * rise for top in _TOPS if low < top * rise < high]
    for height in guesses if stature is None else [stature]:
        sized = height / landmarks.STATURE_M * upright
        for heading, sunk in product(_HEADINGS, (0.0, _ANKLES * height)):
            turn = rotate_about((0.0, 1.0, 0.0), float(heading))
            middle = np.array([np.median(at[:, 0]), at[:, 1].min() - sunk, np.median(at[:, 2])])
            base = sized @ turn.T
            shift = middle - [base[:, 0].mean(), base[:, 1].min(), base[:, 2].mean()]
            angle, places = float(heading), base + shift
            for reach in _COARSE_M:
                pairs = assign(at, places, names, 2.0 * reach, fixed)
                if len(pairs) < FEWEST:
                    break
                rows, columns = map(list, zip(*pairs, strict=True))
                model, seen = places[columns], at[rows]
                a, b = model - model.mean(axis=0), seen - seen.mean(axis=0)
                more = np.arctan2(
                    (a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]).sum(), (a[:, ::2] * b[:, ::2]).sum()
                )
                rotation = rotate_about((0.0, 1.0, 0.0), float(more))
                places = (places - model.mean(axis=0)) @ rotation.T + seen.mean(axis=0)
                angle += float(more)
            turn = rotate_about((0.0, 1.0, 0.0), angle)
            yield Start(
                stature=float(height),
                heading=angle,
                origin=places[0] - turn @ sized[0],
                cost=measure_misfit(at, places, assign(at, places, names, 2.0 * FIRST_M, fixed)),
            )


def assign(
    at: Array,
    places: Array,
    names: list[str],
    reach: float,
    fixed: abc.Mapping[int, str],
    rare: float = RARE_M,
) -> list[tuple[int, int]]:
    """Labels and landmarks nearest to each other, (label, landmark), none farther apart than ``reach``.

    Landmarks choose among the labels, so that it takes no longer than there are labels: Kuhn and Munkres'
    method goes over the longer side once for each entry of the shorter one (Crouse 2016).
    """
    squared = np.nan_to_num(((places[:, None] - at[None]) ** 2).sum(axis=2), nan=np.inf)
    squared = squared + np.array([rare**2 if name[1:] in landmarks.MORE else 0.0 for name in names])[:, None]
    alone = reach**2
    for column, name in fixed.items():
        row = names.index(name)
        squared[row], squared[:, column] = np.inf, np.inf
        squared[row, column] = 0.0
    costs = np.hstack([np.minimum(squared, 1e3), np.full((len(names), len(names)), alone)])
    rows, columns = scipy.optimize.linear_sum_assignment(costs)
    return sorted(
        (int(c), int(r)) for r, c in zip(rows, columns, strict=True) if c < len(at) and squared[r, c] < alone
    )


def measure_misfit(at: Array, places: Array, pairs: list[tuple[int, int]]) -> float:
    """Squared distances of the pairs, and as much for every label without one as one that is far, m2."""
    gaps = sum(min(float(((at[r] - places[c]) ** 2).sum()), _UNPLACED_M**2) for r, c in pairs)
    return gaps + _UNPLACED_M**2 * (len(at) - len(pairs))
