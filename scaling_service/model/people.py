"""What is ordinary in people: hips, knees, palpation and skin (``reference_models/people.yaml``).

These sizes are the prior of estimates of a person. None is set by looking at recordings that it is proved on.
SI and radians.
"""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from scipy.special import chdtri, fdtri

from scaling_service.core.arrays import Array
from scaling_service.model import body, reference

_TRUNK = "torso"


@dataclass(frozen=True, slots=True)
class SkinSize:
    """Standard deviations of skin over a bone in an ordinary movement.

    ``shift`` m and ``turn`` rad: of a segment's markers together, along and about each axis. ``single`` m: of
    each marker beside that. ``flexion_alone``: it follows angles about mediolateral axes and no others.
    """

    shift: float
    turn: float
    single: float
    flexion_alone: bool = False

    def covariance(self, places: Array, besides: Array | float = 0.0) -> Array:
        """Of the displacements of markers on one segment.

        ``places`` (m, 3): in the segment's frame, m. ``besides`` (m,): what a marker moves by itself beyond
        ``single``, m, as skin does over the end of a bone. Returns (3 m, 3 m), m2: marker by marker, x, y, z.

        Examples
        --------
        >>> SkinSize(shift=0.003, turn=0.0, single=0.004).covariance(np.zeros((1, 3)))[0, 0].round(9)
        np.float64(2.5e-05)
        """
        x, y, z = (places - places.mean(axis=0)).T
        none = np.zeros(len(places))
        turning = np.array(
            [[none, z, -y], [-z, none, x], [y, -x, none]]
        )  # of a turn: its product with the arm
        by_turn = turning.transpose(2, 0, 1).reshape(-1, 3)
        alike = np.tile(np.eye(3), (len(places), 1))
        together = self.shift**2 * alike @ alike.T + self.turn**2 * by_turn @ by_turn.T
        alone = np.broadcast_to(self.single**2 + np.square(besides), len(places))
        return np.asarray(together + np.diag(np.repeat(alone, 3)))

    def times(self, factor: float) -> SkinSize:
        """The same, larger or smaller."""
        return replace(self, shift=factor * self.shift, turn=factor * self.turn, single=factor * self.single)


@dataclass(frozen=True, slots=True, kw_only=True)
class Opposite:
    """Two landmarks at opposite ends of a joint: ``sd`` (m) is what they share with opposite signs.

    ``width``: the size measured by hand, or foreseen by anthropometry, that is their distance over the skin.
    """

    ends: tuple[str, str]
    sd: body.Vector
    width: str


@dataclass(frozen=True, slots=True, kw_only=True)
class People:
    """The table; landmarks are named without side."""

    hip_regressions: tuple[str, ...]
    hip_sd: body.Vector  # m
    hip_sides: float
    skin_over_asis: tuple[float, float]  # mean and SD, m, forward
    skin_over_psis: tuple[float, float]  # mean and SD, m, backward
    knee_axis_sd: float  # rad
    palpation: abc.Mapping[str, body.Vector]  # m
    palpation_other: body.Vector  # m
    opposite: tuple[Opposite, ...]
    skin_rows: tuple[tuple[tuple[str, ...], SkinSize], ...]
    skin_other: SkinSize
    skin_at_joints: abc.Mapping[str, float]  # m
    skin_on_trunk: abc.Mapping[str, float]  # m
    image_hip: float  # m
    image_centre: float  # m
    image_axis_sd: float  # rad
    image_marker: float  # m
    landmark_points: abc.Mapping[str, float]  # of bones, without side; m, root mean square distance in space
    landmark_axes: abc.Mapping[str, float]  # rad
    reach_mediolateral: float  # rad
    reach_other: float  # rad
    recorded_share: float
    loose_share: float
    loose_s: float
    noise: float  # m

    def skin(self, segment: str) -> SkinSize:
        """Sizes over a segment of this name."""
        name = segment.lower()
        return next((size for names, size in self.skin_rows if name.startswith(names)), self.skin_other)

    def with_skin(self, level: float) -> People:
        """The same people with all of skin's movement larger or smaller."""
        rows = tuple((names, size.times(level)) for names, size in self.skin_rows)
        return replace(
            self,
            skin_rows=rows,
            skin_other=self.skin_other.times(level),
            skin_at_joints={name: level * size for name, size in self.skin_at_joints.items()},
            skin_on_trunk={name: level * size for name, size in self.skin_on_trunk.items()},
        )

    def skin_covariance(
        self, segment: str, landmarks: abc.Sequence[str | None], places: Array, share: float = 1.0
    ) -> Array:
        """Of the displacements of one segment's markers, (3 m, 3 m), m2: marker by marker, x, y, z.

        ``landmarks``: what each marker marks, with its side; None: no landmark. ``places`` (m, 3): in
        the segment's frame, m. ``share``: of the sizes.
        """
        size = self.skin(segment)
        at_joints = [
            self.girdle_sd(segment, name) or self.skin_at_joints.get((name or "")[1:], 0.0)
            for name in landmarks
        ]
        besides = share * np.sqrt(np.maximum(np.square(at_joints) - size.single**2, 0.0))
        return size.times(share).covariance(places, np.where(at_joints, besides, 0.0))

    def girdle_sd(self, segment: str, landmark: str | None) -> float:
        """How far a marker on a trunk moves with the shoulder girdle or neck that the trunk lacks, SD, m.

        ``landmark``: with its side; None: no landmark. 0 for what sits on the trunk itself.

        Examples
        --------
        >>> [read_people().girdle_sd(bone, "RSHO") for bone in ("torso", "scapula_r")]
        [0.025, 0.0]
        """
        if landmark is None or self.skin(segment) != self.skin(_TRUNK):
            return 0.0
        return self.skin_on_trunk.get(landmark[landmark.startswith(("R", "L")) :], 0.0)

    def place_sd(self, landmark: str) -> body.Vector:
        """Standard deviation of a marker's place, m, along each axis of its segment.

        ``landmark``: without side.
        """
        return self.palpation.get(landmark, self.palpation_other)


