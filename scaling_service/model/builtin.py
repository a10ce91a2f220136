"""The body models that come with the product, by name, and the short form in which they are written down.

Their numbers, each with its source, are in the data folder ``reference_models``.
"""

from __future__ import annotations

import math
import typing
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import pydantic

from scaling_service.core.errors import InputError
from scaling_service.core.names import say_name
from scaling_service.core.notes import Note
from scaling_service.model import body, reference
from scaling_service.model.inertia import read_inertia_table

BUILTIN_NAMES: tuple[str, ...] = (
    "lower_limb_14dof",
    "lower_limb_feet_18dof",
    "full_body_35dof",
    "squat_4dof",
)
"""Puchaud 2019 (section 2.2.1), the same with feet, Muller 2017 (section 2.3) and Futamure (section II.A)."""

_STIFF = 0.1
"""Weight of markers on what is taken as one rigid part with its neighbour. Chosen: a trunk bends by three
times what skin slides on the pelvis."""

_AXES: dict[str, body.Vector] = {
    sign + name: (factor * x, factor * y, factor * z)
    for sign, factor in (("", 1.0), ("-", -1.0))
    for name, (x, y, z) in {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}.items()
}


def load_builtin(name: str) -> body.BodyModel:
    """A built-in generic model.

    ``name``: one of ``BUILTIN_NAMES``.
    Raises InputError: if there is no such model; the names are listed.

    Examples
    --------
    >>> load_builtin("lower_limb_14dof").segment_names
    ('pelvis', 'femur_r', 'tibia_r', 'femur_l', 'tibia_l')
    """
    return _load(name)[0]


def load_generic_person(name: str) -> GenericPerson:
    """The stature, mass and sex that a built-in model's numbers belong to; errors as :func:`load_builtin`."""
    return _load(name)[1]


def lock_unmarked(
    model: body.BodyModel, placed: Mapping[str, str]
) -> tuple[body.BodyModel, tuple[Note, ...]]:
    """A built-in model without the freedoms that only a marker on some segment would show.

    What then moves as one with its parent is less rigid than a segment: its markers count less.

    ``placed``: every marker that a recording shows to its segment.
    Returns ``notes``: what was locked and why. Other models are left as they are.
    """
    needs = _list_needs(model.name) if model.name in BUILTIN_NAMES else {}
    locked = {name: need for name, need in needs.items() if need.marked not in placed.values()}
    stiff = {need.moved for need in locked.values()}
    coordinates = tuple(replace(c, locked=c.locked or c.name in locked) for c in model.coordinates)
    markers = tuple(replace(m, weight=_STIFF * m.weight) if m.segment in stiff else m for m in model.markers)
    notes = (
        Note(
            code="locked",
            problem=f"{say_name(name)} is locked: no recording shows a marker on the {say_name(need.marked)}",
        )
        for name, need in locked.items()
    )
    return replace(model, coordinates=coordinates, markers=markers), tuple(notes)


class _Need(typing.NamedTuple):
    """What a freedom needs to be seen: its segment moves against one that must bear a marker."""

    moved: str
    marked: str


def list_unmarked(model: body.BodyModel) -> frozenset[str]:
    """The coordinates that :func:`lock_unmarked` locked: no marker shows them, their value tells nothing."""
    needs = _list_needs(model.name) if model.name in BUILTIN_NAMES else {}
    return frozenset(c.name for c in model.coordinates if c.locked and c.name in needs)


@lru_cache(maxsize=16)
def _list_needs(name: str) -> Mapping[str, _Need]:
    """Coordinate to its need, of freedoms that only a marker on some segment would show."""
    document = reference.read_reference(reference.find_reference_folder() / f"{name}.yaml")
    return {
        move["coordinate"]: _Need(segment["name"], move["free_if_marked"])
        for segment in document["segments"]
        for move in segment.get("moves", ())
        if "free_if_marked" in move
    }


@lru_cache(maxsize=16)
def _load(name: str) -> tuple[body.BodyModel, GenericPerson]:
    if name not in BUILTIN_NAMES:
        raise InputError(
            f"there is no built-in model '{name}'",
            field="model",
            remedy=f"Use one of {', '.join(BUILTIN_NAMES)}, or the path of an .osim file",
        )
    document = reference.read_reference(reference.find_reference_folder() / f"{name}.yaml")
    base = document.get("extends")
    return expand(document, file=f"{name}.yaml", base=_load(base) if base else None)


