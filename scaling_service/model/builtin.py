"""The body models that come with the product, by name, and the short form in which they are written down.

Their numbers, each with its source, are in the data folder ``reference_models``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal

from scaling_service.core.errors import InputError
from scaling_service.model.body import (
    GROUND,
    BodyModel,
    Coordinate,
    Joint,
    Law,
    Marker,
    Segment,
    Tensor,
    Vector,
    tensor,
    vector,
)
from scaling_service.model.inertia import inertia_table
from scaling_service.model.reference import read_reference, reference_folder

BUILTIN_NAMES: tuple[str, ...] = (
    "lower_limb_14dof",
    "lower_limb_feet_18dof",
    "full_body_35dof",
    "squat_4dof",
)
"""Puchaud 2019 (section 2.2.1), the same with feet, Muller 2017 (section 2.3) and Futamure (section II.A)."""


def builtin(name: str) -> BodyModel:
    """A built-in generic model.

    ``name``: one of ``BUILTIN_NAMES``.
    Raises InputError: if there is no such model; the names are listed.

    Examples
    --------
    >>> builtin("lower_limb_14dof").segment_names
    ('pelvis', 'femur_r', 'tibia_r', 'femur_l', 'tibia_l')
    """
    return _load(_known(name))[0]


def generic_person(name: str) -> GenericPerson:
    """The stature, mass and sex that a built-in model's numbers belong to; errors as :func:`builtin`."""
    return _load(_known(name))[1]


def _known(name: str) -> str:
    if name not in BUILTIN_NAMES:
        raise InputError(
            f"there is no built-in model '{name}'",
            field="model",
            remedy=f"Use one of {', '.join(BUILTIN_NAMES)}, or the path of an .osim file",
        )
    return name


@lru_cache(maxsize=16)
def _load(name: str) -> tuple[BodyModel, GenericPerson]:
    document = _read(name)
    base = document.get("extends")
    return expand(document, file=f"{name}.yaml", base=_load(_known(base)) if base else None)


def _read(name: str) -> dict[str, Any]:
    document = read_reference(reference_folder() / f"{name}.yaml")
    if not isinstance(document, dict):
        raise InputError("the model is not a mapping", file=f"{name}.yaml", remedy="Reinstall the package")
    return document


_AXES: dict[str, Vector] = {
    sign + name: (factor * x, factor * y, factor * z)
    for sign, factor in (("", 1.0), ("-", -1.0))
    for name, (x, y, z) in {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}.items()
}


@dataclass(frozen=True, slots=True)
class GenericPerson:
    """Whom a generic model depicts: m, kg."""

    sex: Literal["F", "M"]
    height_m: float
    mass_kg: float


@dataclass(frozen=True, slots=True)
class _Reader:
    """Takes keys out of a mapping and complains about those that are missing or left."""

    file: str
    field: str
    content: dict[str, Any]

    def error(self, problem: str, remedy: str) -> InputError:
        return InputError(problem, file=self.file, field=self.field, remedy=remedy)

    def need(self, key: str) -> Any:
        if key not in self.content:
            raise self.error(f"'{key}' is missing", f"Add '{key}'")
        return self.content.pop(key)

    def maybe(self, key: str, default: Any = None) -> Any:
        return self.content.pop(key, default)

    def sub(self, key: str) -> _Reader:
        return _Reader(self.file, f"{self.field}.{key}", dict(self.need(key)))

    def vector(self, key: str) -> Vector:
        return vector(self.need(key))

    def done(self) -> None:
        if self.content:
            raise self.error(f"unknown key '{next(iter(self.content))}'", "Remove it or correct its spelling")