@cache
def read_people() -> People:
    """The table of ``reference_models/people.yaml``.

    Examples
    --------
    >>> read_people().skin("femur_r").shift
    0.006
    """
    table: abc.Mapping[str, Any] = reference.read_reference(reference.find_reference_folder() / "people.yaml")
    hip, spines, skin, image = (table[name] for name in ("hip", "skin_over_spines", "skin", "image"))
    return People(
        hip_regressions=tuple(hip["regressions"]),
        hip_sd=_metres(hip["sd_mm"]),
        hip_sides=float(hip["sides"]),
        skin_over_asis=(1e-3 * spines["asis_mm"][0], 1e-3 * spines["asis_mm"][1]),
        skin_over_psis=(1e-3 * spines["psis_mm"][0], 1e-3 * spines["psis_mm"][1]),
        knee_axis_sd=float(np.radians(table["knee_axis"]["sd_deg"])),
        palpation={name: _metres(sd) for name, sd in table["palpation"]["landmarks_mm"].items()},
        palpation_other=_metres(table["palpation"]["other_mm"]),
        opposite=tuple(
            Opposite(ends=(row["ends"][0], row["ends"][1]), sd=_metres(row["mm"]), width=row["width"])
            for row in table["opposite"]
        ),
        skin_rows=tuple((tuple(row["names"]), _read_skin(row)) for row in skin["segments"]),
        skin_other=_read_skin(skin["other"]),
        skin_at_joints=_read_singles(skin["at_joints"]),
        skin_on_trunk=_read_singles(skin["on_trunk"]),
        image_hip=1e-3 * float(image["hip_mm"]),
        image_centre=1e-3 * float(image["centre_mm"]),
        image_axis_sd=float(np.radians(image["axis_deg"])),
        image_marker=1e-3 * float(image["marker_mm"]),
        landmark_points={n: 1e-3 * _predict(row, 3) for n, row in table["landmarks"]["points_mm"].items()},
        landmark_axes={n: np.radians(_predict(row, 2)) for n, row in table["landmarks"]["axes_deg"].items()},
        reach_mediolateral=float(np.radians(skin["reach_deg"]["mediolateral"])),
        reach_other=float(np.radians(skin["reach_deg"]["other"])),
        recorded_share=float(skin["recorded_share"]),
        loose_share=float(skin["loose_share"]),
        loose_s=float(skin["loose_s"]),
        noise=1e-3 * float(skin["noise_mm"]),
    )


def predict_difference(raters: float, persons: float, seen: abc.Sequence[float], axes: int) -> float:
    """The root mean square by which 95 of 100 differences of another person are held, as of Gaussian errors.

    Few persons tell a variance badly: their difference from a new one is Student's t in ``axes`` directions
    alike, with as many degrees of freedom for each person, which is wider than the Gaussian of its scale.

    ``raters``: root mean square by the literature, which counts as so many ``persons``. ``seen``: of persons
    at hand, each. ``axes``: 3 of a point, 2 of a direction.

    Examples
    --------
    >>> round(predict_difference(3.0, 1.0, [3.0, 3.0], 3), 2), round(predict_difference(3.0, 1e6, [], 3), 2)
    (3.65, 3.0)
    """
    count = persons + len(seen)
    square = (persons * raters**2 + float(np.sum(np.square(seen)))) / count
    gaussian = chdtri(axes, 0.05) / axes
    return float(np.sqrt(square * fdtri(axes, axes * count, 0.95) / gaussian))


def _predict(row: abc.Mapping[str, Any], axes: int) -> float:
    """Of a row of ``landmarks``; what raters say where no person was seen."""
    if "seen" not in row:
        return float(row["raters"])
    seen = [float(size) for size in row["seen"] if size is not None]
    return predict_difference(row["raters"], row["persons"], seen, axes)


def _metres(millimetres: Any) -> body.Vector:
    return body.to_vector(round(1e-3 * float(value), 9) for value in millimetres)


def _read_singles(table: abc.Mapping[str, Any]) -> dict[str, float]:
    return {name: round(1e-3 * size, 9) for name, size in table["single_mm"].items()}


def _read_skin(row: abc.Mapping[str, Any]) -> SkinSize:
    return SkinSize(
        shift=round(1e-3 * row["shift_mm"], 9),
        turn=float(np.radians(row["turn_deg"])),
        single=round(1e-3 * row["single_mm"], 9),
        flexion_alone=bool(row.get("flexion_alone", False)),
    )
