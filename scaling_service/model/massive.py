"""From a body model to the arrays that dynamics needs: every segment, its mass and its inertia."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scaling_service.core.errors import ModelRefused
from scaling_service.model.body import BodyModel, Marker
from scaling_service.model.compile import compile_model
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.mechanism import TENSOR, Inertias, Mechanism
from scaling_service.numerics.multibody.tree import Tree

Six = tuple[float, float, float, float, float, float]
"""A symmetric tensor as the model holds it: xx, yy, zz, xy, xz, yz."""


def mechanism_of(model: BodyModel) -> Mechanism:
    """Compile a model with all its segments, in the model's order, and their inertias.

    The tree carries one marker per segment, at its centre of mass.

    Raises
    ------
    ModelRefused
        No segment has mass.
    """
    if not any(s.mass for s in model.segments):
        raise ModelRefused(
            f"no segment of model '{model.name}' has mass",
            field="segments",
            remedy="Give the segments mass, centre of mass and inertia, or apply an inertial table",
        )
    return Mechanism(whole_tree(model), inertias_of(model))


def whole_tree(model: BodyModel) -> Tree:
    """A tree with every segment of the model, in its order, and one marker on each: its centre of mass."""
    return compile_model(model.with_markers(tuple(Marker.at(s.name, s.name, s.com) for s in model.segments)))


def inertias_of(model: BodyModel) -> Inertias:
    """Masses, centres of mass and tensors of all segments, in the model's order."""
    mass = np.array([s.mass for s in model.segments], dtype=float)
    com = np.array([s.com for s in model.segments], dtype=float).reshape(-1, 3)
    tensors = np.array([tensor_of(s.inertia) for s in model.segments]).reshape(-1, 3, 3)
    return Inertias(mass, com, tensors)


def tensor_of(numbers: Six) -> Array:
    """The matrix (3, 3) of xx, yy, zz, xy, xz, yz."""
    tensor = np.empty((3, 3))
    for (i, j), value in zip(TENSOR, numbers, strict=True):
        tensor[i, j] = tensor[j, i] = value
    return tensor


def with_inertias(model: BodyModel, inertias: Inertias) -> BodyModel:
    """The model with other masses, centres of mass and tensors, in the order of its segments."""
    segments = tuple(
        replace(s, mass=float(m), com=(float(c[0]), float(c[1]), float(c[2])), inertia=six(t))
        for s, m, c, t in zip(model.segments, inertias.mass, inertias.com, inertias.tensor, strict=True)
    )
    return replace(model, segments=segments)


def six(tensor: Array) -> Six:
    """xx, yy, zz, xy, xz, yz of a matrix (3, 3)."""
    xx, yy, zz, xy, xz, yz = (float(tensor[i, j]) for i, j in TENSOR)
    return (xx, yy, zz, xy, xz, yz)


def total_mass(model: BodyModel) -> float:
    """The sum of all segments' masses, kg."""
    return float(sum(s.mass for s in model.segments))