def expand(
    document: Mapping[str, Any], *, file: str, base: tuple[BodyModel, GenericPerson] | None = None
) -> tuple[BodyModel, GenericPerson]:
    """The body model that a compact document describes, and whom it depicts.

    Its keys are told in ``reference_models/README.md``. Only the midline and the right side are written down:
    an entry with ``mirrored: true`` also gives the left one (``_r`` to ``_l``, leading ``R`` to ``L``, z
    negated, turns about x and y reversed), so that both sides carry the same clinical signs. Of ``base``, the
    model that ``extends`` names, segments, coordinates and markers come first; its landmarks (markers of
    weight zero) are not taken over. A missing or unknown key is an InputError that names ``file``.
    """
    top = _Reader(file, "document", dict(document))
    name, source = str(top.need("name")), str(top.need("source"))
    top.maybe("extends")
    person = _person(top.sub("person"))
    if base is not None and base[1] != person:
        raise top.error("the extended model depicts another person", "Give both the same `person`")
    segments, coordinates, markers = _start(base[0] if base else None)
    left: list[Segment] = []
    left_coordinates: list[Coordinate] = []
    for entry in top.need("segments"):
        segment, moved, mirrored = _segment(_Reader(file, "segments", dict(entry)), person)
        segments.append(segment)
        coordinates += moved
        if mirrored:
            left.append(_mirror_segment(segment))
            left_coordinates += [replace(c, name=_left(c.name)) for c in moved]
    for key, weight in (("markers", 1.0), ("landmarks", 0.0)):
        for entry in top.maybe(key, []):
            markers += _markers(_Reader(file, key, dict(entry)), weight)
    top.done()
    everything = (*segments, *left), (*coordinates, *left_coordinates), tuple(markers)
    return BodyModel(name, *everything, source=source), person


def _start(base: BodyModel | None) -> tuple[list[Segment], list[Coordinate], list[Marker]]:
    if base is None:
        return [], [], []
    return list(base.segments), list(base.coordinates), [m for m in base.markers if m.weight > 0.0]


def _person(reader: _Reader) -> GenericPerson:
    reader.need("source")
    person = GenericPerson(reader.need("sex"), float(reader.need("height_m")), float(reader.need("mass_kg")))
    reader.done()
    return person


def _segment(reader: _Reader, person: GenericPerson) -> tuple[Segment, list[Coordinate], bool]:
    name, parent, joint_name = (str(reader.need(key)) for key in ("name", "parent", "joint"))
    reader = replace(reader, field=f"segments.{name}")
    mirrored = bool(reader.maybe("mirrored", False))
    joints: list[Joint] = []
    if "centre" in reader.content:
        centre = reader.sub("centre")
        joints += _offset(centre.vector("at"), parent)
        centre.need("source")
        centre.done()
    coordinates: list[Coordinate] = []
    for entry in reader.maybe("moves", []):
        joint, coordinate = _move(_Reader(reader.file, f"{reader.field}.moves", dict(entry)))
        joints.append(joint)
        coordinates += [coordinate] if coordinate else []
    mass, com, inertia = _inertia(reader.sub("inertia"), person)
    reader.done()
    return Segment(name, parent, joint_name, tuple(joints), mass, com, inertia), coordinates, mirrored


def _offset(at: Vector, parent: str) -> list[Joint]:
    """Three translations in the parent's frame; zeros stay, so that a centre can be moved in place."""
    scales_with = None if parent == GROUND else parent
    return [
        Joint("translation", _AXES[axis], Law.constant(value), scales_with)
        for axis, value in zip("XYZ", at, strict=True)
    ]


def _move(reader: _Reader) -> tuple[Joint, Coordinate | None]:
    kind: Literal["rotation", "translation"] = "rotation" if "about" in reader.content else "translation"
    axis = _AXES[str(reader.need("about" if kind == "rotation" else "along"))]
    if "angle_deg" in reader.content:
        reader.need("source")
        turn = Joint(kind, axis, Law.constant(math.radians(reader.need("angle_deg"))))
        reader.done()
        return turn, None
    name = str(reader.need("coordinate"))
    unit, factor = ("deg", math.pi / 180.0) if kind == "rotation" else ("m", 1.0)
    default = factor * float(reader.maybe(f"default_{unit}", 0.0))
    lower, upper = (factor * float(v) for v in reader.maybe(f"range_{unit}", (-math.inf, math.inf)))
    reader.done()
    return Joint(kind, axis, Law.of(name)), Coordinate(name, kind, default, lower, upper)


