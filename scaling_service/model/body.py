"""The body model: a tree of one-degree-of-freedom joints whose values come from laws.

Everything that moves, or could be made to move, is a joint: a rotation about or a translation
along a fixed axis of the frame it starts from. A joint's value is a :class:`Law`, a sum of terms
``gain * parameter * shape(coordinate)``. All quantities are SI and radians; frames are X forward,
Y up, Z to the subject's right (ISB).
"""

from __future__ import annotations

import dataclasses
from collections import Counter, abc
from typing import Literal, TypeVar

from scaling_service.core.errors import ModelRefused

Vector = tuple[float, float, float]
Tensor = tuple[float, float, float, float, float, float]
"""A symmetric tensor: xx, yy, zz, xy, xz, yz."""

GROUND = "ground"


def to_vector(values: abc.Iterable[float]) -> Vector:
    """Three numbers of any kind as a vector of the model."""
    x, y, z = (float(v) for v in values)
    return (x, y, z)


def to_tensor(values: abc.Iterable[float]) -> Tensor:
    """Six numbers of any kind as a tensor of the model."""
    xx, yy, zz, xy, xz, yz = (float(v) for v in values)
    return (xx, yy, zz, xy, xz, yz)


@dataclasses.dataclass(frozen=True, slots=True)
class Shape:
    """A piecewise polynomial of one coordinate, continued linearly outside its breaks."""

    breaks: tuple[float, ...]  # length n_pieces + 1: increasing, in the coordinate's unit (rad or m)
    coefficients: tuple[tuple[float, ...], ...]
    """Highest power first, in the local variable ``coordinate - breaks[i]``."""

    def __post_init__(self) -> None:
        if len(self.breaks) != len(self.coefficients) + 1:
            raise ValueError("a shape has one more break than pieces")


@dataclasses.dataclass(frozen=True, slots=True)
class Surface:
    """A smooth function of several coordinates.

    ``powers``: the product of their powers, ``numbers`` the exponents.
    ``normal_x``, ``normal_y``, ``normal_z``: the z axis after turns by two coordinates about x and y.
    ``arc_x``, ``arc_y``, ``arc_z``: the end of an arc of constant curvature and length one that leaves along
        y, and arrives along the y axis after turns about x and z by two coordinates to which ``numbers``
        (rad) are added.
    """

    kind: Literal["powers", "normal_x", "normal_y", "normal_z", "arc_x", "arc_y", "arc_z"]
    coordinates: tuple[str, ...]
    numbers: tuple[float, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True)
class Term:
    """One summand of a law: ``gain * parameter * shape(coordinate)``, or ``gain * parameter * surface``.

    Absent factors are one. A coordinate without a shape is taken as it is.
    """

    gain: float
    parameter: str | None = None
    coordinate: str | None = None
    shape: Shape | None = None
    _: dataclasses.KW_ONLY
    surface: Surface | None = None

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Those that enter."""
        if self.surface is not None:
            return self.surface.coordinates
        return () if self.coordinate is None else (self.coordinate,)

    @property
    def is_constant(self) -> bool:
        """Whether nothing but the gain enters."""
        return self.parameter is None and not self.coordinates


@dataclasses.dataclass(frozen=True, slots=True)
class Law:
    """A joint's value (rad or m): the sum of its terms."""

    terms: tuple[Term, ...] = ()

    @classmethod
    def constant(cls, value: float) -> Law:
        """A value that never changes."""
        return cls((Term(float(value)),)) if value else cls()

    @classmethod
    def of(cls, coordinate: str, gain: float = 1.0, offset: float = 0.0) -> Law:
        """A value linear in one coordinate."""
        return cls((Term(gain, coordinate=coordinate), *cls.constant(offset).terms))

    @property
    def is_constant(self) -> bool:
        """Whether neither a coordinate nor a parameter enters."""
        return all(t.is_constant for t in self.terms)

    @property
    def coordinates(self) -> set[str]:
        """Those that enter."""
        return {name for t in self.terms for name in t.coordinates}

    @property
    def constant_part(self) -> float:
        """The sum of the terms in which nothing but the gain enters."""
        return sum([t.gain for t in self.terms if t.is_constant])

    def __add__(self, other: Law) -> Law:
        return Law(self.terms + other.terms)

    def scale(self, factor: float) -> Law:
        """The law with every gain multiplied."""
        return Law(
            tuple(
                Term(t.gain * factor, t.parameter, t.coordinate, t.shape, surface=t.surface)
                for t in self.terms
            )
        )


