"""Body segment inertial parameters of published tables on the segments of the built-in models.

Every segment takes its row's share of the person's mass and scales with its own length in the model at
hand, so that a scaled model gets what the table says of a segment of that size.
"""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError
from scaling_service.core.names import say_name
from scaling_service.model import body, poses
from scaling_service.model import inertia as inertias

ROLES = {
    "pelvis": "pelvis",
    "femur": "thigh",
    "tibia": "shank",
    "calcn": "foot",
    "abdomen": "abdomen",
    "torso": "thorax",
    "head": "head_neck",
    "humerus": "upper_arm",
    "ulna": "forearm",
    "hand": "hand",
}
"""The built-in models' segments, without their side, as tables call them."""

WHOLE_BODY = frozenset(ROLES)
"""Segments that make a whole person, without their side."""

HEIGHTS_M = (1.0, 2.3)
"""Statures that tables of adults may be applied to (chosen)."""

ROUNDING = 1e-12
"""Negative share of the largest second moment that is only rounding (chosen: thousands of roundings)."""

MASSES_KG = (20.0, 250.0)
"""Masses that tables of adults may be applied to (chosen)."""


NO_SEX = "the person's sex is not given: the inertia is the mean of women's and men's"

CENTRES = {
    "HJC": "femur",
    "KJC": "tibia",
    "AJC": "calcn",
    "SJC": "humerus",
    "EJC": "ulna",
    "WJC": "hand",
    "LJC": "abdomen",
    "TJC": "torso",
    "CJC": "head",
}
"""Joint centre to the segment whose origin it is."""

MARKERS = {"AJC": ("AJC",), "MHC": ("MH2", "MH5"), "MTC": ("MT1", "MT5"), "HEEL": ("HEE",)}
"""Landmark to the markers whose middle it is, without the side's letter."""

LUMBAR = {"M": (-0.335, -0.032), "F": (-0.340, 0.049)}
"""Lumbar centre from the middle of the ASIS, x and y over the ASIS width (Reed et al. 1999, as given by Dumas
and Wojtusch 2018)."""

AHEAD = {"VERT": (0.0, 1.0, 0.0), "TTIP": (1.0, 0.0, 0.0)}
"""Ends of spans that no model has: up from the cervical centre, forward from the heel or ankle."""

TRUNK = "deleva1996"
"""The table whose proportions place xiphion and omphalion between cervical centre and mid-hip."""


@dataclass(frozen=True, slots=True)
class InertiaResult:
    """A model with the inertia of a table."""

    model: body.BodyModel
    table: str
    notes: tuple[str, ...]  # what had to be decided, in plain English


@dataclass(frozen=True, slots=True, eq=False)
class Person:
    """Whom the table is asked for."""

    sex: inertias.Sex
    height_m: float
    mass_kg: float

    def check(self) -> None:
        """Raise InputError where mass or height cannot be an adult's."""
        for value, (low, high), field, unit in (
            (self.height_m, HEIGHTS_M, "subject.height_m", "m"),
            (self.mass_kg, MASSES_KG, "subject.mass_kg", "kg"),
        ):
            if not low <= value <= high:
                raise InputError(
                    f"{value:g} {unit} is not between {low:g} and {high:g} {unit}",
                    field=field,
                    remedy="Give the person's own; inertial tables hold for adults",
                )


def apply_inertia_table(
    model: body.BodyModel, table: str, *, sex: inertias.Sex | None, height_m: float, mass_kg: float
) -> InertiaResult:
    """Give every segment the mass, centre of mass and tensor that a table says.

    ``model``: a built-in one of three dimensions, of any size. For the planar squat see ``apply_to_squat``.
    ``table``: one of ``TABLE_NAMES``.
    ``sex``: None where it is not known: the mean of what the table says of women and of men.
    ``height_m``: stature: for lengths that the model does not show (the head's, a foot's to the tip of its
        toes).
    Masses of a whole-body model sum to ``mass_kg``.
    Raises InputError: there is no such table, a segment is none that tables know, the model does not show a
        landmark, or mass or height is no adult's.

    Examples
    --------
    >>> from scaling_service.model.builtin import load_builtin
    >>> result = apply_inertia_table(
    ...     load_builtin("full_body_35dof"), "deleva1996", sex="F", height_m=1.68, mass_kg=60.0
    ... )
    >>> round(result.model.segment("femur_r").mass, 2)
    8.87
    """
    if sex is None:
        woman, man = (
            apply_inertia_table(model, table, sex=each, height_m=height_m, mass_kg=mass_kg)
            for each in get_args(inertias.Sex)
        )
        between = map(_average_segments, woman.model.segments, man.model.segments)
        said = tuple(dict.fromkeys((NO_SEX, *woman.notes, *man.notes)))
        return InertiaResult(replace(model, segments=tuple(between)), table, said)
    person = Person(sex, height_m, mass_kg)
    person.check()
    published = inertias.read_inertia_table(table)
    neutral = Neutral.of(model)
    notes = list(published.notes)
    segments = [_with_inertia(s, neutral, published, person, notes) for s in model.segments]
    segments = _sum_up_to_mass(segments, mass_kg, notes)
    return InertiaResult(replace(model, segments=tuple(segments)), table, tuple(dict.fromkeys(notes)))