def _inertia(reader: _Reader, person: GenericPerson) -> tuple[float, Vector, Tensor]:
    """Mass, centre of mass and tensor from percentages, written down or of a published table.

    Tables give the mass in % of the body's, the centre of mass in % of a length L from an origin,
    and the tensor as radii r in % of L: ``I = m (r L)^2``, with the sign of a product kept apart
    (Dumas et al. 2007, tables 1 and 2, where a negative product is an imaginary radius).
    """
    length = float(reader.need("length"))
    origin = reader.vector("from") if "from" in reader.content else (0.0, 0.0, 0.0)
    if "table" in reader.content:
        row = inertia_table(str(reader.need("table"))).row(str(reader.need("row")), person.sex)
        mass_pct, com_pct = row.mass_pct, vector(row.com_pct or ())
        radii = (*vector([r or 0.0 for r in row.radii_pct]), *row.products_pct)
    else:
        mass_pct, com_pct = float(reader.need("mass_pct")), reader.vector("com_pct")
        radii = (*reader.vector("radii_pct"), *reader.vector("products_pct"))
    mass = person.mass_kg * mass_pct / 100.0
    com = tuple(o + length * c / 100.0 for o, c in zip(origin, com_pct, strict=True))
    moments = [math.copysign(mass * (r * length / 100.0) ** 2, r) if r else 0.0 for r in radii]
    reader.need("source")
    reader.done()
    return mass, vector(com), tensor(moments)


def _markers(reader: _Reader, weight: float) -> list[Marker]:
    name, segment, at = str(reader.need("name")), str(reader.need("segment")), reader.vector("at")
    reader = replace(reader, field=f"{reader.field}.{name}")
    mirrored, tracking = bool(reader.maybe("mirrored", False)), bool(reader.maybe("tracking", False))
    reader.need("source")
    reader.done()
    anatomical = weight > 0.0 and not tracking
    markers = [Marker.at(name, segment, at, weight=weight, anatomical=anatomical)]
    if mirrored:
        if not name.startswith("R"):
            raise reader.error("a mirrored marker starts with R", "Rename it or drop `mirrored`")
        at = (at[0], at[1], -at[2])
        markers.append(Marker.at(f"L{name[1:]}", _left(segment), at, weight=weight, anatomical=anatomical))
    return markers


def _mirror_segment(segment: Segment) -> Segment:
    xx, yy, zz, xy, xz, yz = segment.inertia
    x, y, z = segment.com
    return Segment(
        name=_left(segment.name),
        parent=_left(segment.parent),
        joint_name=_left(segment.joint_name),
        joints=tuple(_mirror_joint(joint) for joint in segment.joints),
        mass=segment.mass,
        com=(x, y, -z),
        inertia=(xx, yy, zz, xy, -xz, -yz),
    )


def _mirror_joint(joint: Joint) -> Joint:
    """The joint seen in the sagittal plane's mirror, driven by the left coordinate of the same sign.

    A turn is mirrored by reversing the x and y parts of its axis; a translation by reversing its
    value along z.
    """
    law = Law(
        tuple(replace(t, coordinate=_left(t.coordinate) if t.coordinate else None) for t in joint.law.terms)
    )
    scales_with = _left(joint.scales_with) if joint.scales_with else None
    x, y, z = joint.axis
    if joint.kind == "rotation":
        return replace(joint, axis=(-x + 0.0, -y + 0.0, z), law=law, scales_with=scales_with)
    return replace(joint, law=law.scaled(-1.0) if z else law, scales_with=scales_with)


def _left(name: str) -> str:
    return f"{name[:-2]}_l" if name.endswith("_r") else name
