"""How far a scaled model and its motion are from a truth that is known, as of virtual subjects."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from scaling_service.model.anatomy.lengths import joint_centres, segment_lengths
from scaling_service.model.body import BodyModel, Marker
from scaling_service.model.compile import compile_model, parameter_values
from scaling_service.model.results import Array, Motion
from scaling_service.numerics.multibody.tree import marker_positions


def length_errors(model: BodyModel, truth: BodyModel) -> dict[str, float]:
    """Estimated minus true segment lengths, m, of those that both models have."""
    ours, true = segment_lengths(model), segment_lengths(truth)
    return {name: ours[name] - true[name] for name in ours if name in true}


def centre_errors(
    model: BodyModel, motions: Iterable[Motion], truth: BodyModel, true_q: Mapping[str, Array]
) -> dict[str, float]:
    """Mean distance between estimated and true joint centres in space, m.

    Parameters
    ----------
    motions : iterable of Motion
        Estimated with ``model``.
    true_q : mapping
        Trial to true coordinates, shape (n_frames, n_coordinates) in the order of ``truth``, rad or m.

    Returns
    -------
    dict
        ``hip``, ``knee`` … to the mean over sides, frames and trials.
    """
    gaps: dict[str, list[Array]] = {}
    for motion in motions:
        ours, true = _centres(model, motion.q), _centres(truth, true_q[motion.trial])
        for name in ours:
            gaps.setdefault(_without_side(name), []).append(np.linalg.norm(ours[name] - true[name], axis=1))
    return _pooled(gaps, lambda values: float(np.nanmean(values)))


def angle_errors(
    motions: Iterable[Motion], truth: BodyModel, true_q: Mapping[str, Array]
) -> dict[str, float]:
    """Root mean square difference between estimated and true joint angles, rad.

    Returns
    -------
    dict
        ``hip_flexion``, ``knee_angle`` … to the value over sides, frames and trials. The root's coordinates,
        which are no joint angles, are left out.
    """
    root = {
        term.coordinate
        for segment in truth.children("ground")
        for j in segment.joints
        for term in j.law.terms
    }
    gaps: dict[str, list[Array]] = {}
    for motion in motions:
        for k, coordinate in enumerate(truth.coordinates):
            if coordinate.kind == "rotation" and coordinate.name not in root:
                ours = motion.q[:, motion.coordinates.index(coordinate.name)]
                gaps.setdefault(_without_side(coordinate.name), []).append(ours - true_q[motion.trial][:, k])
    return _pooled(gaps, lambda values: float(np.sqrt(np.nanmean(values**2))))


def _centres(model: BodyModel, q: Array) -> dict[str, Array]:
    """Joint centres in ground, each (n_frames, 3), m."""
    centres = joint_centres(model)
    points = tuple(Marker.at(name, segment, at) for name, (segment, at) in centres.items())
    carrier = model.with_markers(points)
    placed = marker_positions(compile_model(carrier), q, parameter_values(carrier))
    return {point.name: placed[:, k] for k, point in enumerate(points)}


def _pooled(gaps: Mapping[str, list[Array]], measure: Callable[[Array], float]) -> dict[str, float]:
    return {name: measure(np.concatenate(values)) for name, values in gaps.items()}


def _without_side(name: str) -> str:
    return name[:-2] if name.endswith(("_r", "_l")) else name
