"""The numbers that a joint posterior frees, by their names.

``scale.<segment>``, or ``scale.<segment>.x`` and ``.z`` of the pelvis; ``axis.<joint>.x`` and ``.y``, rad;
``centre.hip_r.x`` and so on, m; ``marker.<marker>.x`` and so on, m; ``skin.<marker>.x.<coordinate>`` and so
on, m per rad.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from scaling_service.model import body, parameters
from scaling_service.model.anatomy.lengths import find_segment

UNBOUNDED = 10.0
"""Bound of a number that a prior holds: as good as none, m or a share."""

_SKIN = re.compile(r"skin\.(.+)\.[xyz]\.([^.]+)")

MARKERS_HELD = (
    "model.osim has the markers where skin holds them in the neutral pose; how skin moves with joints, and "
    "how well each number is known, is in model.json"
)
"""Said of an OpenSim model whose markers were held."""


def free_named(model: body.BodyModel, names: Sequence[str]) -> body.BodyModel:
    """Free numbers by the names of their parameters, of which the module's head has the kinds.

    Sizes start at one, all others at zero, without bounds; parameters come in the order of ``names``, each
    marker's, axis's and segment's together. What the model does not have is left out.
    """
    freed, known = model, {m.name for m in model.markers}
    joints = {s.joint_name for s in model.segments}
    parts = dict.fromkeys(_read_part(name) for name in names)
    drivers: dict[str, dict[str, None]] = {}
    for name in names:
        if (found := _SKIN.fullmatch(name)) is not None and found[2] in model.coordinate_names:
            drivers.setdefault(found[1], {})[found[2]] = None
    for kind, target in parts:
        if kind == "size" and target in model.segment_names:
            freed = parameters.free_scale(freed, target, UNBOUNDED)
        elif kind == "sizes" and target in model.segment_names:
            freed = parameters.free_scale_axes(freed, target, "xz", UNBOUNDED)
        elif kind == "axis" and target in joints:
            freed = parameters.free_axis(freed, target, UNBOUNDED, UNBOUNDED)
        elif kind == "centre" and (segment := find_segment(model, "femur", target[-1])) is not None:
            freed = free_centre(freed, segment, target)
        elif kind == "marker" and target in known:
            freed = parameters.free_marker(freed, target, parameters.LETTERS, UNBOUNDED)
        elif kind == "skin" and target in known:
            freed = free_skin(freed, target, tuple(drivers.get(target, ())))
    return freed


def _read_part(name: str) -> tuple[str, str]:
    """The kind of a parameter, and the segment, joint or marker whose it is."""
    if (skin := _SKIN.fullmatch(name)) is not None:
        return "skin", skin[1]
    kind, _, rest = name.partition(".")
    target, _, letter = rest.rpartition(".")
    if kind == "scale":
        return ("sizes", target) if letter in ("x", "y", "z") and target else ("size", rest)
    return kind, target


def hold_markers(model: body.BodyModel) -> body.BodyModel:
    """The same with markers that move on their segments where they are in the neutral pose."""
    held = [
        replace(m, laws=body.Marker.at("", "", m.nominal).laws)
        if any(not law.is_constant for law in m.laws)
        else m
        for m in model.markers
    ]
    return model.with_markers(tuple(held))


def free_centre(model: body.BodyModel, segment: str, joint: str) -> body.BodyModel:
    """Free a segment's joint centre in its parent: ``centre.<joint>.x`` and so on, m, without bounds."""
    names = [f"centre.{joint}.{letter}" for letter in parameters.LETTERS]
    shifts = tuple(
        body.Joint("translation", unit, body.Law((body.Term(1.0, parameter=name),)))
        for unit, name in zip(parameters.UNITS, names, strict=True)
    )
    segments = tuple(
        replace(s, joints=(*shifts, *s.joints)) if s.name == segment else s for s in model.segments
    )
    freed = replace(model, segments=segments)
    return parameters.add_parameters(freed, dict.fromkeys(names, UNBOUNDED), "centre", joint)


def free_skin(model: body.BodyModel, name: str, drivers: Sequence[str]) -> body.BodyModel:
    """Let a marker slide with coordinates: ``skin.<marker>.<axis>.<coordinate>``, m per rad."""

    def slide(law: body.Law, letter: str) -> body.Law:
        return law + body.Law(
            tuple(body.Term(1.0, parameter=f"skin.{name}.{letter}.{d}", coordinate=d) for d in drivers)
        )

    def change(marker: body.Marker) -> body.Marker:
        if marker.name != name:
            return marker
        x, y, z = (slide(law, letter) for law, letter in zip(marker.laws, parameters.LETTERS, strict=True))
        return replace(marker, laws=(x, y, z))

    names = [f"skin.{name}.{letter}.{driver}" for letter in parameters.LETTERS for driver in drivers]
    freed = model.with_markers(tuple(map(change, model.markers)))
    return parameters.add_parameters(freed, dict.fromkeys(names, UNBOUNDED), "skin", name)