def _average_segments(one: body.Segment, other: body.Segment) -> body.Segment:
    mass, com, inertia = (
        np.mean((getattr(one, name), getattr(other, name)), axis=0) for name in ("mass", "com", "inertia")
    )
    return replace(one, mass=float(mass), com=body.to_vector(com), inertia=tuple(inertia.tolist()))


def find_possible_tensor(tensor: Array) -> tuple[Array, bool]:
    """The nearest tensor that a body can have, and whether it is another one.

    ``tensor`` (3, 3): about the centre of mass.

    The second moments of the mass, ``tr(I)/2 - I``, must not be negative along any direction: this is the
    triangle inequality of the principal moments (Wensing, Kim & Slotine 2018). Negative ones become zero.
    """
    moments, axes = np.linalg.eigh(0.5 * np.trace(tensor) * np.eye(3) - tensor)
    if moments[0] >= -ROUNDING * moments[2]:
        return tensor, False
    spread = (axes * np.clip(moments, 0.0, None)) @ axes.T
    return np.trace(spread) * np.eye(3) - spread, True


@dataclass(frozen=True, slots=True, eq=False)
class _Placed:
    """A row on a segment of the model: its length, where it begins and ends (ground, neutral posture)."""

    row: inertias.InertiaRow
    length: float
    start: Array
    end: Array

    def com(self, neutral: Neutral, segment: str, side: str) -> Array | None:
        """The centre of mass in the segment's frame, m; None where the table gives none."""
        percent = self.row.com_pct
        if percent is None:
            return None
        if len(percent) == 1:
            return neutral.local(segment, self.start + percent[0] / 100.0 * (self.end - self.start))
        mirror = np.array([1.0, 1.0, -1.0 if side == "l" else 1.0])
        com: Array = neutral.local(segment, self.start) + mirror * self.length * np.array(percent) / 100.0
        return com

    def radii(self) -> Array:
        """Radii of gyration, m; NaN where the table gives none."""
        return self.length * np.array(self.row.radii_pct, dtype=float) / 100.0


def _with_inertia(
    segment: body.Segment, neutral: Neutral, table: inertias.InertiaTable, person: Person, notes: list[str]
) -> body.Segment:
    base, side = _split_side(segment.name)
    if base not in ROLES:
        raise InputError(
            f"segment '{segment.name}' is none that inertial tables know",
            field="model",
            remedy="Use a built-in model, or keep the masses of the model's own file",
        )
    role = ROLES[base]
    tables = [table, *([inertias.read_inertia_table(table.fallback)] if table.fallback else [])]
    if table.find(role, person.sex) is None and len(tables) > 1:
        tables = tables[1:]
    placed = []
    for t in tables:
        row = t.row(role, person.sex)
        near, far = row.span
        start = require_landmark(neutral, near, side, person.sex, segment.name)
        end = find_landmark(neutral, far, side, person.sex)
        if end is None and row.length_mm is not None:
            length = 1e-3 * row.length_mm * person.height_m / t.stature_m[person.sex]
            end = start + length * np.array(AHEAD.get(far, (0.0, -1.0, 0.0)))
        if end is None and row.com_pct is None:
            end = start  # the fallback gives centre and radii
        if end is None:
            end = require_landmark(neutral, far, side, person.sex, segment.name)
        if far == "HJCS":
            end = np.array([end[0], end[1], start[2]])  # projected on the sagittal plane
        placed.append(_Placed(row, float(np.linalg.norm(end - start)), start, end))
    first, last = placed[0], placed[-1]
    com = first.com(neutral, segment.name, side)
    com = last.com(neutral, segment.name, side) if com is None else com
    assert com is not None  # a fallback is complete
    radii = np.where(np.isnan(first.radii()), last.radii(), first.radii())
    mass = first.row.mass_pct / 100.0 * person.mass_kg
    products = first.length * np.array(first.row.products_pct) / 100.0
    xy, xz, yz = mass * np.sign(products) * products**2
    if side == "l":
        xz, yz = -xz, -yz
    tensor = np.diag(mass * radii**2)
    for (i, j), value in zip(((0, 1), (0, 2), (1, 2)), (xy, xz, yz), strict=True):
        tensor[i, j] = tensor[j, i] = value
    tensor, changed = find_possible_tensor(tensor)
    if changed:
        notes.append(
            f"the tensor of the {say_name(role)} breaks the triangle inequality; the nearest "
            "possible was taken"
        )
    return replace(segment, mass=mass, com=body.to_vector(com), inertia=inertias.take_six(tensor))


