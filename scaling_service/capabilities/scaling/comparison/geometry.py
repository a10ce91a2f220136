"""The bodies that methods make: lengths, centres, axes; how plausible they are, and how far from a truth."""

from __future__ import annotations

import math
from collections import abc
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.motion.kinematic_error import KinematicError
from scaling_service.capabilities.scaling.methods.osim_image_based import find_axis_in_parent
from scaling_service.core.arrays import Array
from scaling_service.core.names import say_name
from scaling_service.model import body, parameters, results
from scaling_service.model import compile as compiling
from scaling_service.model.anatomy import lengths as anatomy_lengths
from scaling_service.model.poses import straighten
from scaling_service.numerics.multibody.tree import pose_markers

_CORNERS: tuple[body.Vector, ...] = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""The origin of a frame and the ends of its axes, m."""

FOLLOWED_M = 0.04
"""Mean distance between measured and model markers beyond which something is mixed up (OpenSim 4
documentation, "Getting Started with Inverse Kinematics": even the largest should stay below 2 to 4 cm)."""

SHARE_OF_STATURE = {"femur": 0.2454, "shank": 0.2356}
"""Between joint centres, mean of 26 persons (Puchaud 2019, table 2, over their mean stature of 1.762 m)."""

SPREAD = 0.2
"""Chosen: about four standard deviations of those shares over persons (5.3 % and 5.5 %, same source)."""


@dataclass(frozen=True, slots=True)
class Geometry:
    """The geometry of a scaled model, named.

    ``lengths``: ``inter_hip``, ``femur_r``, ``shank_r`` … to m, at a straight pose.
    ``joint_centres``: ``hip_r`` … to (segment, position in its frame, m).
    ``knee_axes``: ``r`` or ``l`` to the turns of the knee axis about x and y of the thigh, rad.
    ``marker_shifts``: marker to how far a fit moved it on its segment, m.
    """

    lengths: abc.Mapping[str, float]
    joint_centres: abc.Mapping[str, tuple[str, body.Vector]]
    knee_axes: abc.Mapping[str, tuple[float, float]]
    marker_shifts: abc.Mapping[str, float]


def measure_geometry(calibration: results.Calibration) -> Geometry:
    """Lengths, joint centres, knee axes and marker shifts of a calibration's model."""
    # The turns of each knee's axis from z of the thigh
    tilts = dict(calibration.axis_tilts)
    values = straighten(calibration.model)
    for segment in calibration.model.segments:
        move = calibration.joint_moves.get(segment.joint_name)
        thigh = calibration.model.bone_of(segment.parent).startswith("femur")
        if thigh and move is not None and any(move.turn):
            axis = find_axis_in_parent(segment, values)
            tilts[segment.joint_name] = parameters.tilt_of(axis if axis[2] > 0.0 else -axis)
    # `r` for `knee_r` or `walker_knee_r`; the joint's own name where it says no side
    ends = {joint: joint.rpartition("_")[2].lower() for joint in tilts}
    return Geometry(
        anatomy_lengths.measure_segment_lengths(calibration.model),
        anatomy_lengths.find_joint_centres(calibration.model),
        {ends[joint] if ends[joint] in ("r", "l") else joint: tilt for joint, tilt in tilts.items()},
        measure_marker_shifts(calibration),
    )


def measure_marker_shifts(calibration: results.Calibration) -> dict[str, float]:
    """How far a fit moved each marker on its segment, beyond following the segment's size, m.

    The length of the variation of its local coordinates (Puchaud 2019, section 3.1), zero where the
    method fits no marker.
    """
    shifts = {marker.name: 0.0 for marker in calibration.model.markers if marker.weight > 0.0}
    for parameter in calibration.parameters:
        if parameter.group == "marker":
            shifts[parameter.target] = math.hypot(shifts[parameter.target], parameter.value)
    return shifts


def place_centres(
    model: body.BodyModel, q: Array, reference: body.BodyModel, reference_q: Array
) -> dict[str, body.Vector]:
    """A model's joint centres in the segments of a reference that moves alongside.

    Two models' own segment frames may lie differently in the body, so their local coordinates do not
    compare. In space they do, and the reference's proximal segment is the frame to look from.

    ``q``, ``reference_q`` ((n_frames, n_coordinates), rad or m): of the same frames, each in its model's
        order.
    Returns ``hip_r``, ``knee_r`` … that both have to the mean over frames, m; frames that do not determine it
        are left out. The reference seen from itself gives its own local coordinates.
    """
    theirs = anatomy_lengths.find_joint_centres(reference)
    points = {name: at for name, at in anatomy_lengths.find_joint_centres(model).items() if name in theirs}
    placed = _in_ground(model, q, points)
    frames = {segment for name, (segment, _) in theirs.items() if name in points}
    corners = _in_ground(
        reference,
        reference_q,
        {f"{segment} {k}": (segment, at) for segment in frames for k, at in enumerate(_CORNERS)},
    )
    found = {}
    for name, point in placed.items():
        origin, *ends = (corners[f"{theirs[name][0]} {k}"] for k in range(4))
        axes = np.stack(ends, axis=1) - origin[:, None]
        local = np.einsum("nij,nj->ni", axes, point - origin)
        known = local[np.isfinite(local).all(axis=1)]
        if len(known):
            found[name] = body.to_vector(known.mean(axis=0))
    return found


