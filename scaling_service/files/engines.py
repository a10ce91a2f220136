"""Scaled models for other engines: MuJoCo's MJCF and biorbd's bioMod."""

from __future__ import annotations

from collections import abc
from types import MappingProxyType

from scaling_service.files.biomod import write_biomod
from scaling_service.files.limbs import Skeleton
from scaling_service.files.mjcf import write_mjcf
from scaling_service.model.body import BodyModel
from scaling_service.model.muscles import Musculature

ENGINES: abc.Mapping[str, tuple[str, abc.Callable[[BodyModel, Musculature | None], Skeleton]]] = (
    MappingProxyType({"mjcf": ("model.xml", write_mjcf), "biomod": ("model.bioMod", write_biomod)})
)
"""Format to the file's name and what makes its content."""
