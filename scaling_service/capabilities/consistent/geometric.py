"""Segment lengths and marker coordinates from a known motion (Futamure et al., eq. 7).

With the joint angles known, markers are linear in lengths and local coordinates: the kinematic regressor.
"""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass, replace

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.errors import TrialUnusable
from scaling_service.model import compile as compiling
from scaling_service.model import parameters
from scaling_service.model.body import BodyModel
from scaling_service.numerics.least_squares.border import minimise_within
from scaling_service.numerics.multibody import tree as trees

FRAMES = 200
"""Frames used of each recording, evenly spaced (chosen: neighbours say the same)."""

_EVEN = 1e-9
"""Share of the mean curvature that keeps what no marker shows at its start (chosen: far below what is
shown)."""


@dataclass(frozen=True, slots=True, eq=False)
class KnownMotion:
    """A recording whose motion is known."""

    name: str
    measured: Array  # (n, n_markers, 3), m: NaN where not seen
    q: Array  # (n, n_coordinates), rad or m: in the model's order


@dataclass(frozen=True, slots=True)
class GeometryPrior:
    """What is known before: the start, with these standard deviations."""

    length_sd: float  # relative
    marker_sd_m: float  # of each coordinate


def identify_geometry(
    model: BodyModel,
    markers: tuple[str, ...],
    fitted: abc.Sequence[KnownMotion],
    expected_m: abc.Mapping[str, float],
    *,
    bound: float,
    axes: str = "xyz",
    prior: GeometryPrior | None = None,
    independent: float = 1.0,
) -> tuple[BodyModel, dict[str, float]]:
    """Identify lengths and marker coordinates: the model with these, and lengths by segment over the start's.

    Markers are in the order of the recordings' columns, weighted by their expected errors. Lengths, and
    marker coordinates by their distance from the segment's origin, stay within a share ``bound`` of their
    start; markers move along the local ``axes``, ``xy`` in a planar model. Without a prior, bounds alone
    hold, as in the paper; ``independent`` is how many frames' worth of errors weigh against it.
    """
    # Every length that moves a marker, and the coordinates of the markers, as parameters.
    free = model.with_markers(tuple(replace(m, follows_size=False) for m in model.markers))
    # Segments whose size carries other segments with markers
    carrying = {model.marker(name).segment for name in markers}
    for part in reversed(model.segments):
        if part.name in carrying:
            carrying.add(part.parent)
    sized = {
        joint.scales_with
        for part, joint in model.joints()
        if part.name in carrying and joint.scales_with is not None and joint.law.terms
    }
    for segment in [s.name for s in model.segments if s.name in sized]:
        free = parameters.free_scale(free, segment, bound)
    for name in markers:
        reach = bound * float(np.linalg.norm(model.marker(name).nominal))
        if reach > 0.0:
            free = parameters.free_marker(free, name, axes, reach)
    freed = free
    start = compiling.list_parameter_values(freed)
    lower = np.array([p.lower for p in freed.parameters])
    upper = np.array([p.upper for p in freed.parameters])
    # Mean over frames of the regressor's normal equations, weighted by the markers' expected errors
    tree = compiling.compile_model(freed, markers)
    columns = len(freed.coordinates) + np.arange(len(start))
    weights = np.array([1.0 / expected_m[name] ** 2 for name in markers])
    normal_equations, slope_equations, frames = np.zeros((len(start), len(start))), np.zeros(len(start)), 0
    for known in fitted:
        rows = np.unique(np.linspace(0, len(known.q) - 1, FRAMES).astype(int))
        poses = trees.pose_links(tree, np.ascontiguousarray(known.q[rows].T), start)
        placed = trees.place_tree_markers(tree, poses)
        gap = np.moveaxis(known.measured[rows], 0, -1) - placed
        seen = np.isfinite(gap)
        heavy = np.where(seen, weights[:, None, None], 0.0).ravel()
        regressor = trees.compute_jacobian(tree, poses, placed, columns).reshape(len(start), -1)
        normal_equations += (regressor * heavy) @ regressor.T
        slope_equations += regressor @ (heavy * np.where(seen, gap, 0.0).ravel())
        frames += len(rows)
    normal, slope = normal_equations / frames, slope_equations / frames
    if not normal.any():
        raise TrialUnusable(
            "no marker is seen in any frame", file=fitted[0].name, field="markers", remedy="Record them again"
        )
    if prior is not None:
        normal, slope = normal * independent, slope * independent
        sds = [prior.length_sd if p.group == "length" else prior.marker_sd_m for p in freed.parameters]
        normal[np.diag_indices_from(normal)] += [1.0 / sd**2 for sd in sds]
    normal[np.diag_indices_from(normal)] += _EVEN * np.trace(normal) / len(normal)
    values, vectors = np.linalg.eigh(normal)
    values = np.maximum(values, 1e-15 * values[-1])
    step = minimise_within(values, vectors, vectors.T @ slope, lower - start, upper - start)
    found = dict(zip((p.name for p in freed.parameters), (start + step).tolist(), strict=True))
    folded = parameters.fold(freed, found)
    sizes = {m.name: m.follows_size for m in model.markers}
    changed = folded.with_markers(tuple(replace(m, follows_size=sizes[m.name]) for m in folded.markers))
    return changed, {p.target: found[p.name] for p in freed.parameters if p.group == "length"}
