"""Linear scaling of a body model: every segment by its own x, y and z factors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.model import body

_MASSLESS = 2.0**-52
"""kg; OpenSim's Body::scaleInertialProperties takes lighter bodies as massless (SimTK::Eps)."""


def scale_model(
    model: body.BodyModel,
    factors: Mapping[str, body.Vector],
    *,
    mass_kg: float | None = None,
    preserve_mass_distribution: bool = True,
) -> body.BodyModel:
    """Scale the geometry and inertia of a model.

    ``factors``: segment to its factors along its x, y and z axes. A built-in model takes one factor thrice.
        Segments not named keep their size.
    ``mass_kg``: the total mass that all masses and inertias are multiplied to reach.
    ``preserve_mass_distribution``: whether segment masses keep their proportions; otherwise each follows its
        volume.
    Translations that scale with a segment, centres of mass, markers and ends of constraints are multiplied
        component by component, joint axes and coordinates stay as they are.
    Raises KeyError: a factor for a segment that the model does not have.
    Raises ValueError: a factor or mass that is not positive and finite, or a mass for a massless model.

    Reproduces OpenSim's ``Model::scale`` (Seth et al. 2018, PLoS Comput Biol 14:e1006223; behaviour of
    version 4.6), inertia included: by the square of a uniform factor, otherwise as a cylinder. Two deliberate
    differences: a translation along an axis oblique to the axes of its frame is multiplied component by
    component like everything else, while OpenSim multiplies it by the sum of the factors weighted with the
    axis' components, which stretches it even where all factors are one; and the ends of constraints follow
    their segments like everything fixed in them, while OpenSim moves those of welds only.

    Examples
    --------
    >>> from scaling_service.model.body import BodyModel, Marker, Segment
    >>> segment = Segment(name="a", parent="ground", joint_name="j", joints=(), mass=2.0)
    >>> marker = Marker.at("m", "a", (0.1, 0.2, 0.3))
    >>> body = BodyModel(name="one", segments=(segment,), coordinates=(), markers=(marker,))
    >>> scale_model(body, {"a": (2.0, 1.0, 1.0)}).marker("m").nominal
    (0.2, 0.2, 0.3)
    """
    for name, values in factors.items():
        model.segment(name)
        if not all(np.isfinite(v) and v > 0 for v in values):
            raise ValueError(f"scale factors of '{name}' must be positive, not {values}")
    if mass_kg is not None:
        if not (np.isfinite(mass_kg) and mass_kg > 0):
            raise ValueError(f"a mass must be positive, not {mass_kg}")
        if not sum(s.mass for s in model.segments) > 0:
            raise ValueError("a model without mass cannot be given one by scaling")
    segments = tuple(
        _scale_segment(segment, factors, preserve_mass_distribution) for segment in model.segments
    )
    if mass_kg is not None:
        ratio = mass_kg / sum(s.mass for s in segments)
        segments = tuple(
            replace(s, mass=s.mass * ratio, inertia=body.to_tensor(np.array(s.inertia) * ratio))
            for s in segments
        )
    return replace(
        model,
        segments=segments,
        markers=tuple(_scale_marker(m, factors) for m in model.markers),
        couplers=tuple(_scale_coupler(c, model, factors) for c in model.couplers),
        constraints=tuple(_scale_constraint(c, model, factors) for c in model.constraints),
    )


def _scale_segment(segment: body.Segment, factors: Mapping[str, body.Vector], preserve: bool) -> body.Segment:
    joints = tuple(scale_joint(joint, factors) for joint in segment.joints)
    if segment.name not in factors:
        return replace(segment, joints=joints)
    f = factors[segment.name]
    mass = segment.mass if preserve else segment.mass * abs(f[0] * f[1] * f[2])
    return replace(
        segment,
        joints=joints,
        mass=mass,
        com=body.to_vector(np.array(segment.com) * f),
        inertia=_scale_inertia(segment, mass, np.array(f)),
    )


def scale_joint(joint: body.Joint, factors: Mapping[str, body.Vector]) -> body.Joint:
    """A joint with its translation multiplied by the factors of the segment it scales with."""
    segment = joint.scales_with
    if joint.kind != "translation" or segment is None or segment not in factors:
        return joint
    if joint.size_axis is not None:
        size = float(np.linalg.norm(np.array(joint.size_axis) * np.array(factors[segment])))
        return replace(joint, law=joint.law.scale(size))
    direction: Array = np.array(joint.axis) * np.array(factors[segment])
    length = float(np.linalg.norm(direction))
    if np.count_nonzero(direction) == 1:  # keep a coordinate axis free of rounding
        return replace(joint, law=joint.law.scale(length))
    return replace(joint, axis=body.to_vector(direction / length), law=joint.law.scale(length))


def _scale_marker(marker: body.Marker, factors: Mapping[str, body.Vector]) -> body.Marker:
    if not marker.follows_size or marker.segment not in factors:
        return marker
    f = factors[marker.segment]
    x, y, z = (law.scale(factor) for law, factor in zip(marker.laws, f, strict=True))
    return replace(marker, laws=(x, y, z))


def _scale_coupler(
    coupler: body.Coupler, model: body.BodyModel, factors: Mapping[str, body.Vector]
) -> body.Coupler:
    """A dependent translation grows with the joint that it drives (recognised by the same law)."""
    for _, joint in model.joints():
        if joint.kind == "translation" and joint.scales_with in factors and joint.law == coupler.law:
            return replace(coupler, law=scale_joint(joint, factors).law)
    return coupler


def _scale_constraint(
    constraint: body.Constraint, model: body.BodyModel, factors: Mapping[str, body.Vector]
) -> body.Constraint:
    """Ends follow their segments; what a translation follows grows with the joint that it drives."""
    ends = tuple(_scale_marker(end, factors) for end in constraint.ends)
    if constraint.kind == "law":
        first, *others = constraint.law.terms
        for segment, joint in model.joints():
            driven = joint.kind == "translation" and joint.law == body.Law((replace(first, gain=1.0),))
            if driven and segment.parent in factors:
                size = float(np.linalg.norm(np.array(joint.axis) * np.array(factors[segment.parent])))
                return replace(constraint, law=body.Law((first,)) + body.Law(tuple(others)).scale(size))
    return replace(constraint, ends=ends)


def _scale_inertia(segment: body.Segment, mass: float, f: Array) -> body.Tensor:
    """Inertia after scaling, as OpenSim's Body::scaleInertialProperties."""
    inertia = np.array(segment.inertia)
    if mass <= _MASSLESS:
        return body.to_tensor(0.0 * inertia)
    if np.allclose(f, f[0], rtol=1e-14, atol=0.0):
        return body.to_tensor(inertia * f[0] ** 2 * mass / segment.mass)
    along = int(np.argmin(inertia[:3]))  # of least inertia, ties decided as OpenSim does
    across = 1 if along == 0 else 0
    radius2 = max(0.0, 2.0 * inertia[along] / segment.mass)
    length2 = max(0.0, 12.0 * (inertia[across] / segment.mass - 0.25 * radius2))
    radius2 *= float(np.prod(np.delete(f, along)))
    length2 *= f[along] ** 2
    result = np.full(6, mass * (length2 / 12.0 + 0.25 * radius2))
    result[along] = 0.5 * mass * radius2
    pairs = np.array([f[0] * f[1], f[0] * f[2], f[1] * f[2]])
    result[3:] = inertia[3:] * pairs * mass / segment.mass
    return body.to_tensor(result)