class _Entry(pydantic.BaseModel):
    """A part of the short form; every key must be known, and every number has its source."""

    model_config = pydantic.ConfigDict(extra="forbid", frozen=True)


class GenericPerson(_Entry):
    """Whom a generic model depicts: m, kg."""

    sex: typing.Literal["F", "M"]
    height_m: float
    mass_kg: float


class _Person(GenericPerson):
    source: str


class _Centre(_Entry):
    at: body.Vector
    source: str


class _Move(_Entry):
    """A turn ``about`` or a glide ``along`` an axis: by a coordinate, or by a constant angle."""

    about: str | None = None
    along: str | None = None
    coordinate: str = ""
    default_m: float = 0.0
    range_deg: tuple[float, float] = (-math.inf, math.inf)
    angle_deg: float | None = None
    free_if_marked: str | None = None  # the segment
    source: str | None = None


class _Inertia(_Entry):
    """Percentages, written down or of a row of a published table, of a length from an origin."""

    length: float
    origin: body.Vector = pydantic.Field(default=(0.0, 0.0, 0.0), alias="from")
    table: str | None = None
    row: str = ""
    mass_pct: float = 0.0
    com_pct: body.Vector = (0.0, 0.0, 0.0)
    radii_pct: body.Vector = (0.0, 0.0, 0.0)
    products_pct: body.Vector = (0.0, 0.0, 0.0)
    source: str


class _Segment(_Entry):
    name: str
    parent: str
    joint: str
    mirrored: bool = False
    centre: _Centre | None = None
    moves: tuple[_Move, ...] = ()
    inertia: _Inertia


class _Marker(_Entry):
    name: str
    segment: str
    at: body.Vector
    mirrored: bool = False
    tracking: bool = False
    source: str


class _Document(_Entry):
    name: str
    source: str
    extends: str | None = None
    person: _Person
    segments: tuple[_Segment, ...]
    markers: tuple[_Marker, ...] = ()
    landmarks: tuple[_Marker, ...] = ()


def expand(
    document: Mapping[str, typing.Any], *, file: str, base: tuple[body.BodyModel, GenericPerson] | None = None
) -> tuple[body.BodyModel, GenericPerson]:
    """The body model that a compact document describes, and whom it depicts.

    Its keys: see ``reference_models/README.md``. Only the midline and the right side are written down:
    an entry with ``mirrored: true`` also gives the left one (``_r`` to ``_l``, leading ``R`` to ``L``, z
    negated, turns about x and y reversed), so that both sides carry the same clinical signs. Of ``base``, the
    model that ``extends`` names, segments, coordinates and markers come first; its landmarks (markers of
    weight zero) are not taken over. A missing or unknown key is an InputError that names ``file``.
    """
    try:
        written = _Document.model_validate(document)
    except pydantic.ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(map(str, first["loc"]))
        raise InputError(first["msg"], file=file, field=field, remedy="Correct this key") from None
    person = GenericPerson(**written.person.model_dump(exclude={"source"}))
    segments = list(base[0].segments) if base else []
    coordinates = list(base[0].coordinates) if base else []
    markers = [m for m in base[0].markers if m.weight > 0.0] if base else []
    left: list[body.Segment] = []
    left_coordinates: list[body.Coordinate] = []
    for entry in written.segments:
        joints: list[body.Joint] = []
        if entry.centre is not None:
            # Zeros stay, so that a centre can be moved in place.
            follows = None if entry.parent == body.GROUND else entry.parent
            places = zip("XYZ", entry.centre.at, strict=True)
            joints += [
                body.Joint("translation", _AXES[axis], body.Law.constant(at), follows) for axis, at in places
            ]
        moved: list[body.Coordinate] = []
        for move in entry.moves:
            axis = _AXES[move.about or move.along or ""]
            if move.angle_deg is not None:
                joints.append(body.Joint("rotation", axis, body.Law.constant(math.radians(move.angle_deg))))
                continue
            kind: typing.Literal["rotation", "translation"] = "rotation" if move.about else "translation"
            lower, upper = (math.pi / 180.0 * limit for limit in move.range_deg)
            joints.append(body.Joint(kind, axis, body.Law.of(move.coordinate)))
            moved.append(
                body.Coordinate(
                    name=move.coordinate, kind=kind, default=move.default_m, lower=lower, upper=upper
                )
            )
        mass, com, inertia = _make_inertia(entry.inertia, person)
        segment = body.Segment(
            name=entry.name,
            parent=entry.parent,
            joint_name=entry.joint,
            joints=tuple(joints),
            mass=mass,
            com=com,
            inertia=inertia,
        )
        segments.append(segment)
        coordinates += moved
        if entry.mirrored:
            left.append(_mirror_segment(segment))
            left_coordinates += [replace(c, name=_mirror_name(c.name)) for c in moved]
    for entries, weight in ((written.markers, 1.0), (written.landmarks, 0.0)):
        for worn in entries:
            anatomical = weight > 0.0 and not worn.tracking
            markers.append(
                body.Marker.at(worn.name, worn.segment, worn.at, weight=weight, anatomical=anatomical)
            )
            if worn.mirrored:
                x, y, z = worn.at
                name, owner = f"L{worn.name[1:]}", _mirror_name(worn.segment)
                markers.append(body.Marker.at(name, owner, (x, y, -z), weight=weight, anatomical=anatomical))
    model = body.BodyModel(
        name=written.name,
        segments=(*segments, *left),
        coordinates=(*coordinates, *left_coordinates),
        markers=tuple(markers),
        source=written.source,
    )
    return model, person


