"""Scaled models for biorbd: segments, markers, inertia and, of an OpenSim model, muscles, as bioMod."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.files import limbs
from scaling_service.files.biomod_muscles import write_muscles
from scaling_service.model.body import GROUND, BodyModel, Segment
from scaling_service.model.muscles import Musculature
from scaling_service.numerics.multibody.rigid import convert_vector_to_rotation
from scaling_service.numerics.wrench import GRAVITY


def write_biomod(model: BodyModel, muscles: Musculature | None = None) -> limbs.Skeleton:
    """A ``.bioMod`` file, SI and rad, Y up; what it does not carry stands in comments at its head, too.

    Its degrees of freedom come in the order of :func:`list_limbs`' axes.
    ``muscles``: as for :func:`write_mjcf`.
    ValueError: the model's parameters are not folded into its laws.
    """
    muscle_lines, of_muscles = ([], []) if muscles is None else write_muscles(model, muscles)
    said = [*limbs.list_following(model), *limbs.list_uncarried(model, muscles=muscles is None), *of_muscles]
    lines = ["version 4", *(f"// {line}" for line in said), ""]
    lines += [f"gravity {limbs.format_numbers(GRAVITY)}", ""]
    for limb in limbs.list_limbs(model):
        parent, back = "root" if limb.segment.parent == GROUND else limb.segment.parent, np.asarray(np.eye(4))
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
            lines += _write_segment(axis.name, parent, back @ axis.before @ along, [motion])
            parent, back = axis.name, np.asarray(np.linalg.inv(along), dtype=float)
        lines += _write_segment(limb.segment.name, parent, back @ limb.last, _write_mass(limb.segment))
    for marker in model.markers:
        lines += [
            f"marker {marker.name.replace(' ', '_')}",
            f"    parent {'root' if marker.segment == GROUND else marker.segment}",
            f"    position {limbs.format_numbers(marker.nominal)}",
            f"    anatomical {int(marker.anatomical)}",
            f"    technical {int(not marker.anatomical)}",
            "endmarker",
            "",
        ]
    lines += muscle_lines
    return limbs.Skeleton("\n".join(lines), tuple(said))


def _write_segment(name: str, parent: str, frame: Array, more: Iterable[str]) -> list[str]:
    rows = [f"        {limbs.format_numbers(row)}" for row in frame]
    head = [f"segment {name}", f"    parent {parent}", "    RTinMatrix 1", "    RT", *rows]
    return [*head, *more, "endsegment", ""]


def _write_mass(segment: Segment) -> Iterator[str]:
    if segment.mass <= 0.0:
        return
    xx, yy, zz, xy, xz, yz = segment.inertia
    yield f"    mass {segment.mass:.17g}"
    yield f"    CenterOfMass {limbs.format_numbers(segment.com)}"
    yield "    inertia"
    for row in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)):
        yield f"        {limbs.format_numbers(row)}"
