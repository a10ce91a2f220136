"""Joints and markers of a model put where a person's are."""

from __future__ import annotations

from collections import abc
from dataclasses import replace

import numpy as np

from scaling_service.capabilities.motion import ranges
from scaling_service.capabilities.motion.inverse_kinematics import solve_task
from scaling_service.capabilities.motion.solving import guess_start, solve_from
from scaling_service.capabilities.motion.task import Task
from scaling_service.core import errors
from scaling_service.core.arrays import Array
from scaling_service.model import body, parameters
from scaling_service.model import compile as compiling
from scaling_service.model.anatomy.markers import find_canonical
from scaling_service.model.places import find_landmarks_by_place
from scaling_service.model.subject import MarkerPlacement
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares import problem
from scaling_service.numerics.multibody import sweep
from scaling_service.numerics.multibody.tree import pose_links

_FEWEST = 3  # landmarks without which a body cannot be placed at all
_SAME_TIME = 1e-9  # s: far less than the step of any recording, far more than rounding
_EXACT = sweep.SweepSettings(max_steps=200, left=1e-12)
_STARTS, _SPREAD = 64, 0.5
"""Chosen: postures from which a static pose is sought, and how far joints lie from the first guess, rad.
Of two standing trials of Rajagopal's model the best minimum is reached from one start in eight or more."""
_MANY_FRAMES = 50  # chosen: enough to average artefact and noise of one pose
_FOLLOWER = 1e-3  # chosen: a thousandth of a known marker's weight, so that it cannot move the pose by 0.1 mm

_NO_PLACE = (None, "T10")
"""Labels that do not say where a marker sits: no landmark, and a vertebra, which is counted by palpation."""


def with_centre(model: body.BodyModel, segment: str, centre: body.Vector) -> body.BodyModel:
    """The model with a segment's joint elsewhere in its parent: its three leading shifts replaced.

    ``segment``: the one that the joint carries.
    ``centre``: (3,) m, in the parent's frame.
    Raises SubjectInvalid: the joint does not start with three plain shifts, as those of built-in models do.
    """
    joints = model.segment(segment).joints
    leading = [j for j in joints[:3] if j.kind == "translation" and j.law.is_constant]
    if len(leading) != 3:
        raise errors.SubjectInvalid(
            f"the centre of '{model.segment(segment).joint_name}' is not three plain shifts",
            field="model",
            remedy="Use a built-in model",
        )
    new: tuple[body.Joint, ...] = tuple(
        replace(j, law=body.Law.constant(value)) for j, value in zip(leading, centre, strict=True)
    )
    segments = tuple(
        replace(s, joints=(*new, *joints[3:])) if s.name == segment else s for s in model.segments
    )
    return replace(model, segments=segments)


def with_axis(model: body.BodyModel, joint: str, tilt: parameters.Tilt) -> body.BodyModel:
    """The model with a joint's axis turned about x, then y, of the parent, rad."""
    freed = parameters.free_axis(model, joint, np.pi, np.pi)
    return parameters.fold(freed, {f"axis.{joint}.x": tilt[0], f"axis.{joint}.y": tilt[1]})


def add_markers(
    model: body.BodyModel, extra: abc.Mapping[str, str], trial: Trial
) -> tuple[body.BodyModel, tuple[str, ...]]:
    """Further markers on named segments, each at its mean local position over a trial.

    The model's pose comes from the markers it has; a marker that the trial does not show is left out. So is
    one on a segment that the pose merely guesses: that bears no marker of the model itself, nor lies between
    two that do. A cluster shows how a bone moves, and its landmarks where the bone is.

    ``extra``: label (already the name that the marker will have) to segment.
    ``trial``: the static trial, or any other in which the markers are seen.
    Returns the model and the markers that were left out for want of a pose.
    Raises TrialUnusable: ``extra`` names a segment that the model does not have.
    """
    wanted = {name: segment for name, segment in extra.items() if name not in model.marker_names}
    unknown = sorted(set(wanted.values()) - set(model.segment_names))
    if unknown:
        raise errors.TrialUnusable(
            f"the model has no segment '{unknown[0]}'",
            field="extra_markers",
            remedy=f"Its segments are {', '.join(model.segment_names)}",
        )
    bearing = {model.marker(name).segment for name in _list_seen(trial, model.marker_names)}
    above = {s.name for s in model.segments if s.parent in (body.GROUND, *bearing)}
    below = {s.parent for s in model.segments if s.name in bearing}
    unposed = tuple(name for name, segment in wanted.items() if segment not in bearing | (above & below))
    wanted = {name: segment for name, segment in wanted.items() if name not in unposed}
    if not wanted:
        return model, unposed
    found = _locate(model, trial, wanted)
    added = tuple(body.Marker.at(n, wanted[n], found[n], anatomical=False) for n in wanted if n in found)
    return model.with_markers((*model.markers, *added)), unposed