def _make_inertia(entry: _Inertia, person: GenericPerson) -> tuple[float, body.Vector, body.Tensor]:
    """Mass, centre of mass and tensor from percentages.

    Tables give the mass in % of the body's, the centre of mass in % of a length L from an origin,
    and the tensor as radii r in % of L: ``I = m (r L)^2``, with the sign of a product kept apart
    (Dumas et al. 2007, tables 1 and 2, where a negative product is an imaginary radius).
    """
    mass_pct, com_pct, radii = entry.mass_pct, entry.com_pct, (*entry.radii_pct, *entry.products_pct)
    if entry.table is not None:
        row = read_inertia_table(entry.table).row(entry.row, person.sex)
        mass_pct, com_pct = row.mass_pct, body.to_vector(row.com_pct or ())
        radii = (*body.to_vector([r or 0.0 for r in row.radii_pct]), *row.products_pct)
    mass = person.mass_kg * mass_pct / 100.0
    com = tuple(o + entry.length * c / 100.0 for o, c in zip(entry.origin, com_pct, strict=True))
    moments = [math.copysign(mass * (r * entry.length / 100.0) ** 2, r) if r else 0.0 for r in radii]
    return mass, body.to_vector(com), body.to_tensor(moments)


def _mirror_segment(segment: body.Segment) -> body.Segment:
    joints = []
    for joint in segment.joints:
        # Seen in the sagittal plane's mirror, driven by the left coordinate of the same sign: a turn by
        # reversing the x and y parts of its axis, a translation by reversing its value along z.
        terms = [
            replace(t, coordinate=_mirror_name(t.coordinate) if t.coordinate else None)
            for t in joint.law.terms
        ]
        law, (x, y, z) = body.Law(tuple(terms)), joint.axis
        scales_with = _mirror_name(joint.scales_with) if joint.scales_with else None
        if joint.kind == "rotation":
            joints.append(replace(joint, axis=(-x + 0.0, -y + 0.0, z), law=law, scales_with=scales_with))
        else:
            joints.append(replace(joint, law=law.scale(-1.0) if z else law, scales_with=scales_with))
    xx, yy, zz, xy, xz, yz = segment.inertia
    x, y, z = segment.com
    return body.Segment(
        name=_mirror_name(segment.name),
        parent=_mirror_name(segment.parent),
        joint_name=_mirror_name(segment.joint_name),
        joints=tuple(joints),
        mass=segment.mass,
        com=(x, y, -z),
        inertia=(xx, yy, zz, xy, -xz, -yz),
    )


def _mirror_name(name: str) -> str:
    return f"{name[:-2]}_l" if name.endswith("_r") else name
