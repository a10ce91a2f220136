"""Scaled models for other engines: MuJoCo's MJCF and biorbd's bioMod."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.files import limbs
from scaling_service.files.mjcf import write_mjcf
from scaling_service.model import body
from scaling_service.model.muscles import Musculature
from scaling_service.numerics.multibody.rigid import convert_vector_to_rotation
from scaling_service.numerics.wrench import GRAVITY


def write_biomod(model: body.BodyModel, _muscles: Musculature | None = None) -> limbs.Skeleton:
    """A ``.bioMod`` file, SI and rad, Y up; what it does not carry stands in comments at its head, too.

    Its degrees of freedom come in the order of :func:`list_limbs`' axes.
    Muscles are not carried.
    ValueError: the model's parameters are not folded into its laws.
    """
    said = (*limbs.list_following(model), *limbs.list_uncarried(model))
    lines = ["version 4", *(f"// {line}" for line in said), ""]
    lines += [f"gravity {limbs.format_numbers(GRAVITY)}", ""]
    for limb in limbs.list_limbs(model):
        parent, back = (
            "root" if limb.segment.parent == body.GROUND else limb.segment.parent,
            np.asarray(np.eye(4)),
        )
        for axis in limb.axes:
            # The frame, (4, 4), whose z lies along an axis.
            frame, cross = np.eye(4), np.cross((0.0, 0.0, 1.0), axis.axis)
            sine = float(np.linalg.norm(cross))
            if sine > 0.0:
                frame[:3, :3] = convert_vector_to_rotation(cross / sine * np.arctan2(sine, axis.axis[2]))
            elif axis.axis[2] < 0.0:
                frame[:3, :3] = np.diag([1.0, -1.0, -1.0])
            along = frame
            motion = f"    {'rotations' if axis.kind == 'rotation' else 'translations'} z"
            lines += _write_segment(axis.name, parent, back @ axis.before @ along, motion)
            parent, back = axis.name, np.asarray(np.linalg.inv(along), dtype=float)
        segment, mass = limb.segment, []
        if segment.mass > 0.0:
            xx, yy, zz, xy, xz, yz = segment.inertia
            rows = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
            mass = [f"    mass {segment.mass:.17g}", f"    CenterOfMass {limbs.format_numbers(segment.com)}"]
            mass += ["    inertia", *(f"        {limbs.format_numbers(row)}" for row in rows)]
        lines += _write_segment(segment.name, parent, back @ limb.last, *mass)
    for marker in model.markers:
        lines += [
            f"marker {marker.name.replace(' ', '_')}",
            f"    parent {'root' if marker.segment == body.GROUND else marker.segment}",
            f"    position {limbs.format_numbers(marker.nominal)}",
            f"    anatomical {int(marker.anatomical)}",
            f"    technical {int(not marker.anatomical)}",
            "endmarker",
            "",
        ]
    return limbs.Skeleton("\n".join(lines), said)


def _write_segment(name: str, parent: str, frame: Array, *more: str) -> list[str]:
    rows = [f"        {limbs.format_numbers(row)}" for row in frame]
    head = [f"segment {name}", f"    parent {parent}", "    RTinMatrix 1", "    RT", *rows]
    return [*head, *more, "endsegment", ""]


ENGINES: Mapping[str, tuple[str, Callable[[body.BodyModel, Musculature | None], limbs.Skeleton]]] = (
    MappingProxyType({"mjcf": ("model.xml", write_mjcf), "biomod": ("model.bioMod", write_biomod)})
)
"""Format to the file's name and what makes its content."""