def _split_side(name: str) -> tuple[str, str]:
    """A segment's name without its side, and the side."""
    return (name[:-2], name[-1]) if name[-2:] in ("_r", "_l") else (name, "")


def _sum_up_to_mass(segments: list[body.Segment], mass_kg: float, notes: list[str]) -> list[body.Segment]:
    """Segments whose masses sum to the person's, where they make a whole person."""
    if {_split_side(s.name)[0] for s in segments} != WHOLE_BODY:
        left_out = 100.0 * (1.0 - sum(s.mass for s in segments) / mass_kg)
        notes.append(f"the model has no segment for {left_out:.1f} % of the person's mass")
        return segments
    factor = mass_kg / sum(s.mass for s in segments)
    if abs(factor - 1.0) > 1e-4:
        notes.append(f"masses were multiplied by {factor:.4f} to sum to the person's")
    return [
        replace(
            s, mass=factor * s.mass, inertia=inertias.take_six(factor * inertias.to_matrix(s.inertia))
        )  # radii stay
        for s in segments
    ]


@dataclass(frozen=True, slots=True, eq=False)
class Neutral:
    """A model in its neutral posture."""

    model: body.BodyModel
    frames: abc.Mapping[str, poses.Frame]

    @classmethod
    def of(cls, model: body.BodyModel) -> Neutral:
        """Pose the model, all coordinates at zero."""
        return cls(model, poses.pose_neutral_frames(model, dict.fromkeys(model.coordinate_names, 0.0)))

    def origin(self, segment: str) -> Array | None:
        """A segment's origin in ground, None if the model has no such segment."""
        return self.frames[segment][1] if segment in self.frames else None

    def marker(self, name: str) -> Array | None:
        """A marker in ground, None if the model has no such marker."""
        if name not in self.model.marker_names:
            return None
        marker = self.model.marker(name)
        rotation, origin = self.frames[marker.segment]
        return np.asarray(origin + rotation @ np.array(marker.nominal))

    def local(self, segment: str, point: Array) -> Array:
        """A point of the ground in a segment's frame, m."""
        rotation, origin = self.frames[segment]
        return np.asarray(rotation.T @ (point - origin))


def find_landmark(neutral: Neutral, name: str, side: str, sex: inertias.Sex) -> Array | None:
    """A landmark in ground, m; None where the model does not show it.

    ``name`` is what tables call it: ``HJC``, ``MTC``, ``XYPH`` and so on.
    """
    if name in CENTRES:
        for segment in (f"{CENTRES[name]}_{side}", CENTRES[name]):
            found = neutral.origin(segment)
            if found is not None:
                return found
    if name == "LJC":
        right, left = neutral.marker("RASIS"), neutral.marker("LASIS")
        if right is None or left is None:
            return None
        width = float(np.linalg.norm(right - left))
        x, y = LUMBAR[sex]
        return np.asarray(0.5 * (right + left) + width * np.array([x, y, 0.0]))
    if name in MARKERS:
        return _find_middle([neutral.marker(f"{side.upper()}{marker}") for marker in MARKERS[name]])
    if name in ("MIDH", "HJCS"):
        return _find_middle([neutral.origin(f"femur_{s}") for s in "rl"])
    if name in ("XYPH", "OMPH"):
        # Xiphion or omphalion on the line from the cervical centre to the mid-hip, by the table's lengths.
        top, bottom = find_landmark(neutral, "CJC", "", sex), find_landmark(neutral, "MIDH", "", sex)
        if top is None or bottom is None:
            return None
        table = inertias.read_inertia_table(TRUNK)
        lengths = [table.row(part, sex).length_mm or 0.0 for part in ("thorax", "abdomen", "pelvis")]
        share = sum(lengths[: 1 if name == "XYPH" else 2]) / sum(lengths)
        return np.asarray(top + share * (bottom - top))
    return None


def _find_middle(points: abc.Sequence[Array | None]) -> Array | None:
    """Mean of some points, None where one is missing."""
    known = [p for p in points if p is not None]
    return np.asarray(np.mean(known, axis=0)) if len(known) == len(points) else None


def require_landmark(neutral: Neutral, name: str, side: str, sex: inertias.Sex, segment: str) -> Array:
    """A landmark that must be known.

    InputError: the model does not show it.
    """
    found = find_landmark(neutral, name, side, sex)
    if found is None:
        raise InputError(
            f"model '{neutral.model.name}' does not show the landmark {name} of segment '{segment}'",
            field="inertia",
            remedy="Use another inertial table, or a model with feet and trunk",
        )
    return found
