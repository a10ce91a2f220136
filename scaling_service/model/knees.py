"""More rotational freedom in the knees of a model whose knees are plain hinges."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Literal

from scaling_service.core.errors import SubjectInvalid
from scaling_service.model.body import BodyModel, Coordinate, Joint, Law, Segment, Vector

KneeKind = Literal["hinge", "universal", "spherical"]

_TURNS: Mapping[KneeKind, tuple[str, ...]] = {
    "hinge": (),
    "universal": ("rotation",),
    "spherical": ("adduction", "rotation"),
}
"""What follows flexion, in the order of the ISB (Grood and Suntay 1983; Wu 2002): about the floating axis,
then about the shank's. A knee's second freedom is the turn of the shank: 10 to 20 deg against a few of varus
and valgus (Grood and Suntay 1983), so that is what a joint of two axes takes."""

_AXES: Mapping[str, Vector] = {"adduction": (1.0, 0.0, 0.0), "rotation": (0.0, 1.0, 0.0)}

_RANGE_DEG: Mapping[str, float] = {"adduction": 20.0, "rotation": 40.0}
"""To either side. Chosen: about twice what knees reach, for skin movement is taken for knee movement. They
inform the first guess, they do not bind."""

_ALONG_Z = 1.0 - 1e-9  # of an axis' z part: rounding


def with_knee(model: BodyModel, kind: KneeKind) -> BodyModel:
    """The model with turns added after the hinge of each knee.

    New coordinates are ``knee_adduction_r`` (varus positive) and ``knee_rotation_r`` (inward positive)
    and the left ones, each after its knee's flexion. At zero the model is as it was.

    Parameters
    ----------
    kind : 'hinge', 'universal' or 'spherical'
        Flexion alone; with inward rotation; with varus and valgus as well.

    Raises
    ------
    SubjectInvalid
        The model has no knee, or one that is not a plain hinge about z.

    Examples
    --------
    >>> from scaling_service.model.builtin import builtin
    >>> with_knee(builtin("lower_limb_14dof"), "spherical").coordinate_names[9:12]
    ('knee_angle_r', 'knee_adduction_r', 'knee_rotation_r')
    """
    turns = _TURNS[kind]
    if not turns:
        return model
    knees = {s.name: _hinge(s) for s in model.segments if s.name in ("tibia_r", "tibia_l")}
    if not knees:
        raise SubjectInvalid(
            f"model '{model.name}' has no knee that could be made {kind}",
            field="knee",
            remedy="Choose a built-in leg model, or leave the knee as it is",
        )
    segments = tuple(
        replace(s, joints=(*s.joints, *(_turn(turn, s.name[-1]) for turn in turns))) if s.name in knees else s
        for s in model.segments
    )
    added = {flexion: name[-1] for name, flexion in knees.items()}
    coordinates = tuple(c for old in model.coordinates for c in _followed(old, added, turns))
    return replace(model, segments=segments, coordinates=coordinates)


def _hinge(segment: Segment) -> str:
    """The coordinate of a plain hinge about z, the last joint of its chain."""
    moving = [j for j in segment.joints if not j.law.is_constant]
    last = segment.joints[-1] if segment.joints else None
    if len(moving) == 1 and moving[0] is last and last.kind == "rotation" and abs(last.axis[2]) > _ALONG_Z:
        (term,) = last.law.terms or (None,)
        if term is not None and term.coordinate is not None and term.shape is None:
            return term.coordinate
    raise SubjectInvalid(
        f"'{segment.joint_name}' is not a plain hinge",
        field="knee",
        remedy="Choose a built-in leg model, or leave the knee as it is",
    )


def _turn(turn: str, side: str) -> Joint:
    """Axes x and y are reversed on the left, so that both sides carry the same clinical signs."""
    x, y, z = _AXES[turn]
    axis = (x, y, z) if side == "r" else (-x + 0.0, -y + 0.0, z)
    return Joint("rotation", axis, Law.of(f"knee_{turn}_{side}"))


def _followed(old: Coordinate, added: Mapping[str, str], turns: tuple[str, ...]) -> Iterator[Coordinate]:
    yield old
    if old.name in added:
        for turn in turns:
            reach = math.radians(_RANGE_DEG[turn])
            yield Coordinate(f"knee_{turn}_{added[old.name]}", lower=-reach, upper=reach)