def place_tracking_markers(model: body.BodyModel, trial: Trial) -> tuple[body.BodyModel, tuple[str, ...]]:
    """Markers that are no known landmark moved to where a standing trial shows them.

    Where tracking markers sit is each laboratory's own choice, so a generic model's positions say little of
    them: the pose comes from the landmarks, and tracking markers decide only what these leave open, such as
    how far an arm is bent whose wrist has no landmark. Where landmarks do not show how a segment is turned,
    as a heel alone does not show where the foot points, its anatomical markers count as landmarks do.

    Returns the model and the markers moved, none if the landmarks do not determine a pose.
    """
    places = find_landmarks_by_place(model)
    landmarks = [m.name for m in model.markers if m.name in places or find_canonical(m.name) not in _NO_PLACE]
    tracking = {m.name: m.segment for m in model.markers if m.name not in landmarks and m.weight > 0.0}
    known = _list_seen(trial, landmarks)
    if len(known) < _FEWEST or not tracking:
        return model, ()
    open_ = ranges.list_unshown(model, known)
    helped = {s.name for s in model.segments if open_ & ranges.list_joint_coordinates(model, s)}
    weights = dict.fromkeys(landmarks, 1.0) | {
        name: 1.0 if segment in helped and model.marker(name).anatomical else _FOLLOWER
        for name, segment in tracking.items()
    }
    found = _locate(model, trial, tracking, weights)
    return move_markers(model, found), tuple(found)


def place_on(model: body.BodyModel, trial: Trial, segments: frozenset[str]) -> body.BodyModel:
    """The markers of some segments moved to where a standing trial shows them.

    The model is posed by the markers of the other segments, whose places are known; those to be placed
    decide only what these leave open, such as the pose of a leg that was not imaged.
    """
    own = {m.name: m.segment for m in model.markers if m.segment in segments and m.weight > 0.0}
    weights = {m.name: m.weight * (_FOLLOWER if m.name in own else 1.0) for m in model.markers}
    return move_markers(model, _locate(model, trial, own, weights))


def place_markers(model: body.BodyModel, trial: Trial, placement: MarkerPlacement) -> body.BodyModel:
    """OpenSim's marker placer: fit the averaged static pose, then move every marker that is not fixed.

    ``model``: already scaled.
    ``trial``: the static trial.

    OpenSim 4 documentation, "How Scaling Works"; compared with its ScaleTool in the tests.
    """
    # One frame: the mean position of each marker over the frames of the range that show it.
    rows = select_frames(trial, placement.time_range)
    chosen = trial.markers[rows]
    shown = problem.find_shown(chosen)
    mean = np.full(chosen.shape[1:], np.nan)
    mean[shown] = np.nanmean(chosen[:, shown], axis=0)
    pose = Trial(
        name=trial.name,
        times=trial.times[rows][:1],
        labels=trial.labels,
        markers=mean[None],
        rate_hz=trial.rate_hz,
    )
    q = _solve_static_pose(model, pose, placement)
    free = [m.name for m in model.markers if m.name not in placement.fixed]
    found = _average_local_places(model, pose, q, {name: model.marker(name).segment for name in free})
    return move_markers(model, found)


def move_markers(model: body.BodyModel, local: abc.Mapping[str, body.Vector]) -> body.BodyModel:
    """The model with some markers at other local positions (m)."""
    return model.with_markers(
        tuple(
            replace(m, laws=body.Marker.at(m.name, m.segment, local[m.name]).laws) if m.name in local else m
            for m in model.markers
        )
    )


