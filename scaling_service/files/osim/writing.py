"""From a body model to an .osim file, checked by reading it back."""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.errors import InputError, ModelRefused
from scaling_service.files.osim import plans
from scaling_service.files.osim.process import ask
from scaling_service.files.osim.reading import model_from
from scaling_service.model.body import BodyModel, Coordinate, Marker, Vector
from scaling_service.model.compile import compile_model
from scaling_service.numerics.multibody.tree import marker_positions

Array = NDArray[np.float64]

SAME = 1e-6
"""m; the most that a written model may differ (chosen: a thousandth of a marker's measuring error)."""

_NO_FACTORS: Mapping[str, Vector] = MappingProxyType({})
_NO_TILTS: Mapping[str, tuple[float, float]] = MappingProxyType({})
_CHECKED_POSES = 8
_CHECKED_REACH = 1.0  # rad or m, to either side where a coordinate has no range (chosen)
_GOLDEN = 0.6180339887498949  # fractional part of the golden ratio: spreads poses evenly


def write_osim(
    path: Path,
    model: BodyModel,
    *,
    source: Path | None = None,
    factors: Mapping[str, Vector] = _NO_FACTORS,
    axis_tilts: Mapping[str, tuple[float, float]] = _NO_TILTS,
    mass_kg: float | None = None,
    marker_set: Path | None = None,
    preserve_mass_distribution: bool = True,
    inertia_from_model: bool = False,
) -> None:
    """Write a model for OpenSim, complete or not at all.

    ``path``: the file to write; replaced in one step once the content has been checked.
    ``model``: what the file must represent, with all parameters folded into the laws.
    ``source``: the generic ``.osim`` file it was made from: it is scaled by OpenSim itself with ``factors``
        (muscles, wraps and meshes follow), its joints are tilted, its markers become the model's. Without it
        (built-in models) bodies, joints and markers are made from ``model`` alone, and the arguments below
        are not used, for the model holds them already.
    ``factors``: segment to its x, y, z factors.
    ``axis_tilts``: joint to the turns x and y (rad) of its axes: rotations become T R T^-1, T = Ry(y) Rx(x),
        in the parent's joint frame; translations stay.
    ``mass_kg``: total mass to scale to.
    ``marker_set``: as for reading; the model's markers replace it in the end.
    ``preserve_mass_distribution``: as for OpenSim's scale tool.
    ``inertia_from_model``: take masses, centres of mass and inertias from ``model`` instead of OpenSim's
        scaling.
    Raises DependencyMissing, FileUnreadable: as for reading.
    Raises ModelRefused: if OpenSim cannot represent a component, or the file read back differs from ``model``
        by more than SAME at some pose; ``field`` names it.
    Raises InputError: if the file cannot be written.
    """
    if model.parameters:
        raise ValueError("fold the parameters into the laws before writing a model")
    plans.check_names(model)
    if source is None:
        request = plans.request_to_build(model)
    else:
        request = {
            "operation": "amend",
            "file": str(source.resolve()),
            "marker_set": str(marker_set.resolve()) if marker_set is not None else None,
            "name": plans.model_name(model),
            "factors": {name: list(values) for name, values in factors.items()},
            "axis_tilts": {joint: list(tilt) for joint, tilt in axis_tilts.items()},
            "mass_kg": mass_kg,
            "preserve_mass_distribution": preserve_mass_distribution,
            "bodies": plans.plan_bodies(model) if inertia_from_model else None,
            "coordinates": plans.plan_coordinates(model),
            "markers": plans.plan_markers(model),
        }
    answer = ask(request)
    _check(model, model_from(answer["description"], source=str(path)))
    _replace(path, answer["text"])


def _replace(path: Path, text: str) -> None:
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    try:
        try:
            temporary.write_text(text, encoding="utf-8")
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(
            f"cannot be written ({error.strerror})",
            file=path,
            remedy="Choose a folder that can be written to",
        ) from error


def _check(model: BodyModel, written: BodyModel) -> None:
    """Compare every segment, and every marker, at poses spread over the coordinates' ranges."""
    absent = set(model.segment_names) ^ set(written.segment_names)
    if absent:
        raise ModelRefused(
            f"segment '{min(absent)}' is in one of the models only",
            field=min(absent),
            remedy="Write the model without a source",
        )
    poses = _spread_poses(model.coordinates)
    order = [model.coordinate_names.index(name) for name in written.coordinate_names]
    difference = np.abs(_probed(model, model, poses) - _probed(written, model, poses[:, order]))
    worst = difference.max(axis=(0, 2)).reshape(len(model.segments), -1).max(axis=1)
    for segment, distance in zip(model.segments, worst, strict=True):
        if not distance <= SAME:
            raise ModelRefused(
                f"OpenSim's '{segment.joint_name}' leaves segment '{segment.name}' up to"
                f" {1000 * distance:.3g} mm away from the model's",
                field=segment.joint_name,
                remedy="OpenSim cannot hold this joint exactly; use the JSON model",
            )
    for marker in model.markers:
        shift = np.subtract(marker.nominal, written.marker(marker.name).nominal)
        if written.marker(marker.name).segment != marker.segment or np.abs(shift).max() > SAME:
            raise ModelRefused(f"marker '{marker.name}' was not written as given", field=marker.name)


def _probed(model: BodyModel, order: BodyModel, poses: Array) -> Array:
    """Four points of each segment (in the order of another model's) in ground, (poses, points, 3)."""
    points = [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1)]
    probes = tuple(
        Marker.at(f"{name}/{k}", name, point)
        for name in order.segment_names
        for k, point in enumerate(points)
    )
    return marker_positions(compile_model(model.with_markers(probes)), poses, np.zeros(0))


def _spread_poses(coordinates: tuple[Coordinate, ...]) -> Array:
    """The default pose and a few more, shape (n, n_coordinates): a fixed, evenly spread choice."""
    default = np.array([c.default for c in coordinates])
    lower = np.array([c.lower if np.isfinite(c.lower) else c.default - _CHECKED_REACH for c in coordinates])
    upper = np.array([c.upper if np.isfinite(c.upper) else c.default + _CHECKED_REACH for c in coordinates])
    steps = np.arange(1, _CHECKED_POSES + 1)[:, None] * np.arange(1, len(coordinates) + 1)
    spread: Array = np.vstack([default, lower + (steps * _GOLDEN % 1.0) * (upper - lower)])
    return spread