@dataclasses.dataclass(frozen=True, slots=True)
class Joint:
    """A rotation about, or a translation along, an axis of the frame reached so far."""

    kind: Literal["rotation", "translation"]
    axis: Vector  # (3,) unit vector
    law: Law
    scales_with: str | None = None
    """For a translation: the segment whose size it follows. The axis then is expressed in that segment's
    frame, or in a joint frame fixed in it."""
    _: dataclasses.KW_ONLY
    size_axis: Vector | None = None
    """(3,) unit vector along an axis of that segment, where the translation follows its size along this one
    and not along its own axis."""

    @property
    def turns(self) -> bool:
        """Whether it is a rotation that something drives."""
        return self.kind == "rotation" and not self.law.is_constant


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Segment:
    """A rigid body and the chain of joints that carries it from its parent."""

    name: str
    parent: str  # another segment or ``"ground"``
    joint_name: str  # the anatomical joint, as the model calls it (knee_r)
    joints: tuple[Joint, ...]  # in order from the parent's frame to this segment's frame
    mass: float = 0.0  # kg
    com: Vector = (0.0, 0.0, 0.0)  # (3,) m, in the segment's frame
    inertia: Tensor = (0.0,) * 6
    """(6,) kg m2, about the centre of mass: xx, yy, zz, xy, xz, yz."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Coordinate:
    """One degree of freedom, estimated in every frame unless locked.

    ``lower`` and ``upper`` (rad or m) bind only where ``clamped``.
    """

    name: str
    kind: Literal["rotation", "translation"] = "rotation"
    default: float = 0.0
    lower: float = -float("inf")
    upper: float = float("inf")
    clamped: bool = False
    locked: bool = False


@dataclasses.dataclass(frozen=True, slots=True)
class Coupler:
    """A coordinate that follows another one: ``dependent = shape(independent)``.

    Its effect is already in the laws; it is kept so that motion files hold the dependent too. ``kind``: a
    rotation, which files hold in degrees, or anything else, which they hold as it is.
    """

    dependent: str
    independent: str
    law: Law
    kind: Literal["rotation", "translation"] = "translation"


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Marker:
    """A marker: three translations in its segment's frame."""

    name: str
    segment: str
    laws: tuple[Law, Law, Law]  # three Laws, m: the local coordinates x, y, z
    weight: float = 1.0  # its weight in inverse kinematics
    anatomical: bool = True  # on a bony landmark (True) or a tracking marker on soft tissue (False)
    follows_size: bool = True  # whether its local coordinates follow the segment's scale factors
    is_direction: bool = False  # a point at infinity, as long as the arm by which a rotation is weighed
    noise: float | None = None  # SD of one coordinate, m, of what is measured otherwise than over skin

    @classmethod
    def at(
        cls, name: str, segment: str, position: Vector, *, weight: float = 1.0, anatomical: bool = True
    ) -> Marker:
        """A marker at a fixed local position (m)."""
        x, y, z = (Law.constant(float(v)) for v in position)
        return cls(name=name, segment=segment, laws=(x, y, z), weight=weight, anatomical=anatomical)

    @property
    def nominal(self) -> Vector:
        """The constant part of its local position (m)."""
        return to_vector(law.constant_part for law in self.laws)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Constraint:
    """What every pose must obey beside the joints, which form a tree.

    ``point``: the two ends meet.
    ``weld``: frames at the ends, turned in their segments by ``turns`` (rotation vectors, rad), are one.
    ``distance``: the ends are ``distance`` (m) apart.
    ``line``: the second end lies on the line through the first along ``direction`` (in the first's segment).
    ``law``: ``law`` is zero.
    """

    name: str
    kind: Literal["point", "weld", "distance", "line", "law"]
    ends: tuple[Marker, ...] = ()
    turns: tuple[Vector, Vector] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    distance: float = 0.0
    direction: Vector = (0.0, 0.0, 0.0)
    law: Law = Law()


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """A number shared by all frames: a scale factor, an axis tilt, a marker shift."""

    name: str
    value: float
    unit: Literal["m", "rad", "1"]
    lower: float
    upper: float
    """``value``, ``lower``, ``upper``: in ``unit``; bounds may be infinite."""
    group: str  # length, axis or marker; effects of the discovery use their own
    target: str  # what it belongs to: the segment, joint or marker
    prior_sd: float | None = None  # standard deviation of a Gaussian prior centred on value


@dataclasses.dataclass(frozen=True, slots=True)
class Expectation:
    """What is known of a coordinate before markers are seen: Gaussian about a law of other coordinates."""

    coordinate: str
    law: Law  # rad or m
    sd: float  # rad or m
    source: str = ""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class ParameterPosterior:
    """How well the numbers of a model are known: what would be freed, deviations and correlations.

    ``names``: as ``model/freed.py`` has them, sizes as shares of what they are.
    ``sds``: in the parameters' units. ``correlations``: row by row below the diagonal. ``skin``:
    how much more than ordinary people's this person's skin moves.
    """

    names: tuple[str, ...]
    sds: tuple[float, ...]
    correlations: tuple[float, ...]
    skin: float = 1.0