def _locate(
    model: body.BodyModel,
    trial: Trial,
    segments: abc.Mapping[str, str],
    weights: abc.Mapping[str, float] | None = None,
) -> dict[str, body.Vector]:
    """Local positions of labels on their segments, the model posed by its weighted markers, m."""
    few = trial.frames(np.unique(np.linspace(0, trial.n_frames - 1, _MANY_FRAMES).round().astype(np.intp)))
    q = solve_task(Task.of(model, few, weights=weights), few.times).q
    return _average_local_places(model, few, q, segments)


def select_frames(trial: Trial, time_range: tuple[float, float] | None) -> slice:
    """The frames that OpenSim takes for a time range.

    From the last frame at or before its start to the first at or after its end: a range between two
    frames holds both. All frames if no range is given.

    Raises TrialUnusable: the trial does not reach into the range.
    """
    times = trial.times
    if time_range is None:
        return slice(0, len(times))
    start, end = time_range
    if times[-1] < start - _SAME_TIME or times[0] > end + _SAME_TIME:
        raise errors.TrialUnusable(
            f"trial '{trial.name}' has no frame between {start} and {end} s",
            file=trial.name,
            field="time_range",
            remedy="Correct the time range in the scale set-up",
        )
    first = max(int(np.searchsorted(times, start + _SAME_TIME)) - 1, 0)
    last = int(np.searchsorted(times, max(end, times[first]) - _SAME_TIME))
    return slice(first, min(last, len(times) - 1) + 1)


def _solve_static_pose(model: body.BodyModel, pose: Trial, placement: MarkerPlacement) -> Array:
    """Coordinates (1, n) of the static pose under marker and coordinate tasks.

    Shoulders and forearms have several minima; the lowest that is reached from many postures is taken, all of
    which are followed at once, as if they were frames.
    """
    weights = {m.name: placement.marker_weights.get(m.name, 0.0) for m in model.markers}
    task = Task.of(model, pose, weights=weights)
    wanted = compiling.repeat_default_pose(model, 1)
    pull = np.zeros(len(model.coordinates))
    for k, name in enumerate(model.coordinate_names):
        pull[k] = placement.coordinate_weights.get(name, 0.0)
        wanted[0, k] = placement.coordinate_values.get(name, wanted[0, k])
    # OpenSim's marker goal is the weighted mean of the squared distances, not their sum.
    prior = (np.repeat(wanted, _STARTS, axis=0), pull * task.weights.sum())
    repeated = task.in_frames(np.zeros(_STARTS, dtype=np.intp))
    natural = compiling.list_coordinate_ranges(model)
    starts = guess_start(repeated, wanted[0])
    turning = task.free & [c.kind == "rotation" for c in model.coordinates]
    starts[1:] += turning * np.random.default_rng(0).normal(0.0, _SPREAD, starts[1:].shape)

    def solve(start: Array, bounds: tuple[Array, Array]) -> sweep.MotionSolution:
        return solve_from(replace(repeated, bounds=bounds), start, settings=_EXACT, prior=prior)

    found = solve(solve(np.clip(starts, *natural), natural).q, task.bounds)
    return found.q[[int(np.argmin(found.cost))]]


def _average_local_places(
    model: body.BodyModel, trial: Trial, q: Array, segments: abc.Mapping[str, str]
) -> dict[str, body.Vector]:
    """Mean position of labels in their segments' frames over the frames that show them (m)."""
    carriers = [
        body.Marker.at(f"origin of {s}", s, (0.0, 0.0, 0.0)) for s in dict.fromkeys(segments.values())
    ]
    tree = compiling.compile_model(model.with_markers(tuple(carriers)))
    poses = pose_links(tree, np.ascontiguousarray(q.T), np.zeros(tree.n_parameters))
    link = {m.segment: int(k) for m, k in zip(carriers, tree.marker_link, strict=True)}
    present = _list_seen(trial, segments)
    means = {}
    for name in present:
        k = link[segments[name]]
        gap = trial.position(name).T - poses.origins[k]
        local = np.nanmean(np.einsum("jcn,cn->jn", poses.axes[k], gap), axis=1)
        means[name] = (float(local[0]), float(local[1]), float(local[2]))
    return means


def _list_seen(trial: Trial, names: abc.Iterable[str]) -> list[str]:
    return [n for n in names if n in trial.labels and problem.find_seen(trial.position(n)).any()]
