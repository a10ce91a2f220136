"""Chains of moves: from bodies to frames in them, and of joints that glide along surfaces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal, TypeAlias

import numpy as np

from scaling_service.core.errors import ModelRefused
from scaling_service.files.osim import library
from scaling_service.model.body import GROUND, Joint, Law, Surface, Term, to_vector
from scaling_service.numerics.multibody.rigid import convert_rotation_to_vector

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_Normal: TypeAlias = Literal["normal_x", "normal_y", "normal_z"]
_NO_TURN = 1e-15
"""rad; a smaller constant rotation is rounding (chosen: below the spacing of numbers near one)."""


def read_frame(frame: Any, component: str) -> tuple[str, tuple[Joint, ...]]:
    """The body under a frame, and the chain from it to the frame, through all offsets between."""
    offsets: list[Any] = []
    while (offset := library.import_opensim().PhysicalOffsetFrame.safeDownCast(frame)) is not None:
        offsets.insert(0, offset.getOffsetTransform())
        frame = offset.getParentFrame()
    body, kind = frame.getName(), frame.getConcreteClassName()
    if kind not in {"Body", "Ground"}:
        raise ModelRefused(
            f"'{component}' is attached to '{body}', a {kind}, which is not supported",
            field=component,
            remedy="Attach it to a body or to a PhysicalOffsetFrame",
        )
    moves = []
    for transform in offsets:
        for axis, value in zip((X, Y, Z), library.list_numbers(transform.p()), strict=True):
            if value:
                scales_with = None if body == GROUND else body
                moves.append(Joint("translation", axis, Law.constant(value), scales_with))
        turn = convert_rotation_to_vector(library.list_rows(transform.R()))
        angle = float(np.linalg.norm(turn))
        if angle > _NO_TURN:
            moves.append(Joint("rotation", to_vector(turn / angle), Law.constant(angle)))
    return body, tuple(moves)


def invert_chain(chain: Sequence[Joint]) -> tuple[Joint, ...]:
    """The chain that leads back."""
    return tuple(replace(joint, law=joint.law.scale(-1.0)) for joint in reversed(chain))


def read_ellipsoid(joint: Any, parent: str | None, _: str | None) -> list[Joint]:
    """The child glides on an ellipsoid of the parent, its z axis along the normal of the unit sphere."""
    radii = library.list_numbers(
        library.import_opensim().EllipsoidJoint.safeDownCast(joint).get_radii_x_y_z()
    )
    names = _list_coordinates(joint)
    turns = [Joint("rotation", axis, Law.of(name)) for axis, name in zip((X, Y, Z), names, strict=True)]
    return [*_glide(names, ("normal_x", "normal_y", "normal_z"), radii, parent), *turns]


def read_scapulothoracic(joint: Any, parent: str | None, child: str | None) -> list[Joint]:
    """An ellipsoid joint a quarter turn about z off the joint frames, then a hinge in the tangent plane.

    Seth et al. 2016, PLoS ONE 11:e0141028.
    """
    own = library.import_opensim().ScapulothoracicJoint.safeDownCast(joint)
    across, along, through = library.list_numbers(own.get_thoracic_ellipsoid_radii_x_y_z())
    *names, winging = _list_coordinates(joint)
    quarter = Joint("rotation", Z, Law.constant(0.5 * math.pi))
    turns = [Joint("rotation", axis, Law.of(name)) for axis, name in zip((X, Y, Z), names, strict=True)]
    to_hinge = [
        Joint("translation", axis, Law.constant(own.get_scapula_winging_axis_origin(k)), child)
        for k, axis in enumerate((X, Y))
    ]
    slant = own.get_scapula_winging_axis_direction()
    hinge = Joint("rotation", (-math.sin(slant), math.cos(slant), 0.0), Law.of(winging))
    # x and y of the turned frame are y and -x of the joint's
    glide = _glide(names, ("normal_y", "normal_x", "normal_z"), (-across, along, through), parent)
    back = (*invert_chain([quarter]), *to_hinge, hinge, *invert_chain(to_hinge))
    return [*glide, quarter, *turns, *back]


def _glide(
    names: Sequence[str], components: Sequence[_Normal], radii: Sequence[float], parent: str | None
) -> list[Joint]:
    """Translations along x, y and z by components of the normal, times radii."""
    surfaces = [Surface(component, tuple(names[:2])) for component in components]
    return [
        Joint("translation", axis, Law((Term(radius, surface=surface),)), parent)
        for surface, axis, radius in zip(surfaces, (X, Y, Z), radii, strict=True)
    ]


def read_constant_curvature(joint: Any, _: str | None, child: str | None) -> list[Joint]:
    """An arc that leaves the parent along y and arrives in the child along y, then turned about it.

    Where it bends by less than 0.001 or more than 1.52 rad, OpenSim puts a straight rod in the arc's place
    (up to 0.1 mm away, and far off); here it stays an arc.
    """
    own = library.import_opensim().ConstantCurvatureJoint.safeDownCast(joint)
    x, z, y = library.list_numbers(own.get_neutral_angle_x_z_y())
    names = _list_coordinates(joint)
    bent = tuple(names[:2]), (x, z)
    surfaces = Surface("arc_x", *bent), Surface("arc_y", *bent), Surface("arc_z", *bent)
    moves = [
        Joint("translation", axis, Law((Term(own.get_length(), surface=surface),)), child, size_axis=Y)
        for axis, surface in zip((X, Y, Z), surfaces, strict=True)
    ]
    turns = zip((X, Z, Y), names, (x, z, y), strict=True)
    return [*moves, *(Joint("rotation", axis, Law.of(name, offset=angle)) for axis, name, angle in turns)]


def _list_coordinates(joint: Any) -> list[str]:
    return [joint.get_coordinates(k).getName() for k in range(joint.numCoordinates())]
