"""A skeleton as biorbd's bioMod: one segment an axis, and one for each of ours with mass and markers.

bioMod's segments turn and shift along their own axes only, so each axis has a segment whose z lies along it
(https://github.com/pyomeca/biorbd, "Model files"). It knows no coordinates that follow others: such an axis
is a degree of freedom, whose value the caller gives.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scaling_service.files.engines.skeleton import Skeleton
from scaling_service.model.axes import DrivenAxis, list_limbs, list_uncarried
from scaling_service.model.body import GROUND, BodyModel, Segment
from scaling_service.model.trial import Array
from scaling_service.numerics.multibody.rigid import rotation_from_vector
from scaling_service.numerics.wrench.ground_wrench import GRAVITY


def write_biomod(model: BodyModel) -> Skeleton:
    """A ``.bioMod`` file, SI and rad, Y up; what it does not carry stands in comments at its head, too.

    Its degrees of freedom come in the order of :func:`scaling_service.model.axes.list_limbs`' axes.
    ValueError: the model's parameters are not folded into its laws.
    """
    said = list_uncarried(model)
    lines = ["version 4", *(f"// {line}" for line in said), ""]
    lines += [f"gravity {_numbers(GRAVITY)}", ""]
    for limb in list_limbs(model):
        parent, back = "root" if limb.segment.parent == GROUND else limb.segment.parent, np.asarray(np.eye(4))
        for axis in limb.axes:
            along = _along_z(axis.axis)
            lines += _segment(axis.name, parent, back @ axis.before @ along, _motion(axis))
            parent, back = axis.name, np.asarray(np.linalg.inv(along), dtype=float)
        lines += _segment(limb.segment.name, parent, back @ limb.last, _mass(limb.segment))
    for marker in model.markers:
        lines += [
            f"marker {marker.name.replace(' ', '_')}",
            f"    parent {'root' if marker.segment == GROUND else marker.segment}",
            f"    position {_numbers(marker.nominal)}",
            f"    anatomical {int(marker.anatomical)}",
            f"    technical {int(not marker.anatomical)}",
            "endmarker",
            "",
        ]
    return Skeleton("\n".join(lines), said)


def _segment(name: str, parent: str, frame: Array, more: Iterator[str]) -> list[str]:
    rows = [f"        {_numbers(row)}" for row in frame]
    head = [f"segment {name}", f"    parent {parent}", "    RTinMatrix 1", "    RT", *rows]
    return [*head, *more, "endsegment", ""]


def _motion(axis: DrivenAxis) -> Iterator[str]:
    yield f"    {'rotations' if axis.kind == 'rotation' else 'translations'} z"


def _mass(segment: Segment) -> Iterator[str]:
    if segment.mass <= 0.0:
        return
    xx, yy, zz, xy, xz, yz = segment.inertia
    yield f"    mass {segment.mass:.17g}"
    yield f"    CenterOfMass {_numbers(segment.com)}"
    yield "    inertia"
    for row in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)):
        yield f"        {_numbers(row)}"


def _along_z(axis: Array) -> Array:
    """The frame, (4, 4), whose z lies along an axis."""
    frame, cross = np.eye(4), np.cross((0.0, 0.0, 1.0), axis)
    sine = float(np.linalg.norm(cross))
    if sine > 0.0:
        frame[:3, :3] = rotation_from_vector(cross / sine * np.arctan2(sine, axis[2]))
    elif axis[2] < 0.0:
        frame[:3, :3] = np.diag([1.0, -1.0, -1.0])
    return frame


def _numbers(values: object) -> str:
    return " ".join(f"{value:.17g}" for value in np.asarray(values, dtype=float))
