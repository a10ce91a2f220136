"""What is found on bones, in m, in the image's own axes; and what is said of a mesh that cannot be used."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError

Side = Literal["r", "l"]


@dataclass(frozen=True, slots=True)
class Quality:
    """How well a shape sits on the bone."""

    rms: float  # m; of the distances between surface and shape, over what was fitted
    covered: float  # share of the whole shape that the surface covers, 0 to 1 (for a plane or a tip: 1)


@dataclass(frozen=True, slots=True)
class Sphere:
    """A sphere in the image: ``centre`` (3,) and ``radius`` in m, and its quality."""

    centre: Array
    radius: float
    quality: Quality


@dataclass(frozen=True, slots=True)
class Cylinder:
    """A cylinder in the image: ``point`` (3,) on its ``axis`` (to the subject's right), and ``radius``."""

    point: Array
    axis: Array
    radius: float
    quality: Quality


@dataclass(frozen=True, slots=True, kw_only=True)
class BoneLandmarks:
    """What was found on one bone, and what was refused.

    ``side_from``: ``"shape"``, or ``"name"`` where the bone is too incomplete to say and its name was
    believed. ``axes`` mapping of str to ndarray, shape (3,): unit vectors to the subject's right.
    ``definitions``: how each point is defined, in words. ``refused``: a point that could not be found, and
    why. ``pose_odds``: of the pose of a pelvis against its best rival, as a logarithm to base 10.
    """

    bone: str  # ``femur``, ``tibia``, ``talus`` or ``pelvis``
    side: Side | None  # {"r", "l"}; None for a pelvis
    side_from: str
    points: Mapping[str, Array]  # mapping of str to ndarray, shape (3,), m
    deviations: Mapping[str, float]  # of every point, m; see :mod:`scaling_service.bones.deviations`
    spheres: Mapping[str, Sphere] = field(default_factory=lambda: MappingProxyType({}))
    cylinders: Mapping[str, Cylinder] = field(default_factory=lambda: MappingProxyType({}))
    axes: Mapping[str, Array] = field(default_factory=lambda: MappingProxyType({}))
    axis_deviations: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))  # rad
    definitions: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    refused: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    warnings: tuple[str, ...] = ()
    pose_odds: float | None = None


class MeshRefused(InputError):
    """A mesh is not the bone that it is given as, or too poor to say where its landmarks are."""
