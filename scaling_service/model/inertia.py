"""Mass, centre of mass and inertia of segments: published tables as printed, and arrays for dynamics.

What the tables' numbers mean is described in ``reference_models/README.md``, section "Inertial tables".
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import lru_cache
from typing import Literal

import numpy as np
from pydantic import TypeAdapter

from scaling_service.core import errors
from scaling_service.core.arrays import Array
from scaling_service.model import body, reference
from scaling_service.model.compile import compile_model
from scaling_service.numerics.multibody import motion
from scaling_service.numerics.multibody.tree import Tree

Sex = Literal["F", "M"]

TABLE_NAMES: tuple[str, ...] = ("dumas2007", "dumas_wojtusch2018", "deleva1996", "winter2009")
"""Dumas et al. 2007; Dumas and Wojtusch 2018; de Leva 1996; Winter 2009 (Dempster)."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class InertiaRow:
    """One segment of one sex."""

    segment: str  # thigh, thorax …
    sex: Sex
    mass_pct: float  # of the body's mass
    span: tuple[str, str]
    """Landmarks: where the centre of mass is counted from, and what the length L reaches to."""
    length_mm: float | None  # L of the table's mean subject
    com_pct: tuple[float, ...] | None
    """% of L: three along the segment's axes, or one along the span. None where the table is silent."""
    radii_pct: tuple[float | None, float | None, float | None]
    """Radii of gyration about the centre of mass, axes x, y, z, % of L."""
    products_pct: tuple[float, float, float]
    """xy, xz, yz, % of L: the product of inertia is ``sign * mass * (v L)^2``."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class InertiaTable:
    """One published table."""

    name: str
    source: str
    stature_m: Mapping[str, float]  # sex to the stature of the mean subject
    notes: tuple[str, ...]  # what a user of the table must know
    rows: tuple[InertiaRow, ...]
    fallback: str | None = None  # the table that is asked where this one is silent

    def find(self, segment: str, sex: Sex) -> InertiaRow | None:
        """The row of a segment and sex, None if the table has none."""
        return next((r for r in self.rows if r.segment == segment and r.sex == sex), None)

    def row(self, segment: str, sex: Sex) -> InertiaRow:
        """The row of a segment and sex.

        InputError: the table has none.
        """
        found = self.find(segment, sex)
        if found is None:
            known = ", ".join(dict.fromkeys(r.segment for r in self.rows))
            raise errors.InputError(
                f"table '{self.name}' has no segment '{segment}' for sex '{sex}'",
                field="inertia",
                remedy=f"It has {known}, for F and M",
            )
        return found


@lru_cache(maxsize=16)
def read_inertia_table(name: str) -> InertiaTable:
    """A table by its name.

    InputError: there is no such table; the names are listed.

    Examples
    --------
    >>> read_inertia_table("dumas2007").row("thigh", "M").mass_pct
    12.3
    """
    if name not in TABLE_NAMES:
        raise errors.InputError(
            f"there is no inertial table '{name}'",
            field="inertia",
            remedy=f"Use one of {', '.join(TABLE_NAMES)}",
        )
    content = reference.read_reference(reference.find_reference_folder() / f"inertia_{name}.yaml")
    return TypeAdapter(InertiaTable).validate_python(content)


def compile_mechanism(model: body.BodyModel) -> motion.Mechanism:
    """Compile a model with all its segments, in the model's order, and their inertias.

    The tree carries one marker per segment, at its centre of mass.

    ModelRefused: no segment has mass.
    """
    if not any(s.mass for s in model.segments):
        raise errors.ModelRefused(
            f"no segment of model '{model.name}' has mass",
            field="segments",
            remedy="Give the segments mass, centre of mass and inertia, or apply an inertial table",
        )
    return motion.Mechanism(compile_whole_tree(model), gather_inertias(model))


def compile_whole_tree(model: body.BodyModel) -> Tree:
    """A tree with every segment of the model, in its order, and one marker on each: its centre of mass."""
    return compile_model(
        model.with_markers(tuple(body.Marker.at(s.name, s.name, s.com) for s in model.segments))
    )


def gather_inertias(model: body.BodyModel) -> motion.Inertias:
    """Masses, centres of mass and tensors of all segments, in the model's order."""
    mass = np.array([s.mass for s in model.segments], dtype=float)
    com = np.array([s.com for s in model.segments], dtype=float).reshape(-1, 3)
    tensors = np.array([to_matrix(s.inertia) for s in model.segments]).reshape(-1, 3, 3)
    return motion.Inertias(mass, com, tensors)


def to_matrix(numbers: body.Tensor) -> Array:
    """The matrix (3, 3) of xx, yy, zz, xy, xz, yz."""
    tensor = np.empty((3, 3))
    for (i, j), value in zip(motion.TENSOR, numbers, strict=True):
        tensor[i, j] = tensor[j, i] = value
    return tensor


def with_inertias(model: body.BodyModel, inertias: motion.Inertias) -> body.BodyModel:
    """The model with other masses, centres of mass and tensors, in the order of its segments."""
    segments = tuple(
        dataclasses.replace(s, mass=float(m), com=body.to_vector(c), inertia=take_six(t))
        for s, m, c, t in zip(model.segments, inertias.mass, inertias.com, inertias.tensor, strict=True)
    )
    return dataclasses.replace(model, segments=segments)


def take_six(matrix: Array) -> body.Tensor:
    """xx, yy, zz, xy, xz, yz of a matrix (3, 3)."""
    return body.to_tensor(matrix[i, j] for i, j in motion.TENSOR)


def sum_mass(model: body.BodyModel) -> float:
    """The sum of all segments' masses, kg."""
    return float(sum(s.mass for s in model.segments))