def _in_ground(
    model: body.BodyModel, q: Array, points: abc.Mapping[str, tuple[str, body.Vector]]
) -> dict[str, Array]:
    """Points of segments over all frames, each (n_frames, 3), m."""
    carrier = model.with_markers(tuple(body.Marker.at(name, *place) for name, place in points.items()))
    placed = pose_markers(compiling.compile_model(carrier), q, compiling.list_parameter_values(carrier))
    return {name: placed[:, k] for k, name in enumerate(points)}


def list_joint_angles(model: body.BodyModel) -> tuple[str, ...]:
    """The coordinates that are angles of joints: turns, but not those of the whole body in the laboratory."""
    root = {
        term.coordinate
        for segment in model.children(body.GROUND)
        for joint in segment.joints
        for term in joint.law.terms
    }
    return tuple(c.name for c in model.coordinates if c.kind == "rotation" and c.name not in root)


def compute_length_errors(model: body.BodyModel, truth: body.BodyModel) -> dict[str, float]:
    """Estimated minus true segment lengths, m, of those that both models have."""
    ours, true = (
        anatomy_lengths.measure_segment_lengths(model),
        anatomy_lengths.measure_segment_lengths(truth),
    )
    return {name: ours[name] - true[name] for name in ours if name in true}


def compute_centre_errors(
    model: body.BodyModel,
    motions: abc.Iterable[results.Motion],
    truth: body.BodyModel,
    true_q: abc.Mapping[str, Array],
) -> dict[str, float]:
    """Mean distance between estimated and true joint centres in space, m.

    ``motions``: estimated with ``model``.
    ``true_q``: trial to true coordinates, shape (n_frames, n_coordinates) in the order of ``truth``, rad or
        m.
    Returns ``hip``, ``knee`` … to the mean over sides, frames and trials.
    """
    gaps: dict[str, list[Array]] = {}
    for motion in motions:
        ours = _in_ground(model, motion.q, anatomy_lengths.find_joint_centres(model))
        true = _in_ground(truth, true_q[motion.trial], anatomy_lengths.find_joint_centres(truth))
        for name in ours:
            gaps.setdefault(_without_side(name), []).append(np.linalg.norm(ours[name] - true[name], axis=1))
    return _pool_errors(gaps, lambda values: float(np.nanmean(values)))


def compute_angle_errors(
    motions: abc.Iterable[results.Motion], truth: body.BodyModel, true_q: abc.Mapping[str, Array]
) -> dict[str, float]:
    """Root mean square difference between estimated and true joint angles, rad.

    Returns ``hip_flexion``, ``knee_angle`` … to the value over sides, frames and trials. The root's
    coordinates, which are no joint angles, are left out.
    """
    gaps: dict[str, list[Array]] = {}
    for motion in motions:
        for name in list_joint_angles(truth):
            true = true_q[motion.trial][:, truth.coordinate_names.index(name)]
            gaps.setdefault(_without_side(name), []).append(motion.column(name) - true)
    return _pool_errors(gaps, lambda values: float(np.sqrt(np.nanmean(values**2))))


def _pool_errors(
    gaps: abc.Mapping[str, list[Array]], measure: abc.Callable[[Array], float]
) -> dict[str, float]:
    return {name: measure(np.concatenate(values)) for name, values in gaps.items()}


def _without_side(name: str) -> str:
    return name[:-2] if name.endswith(("_r", "_l")) else name


def list_doubts(
    errors: abc.Mapping[str, abc.Mapping[str, KinematicError]],
    lengths: abc.Mapping[str, abc.Mapping[str, float]],
    height_m: float | None,
) -> tuple[str, ...]:
    """What a reader should look at before believing any number.

    ``errors``, ``lengths``: method to trial to error, and method to length (``femur_r`` …) to m.
    One plain sentence each.
    """
    lost: list[str] = []
    trials = dict.fromkeys(trial for by_trial in errors.values() for trial in by_trial)
    for trial in trials:
        best = min(by_trial[trial].mean for by_trial in errors.values() if trial in by_trial)
        if best > FOLLOWED_M:
            lost.append(
                f"no model follows the markers of '{trial}' better than {1e3 * best:.0f} mm on average: "
                f"check its labels and unit, and that all recordings are of one person"
            )
    if height_m is not None:
        names = list(dict.fromkeys(name for found in lengths.values() for name in found))
        usual = estimate_usual_lengths(height_m, names)
        odd = {method: list_unusual(found, usual) for method, found in lengths.items()}
        for name in names:
            shown = [f"{1e3 * lengths[m][name]:.0f} mm ({m})" for m, own in odd.items() if name in own]
            if shown:
                lost.append(
                    f"{say_name(name)} of {', '.join(shown)} is unusual for a height of {height_m:.2f} m "
                    f"({1e3 * usual[name]:.0f} mm on average): check the height, the unit and the labels"
                )
    return tuple(lost)


def estimate_usual_lengths(height_m: float | None, names: abc.Iterable[str]) -> dict[str, float]:
    """Length to what is usual for a height, m; empty where the height is not known."""
    shares = {name: SHARE_OF_STATURE.get(name.rpartition("_")[0]) for name in names}
    return {name: height_m * share for name, share in shares.items() if height_m is not None and share}


def list_unusual(lengths: abc.Mapping[str, float], usual: abc.Mapping[str, float]) -> tuple[str, ...]:
    """The lengths that differ from the usual ones by more than persons of one height do."""
    known = {name: length for name, length in lengths.items() if name in usual}
    return tuple(name for name, v in known.items() if abs(v - usual[name]) > SPREAD * usual[name])