@dataclasses.dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class BodyModel:
    """A body model as one frozen value.

    ``segments`` are ordered parents first. Edits return new models.
    """

    name: str
    segments: tuple[Segment, ...]
    coordinates: tuple[Coordinate, ...]
    markers: tuple[Marker, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    couplers: tuple[Coupler, ...] = ()
    constraints: tuple[Constraint, ...] = ()
    source: str = ""
    expectations: tuple[Expectation, ...] = ()
    # bone (``femur_r`` …) and the segment that it belongs to, where the segment's name does not say so
    bones: tuple[tuple[str, str], ...] = ()
    # coordinates and how far off they are in this model, RMS in rad or m, where a posterior told
    departures: tuple[tuple[str, float], ...] = ()
    notes: tuple[str, ...] = ()  # what the file that it was read from holds beside, or means otherwise
    # how well its numbers are known, where they were estimated so
    posterior: ParameterPosterior | None = None

    def __repr__(self) -> str:
        mass = sum(segment.mass for segment in self.segments)
        return (
            f"BodyModel '{self.name}': {len(self.segments)} segments, {len(self.coordinates)} coordinates, "
            f"{len(self.markers)} markers, {mass:.1f} kg"
        )

    def __post_init__(self) -> None:
        known = {GROUND}
        for segment in self.segments:
            if segment.parent not in known:
                raise ModelRefused(
                    f"segment '{segment.name}' hangs on '{segment.parent}', which is not before it",
                    field=segment.joint_name,
                    remedy="The model must be a tree: cut the loop or give the parent first",
                )
            if segment.name in known:
                raise ModelRefused(
                    f"segment '{segment.name}' is carried by two joints",
                    field=segment.joint_name,
                    remedy="The model must be a tree: remove one of the joints",
                )
            known.add(segment.name)
        for kind, names in (
            ("coordinate", [c.name for c in self.coordinates]),
            ("marker", [m.name for m in self.markers]),
            ("parameter", [p.name for p in self.parameters]),
        ):
            twice = {n for n, count in Counter(names).items() if count > 1}
            if twice:
                raise ModelRefused(
                    f"two {kind}s are called '{min(twice)}'", field=min(twice), remedy="Rename one of them"
                )
        for marker in (*self.markers, *(end for c in self.constraints for end in c.ends)):
            if marker.segment not in known:
                raise ModelRefused(
                    f"marker '{marker.name}' sits on '{marker.segment}', which is no segment of the model",
                    field=marker.name,
                    remedy=f"Segments are {', '.join(s.name for s in self.segments)}",
                )

    def segment(self, name: str) -> Segment:
        """The segment of that name (KeyError if none)."""
        return _find_named(self.segments, name)

    def marker(self, name: str) -> Marker:
        """The marker of that name (KeyError if none)."""
        return _find_named(self.markers, name)

    def coordinate(self, name: str) -> Coordinate:
        """The coordinate of that name (KeyError if none)."""
        return _find_named(self.coordinates, name)

    @property
    def knows_its_person(self) -> bool:
        """Whether it holds more of its person than plain inverse kinematics uses."""
        return bool(self.posterior or self.expectations or any(m.noise is not None for m in self.markers))

    def shows_key_points_alone(self, labels: abc.Iterable[str]) -> bool:
        """Whether all of its markers among these labels are key points of video, and there are any."""
        shown = set(labels)
        own = [m for m in self.markers if m.name in shown and m.weight > 0.0]
        return bool(own) and all(m.noise is not None and not m.is_direction for m in own)

    def bone_of(self, segment: str) -> str:
        """The bone that a segment stands for: what the model says of it, else its own name."""
        return next((bone for bone, name in self.bones if name == segment), segment)

    @property
    def segment_names(self) -> tuple[str, ...]:
        """All segments, parents first."""
        return tuple(s.name for s in self.segments)

    @property
    def marker_names(self) -> tuple[str, ...]:
        """All markers, in the model's order."""
        return tuple(m.name for m in self.markers)

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """All coordinates, in the model's order."""
        return tuple(c.name for c in self.coordinates)

    def joints(self) -> abc.Iterator[tuple[Segment, Joint]]:
        """Every joint with the segment it leads to."""
        return ((segment, joint) for segment in self.segments for joint in segment.joints)

    def children(self, segment: str) -> tuple[Segment, ...]:
        """The segments that hang directly on one."""
        return tuple(s for s in self.segments if s.parent == segment)

    def with_markers(self, markers: tuple[Marker, ...]) -> BodyModel:
        """The same body with other markers."""
        return dataclasses.replace(self, markers=markers)


_Item = TypeVar("_Item", Segment, Marker, Coordinate)


def _find_named(items: tuple[_Item, ...], name: str) -> _Item:
    for item in items:
        if item.name == name:
            return item
    raise KeyError(name)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Same:
    """A model that equals only itself: to compare all its numbers takes longer than a step of a solution."""

    model: BodyModel

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same) and self.model is other.model

    def __hash__(self) -> int:
        return id(self.model)
