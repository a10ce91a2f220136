"""Bodies with mass for tests, and a slow oracle for those made of point masses."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scaling_service.model.body import BodyModel, Segment
from scaling_service.numerics.multibody.motion import Motion
from tests.numerics.bodies import named, slow_jacobian, slow_markers

Array = NDArray[np.float64]
GRAVITY = np.array([0.3, -9.7, 0.2])
"""Not along an axis, so that a mixed-up one shows."""


def with_random_masses(model: BodyModel, rng: np.random.Generator) -> BodyModel:
    """Every segment with mass, centre of mass and a possible tensor."""
    return replace(model, segments=tuple(_random_mass(s, rng) for s in model.segments))


def _random_mass(segment: Segment, rng: np.random.Generator) -> Segment:
    cloud = rng.normal(size=(8, 3)) * rng.uniform(0.05, 0.2, 3)
    return _as_cloud(segment, cloud, rng.uniform(0.1, 2.0, 8))


def as_point_masses(model: BodyModel, masses: Array) -> BodyModel:
    """Every segment weighs what point masses at its markers weigh."""
    segments = []
    for segment in model.segments:
        own = [k for k, m in enumerate(model.markers) if m.segment == segment.name]
        segments.append(_as_cloud(segment, np.array([model.markers[k].nominal for k in own]), masses[own]))
    return replace(model, segments=tuple(segments))


def _as_cloud(segment: Segment, points: Array, masses: Array) -> Segment:
    mass = masses.sum()
    com = masses @ points / mass
    d = points - com
    tensor = np.einsum("i,ij,ik->jk", masses, d, d)
    tensor = np.trace(tensor) * np.eye(3) - tensor
    six = tuple(float(tensor[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    return replace(segment, mass=float(mass), com=tuple(com.tolist()), inertia=six)


def slow_forces(model: BodyModel, masses: Array, state: tuple[Array, Array, Array], p: Array) -> Array:
    """Generalised forces of point masses at the markers, one frame, by d'Alembert's principle.

    ``sum_i m_i (a_i - g) . dx_i/dq`` with ``a = J qddot + dJ/dt qdot``; the Jacobian is exact (complex
    step), its rate a central difference.
    """
    q, qdot, qddot = (x[None] for x in state)
    names = model.coordinate_names
    step = 1e-5
    J = slow_jacobian(model, q, p, names)[0]
    ahead, behind = (slow_jacobian(model, q + s * step * qdot, p, names)[0] for s in (1, -1))
    acceleration = J @ qddot[0] + (ahead - behind) @ qdot[0] / (2 * step)
    forces: Array = np.einsum("i,ia,iac->c", masses, acceleration - GRAVITY, J)
    return forces


def slow_points(model: BodyModel, q: Array, p: Array) -> Array:
    """Marker places of one frame, (n_markers, 3)."""
    return np.asarray(slow_markers(model, named(model, q[None], p, 0)).real)


def random_motion(rng: np.random.Generator, n_coordinates: int, n: int, size: float = 1.0) -> Motion:
    """Unrelated random positions, velocities and accelerations."""
    return Motion(*(size * rng.uniform(-1.5, 1.5, (3, n_coordinates, n))))


def in_pinocchio(pin: Any, model: BodyModel) -> tuple[Any, NDArray[np.intp]]:
    """The same tree with the same masses in Pinocchio, and which coordinate each of its joints is."""
    peer, order = pin.Model(), []
    peer.gravity.linear = GRAVITY
    carrier = {"ground": (0, pin.SE3.Identity())}
    for segment in model.segments:
        joint, placement = carrier[segment.parent]
        for move in segment.joints:
            axis, turns = np.array(move.axis), move.kind == "rotation"
            if move.law.is_constant:
                value = move.law.constant_part
                moved = (
                    pin.SE3(pin.exp3(axis * value), np.zeros(3))
                    if turns
                    else pin.SE3(np.eye(3), axis * value)
                )
                placement = placement * moved
                continue
            kind = pin.JointModelRevoluteUnaligned if turns else pin.JointModelPrismaticUnaligned
            name = move.law.terms[0].coordinate
            joint = peer.addJoint(joint, kind(axis), placement, name)
            placement = pin.SE3.Identity()
            order.append(model.coordinate_names.index(name))
        xx, yy, zz, xy, xz, yz = segment.inertia
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        peer.appendBodyToJoint(joint, pin.Inertia(segment.mass, np.array(segment.com), tensor), placement)
        carrier[segment.name] = (joint, placement)
    return peer, np.array(order)
