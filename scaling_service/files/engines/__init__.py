"""Scaled skeletons for other engines: MuJoCo's MJCF and biorbd's bioMod, with markers and inertia."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from scaling_service.files.engines.biomod import write_biomod
from scaling_service.files.engines.mjcf import write_mjcf
from scaling_service.files.engines.skeleton import Skeleton
from scaling_service.model.body import BodyModel

ENGINES: Mapping[str, tuple[str, Callable[[BodyModel], Skeleton]]] = MappingProxyType(
    {"mjcf": ("model.xml", write_mjcf), "biomod": ("model.bioMod", write_biomod)}
)
"""Format to the file's name and what makes its content."""

__all__ = ["ENGINES", "Skeleton", "write_biomod", "write_mjcf"]
