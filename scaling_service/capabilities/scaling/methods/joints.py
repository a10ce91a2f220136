"""A joint put elsewhere: its centre in the parent, its axis turned, more freedom in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scaling_service.core.errors import SubjectInvalid
from scaling_service.model.body import BodyModel, Joint, Law, Vector
from scaling_service.model.parameters import Tilt, fold, free_axis


def with_centre(model: BodyModel, segment: str, centre: Vector) -> BodyModel:
    """The model with a segment's joint elsewhere in its parent: its three leading shifts replaced.

    Parameters
    ----------
    segment : str
        The one that the joint carries.
    centre : (3,) m, in the parent's frame

    Raises
    ------
    SubjectInvalid
        The joint does not start with three plain shifts, as those of built-in models do.
    """
    joints = model.segment(segment).joints
    leading = [j for j in joints[:3] if j.kind == "translation" and j.law.is_constant]
    if len(leading) != 3:
        raise SubjectInvalid(
            f"the centre of '{model.segment(segment).joint_name}' is not three plain shifts",
            field="model",
            remedy="Use a built-in model",
        )
    new: tuple[Joint, ...] = tuple(
        replace(j, law=Law.constant(value)) for j, value in zip(leading, centre, strict=True)
    )
    segments = tuple(
        replace(s, joints=(*new, *joints[3:])) if s.name == segment else s for s in model.segments
    )
    return replace(model, segments=segments)


def with_axis(model: BodyModel, joint: str, tilt: Tilt) -> BodyModel:
    """The model with a joint's axis turned about x, then y, of the parent, rad."""
    freed = free_axis(model, joint, np.pi, np.pi)
    return fold(freed, {f"axis.{joint}.x": tilt[0], f"axis.{joint}.y": tilt[1]})
