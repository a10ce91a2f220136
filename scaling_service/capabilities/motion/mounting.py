"""Rotations that a system measures, as observations of a model beside its markers.

A rotation R is three directions, the axes of its frame: points at infinity, which turn with their segment and
know nothing of where it is. Three directions of length L that miss by a turn of angle a are off by
``8 L^2 sin(a/2)^2`` in squares, ``2 L^2 a^2`` to within a thousandth up to 12 deg: the squared length of
log(R_measured^T R_model), weighed. So they go through every solver that markers go through.

Each system's frame hangs on its segment by a mounting: three turns that are shared by all frames of all
recordings, with a prior about what a system's axes or a pose say. Sensors also have a heading: which way their
world faces when the person stands as the model does. They are parameters of the model and solved with the
motion; what is left open of them goes into every deviation.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np

from scaling_service.capabilities.motion.everyday import pack_posterior, pose_problem
from scaling_service.capabilities.motion.solving import solve_from
from scaling_service.capabilities.motion.task import Task, guess_start
from scaling_service.core.arrays import Array
from scaling_service.core.errors import TrialUnusable
from scaling_service.core.notes import Note
from scaling_service.core.text import list_few
from scaling_service.model.anatomy.lengths import find_joint_ends
from scaling_service.model.anatomy.rotations import (
    RotationTable,
    is_ignored,
    match_rotation,
    read_rotation_table,
)
from scaling_service.model.body import BodyModel, Joint, Law, Marker, Parameter, Segment, Term, to_vector
from scaling_service.model.compile import list_coordinate_ranges, repeat_default_pose
from scaling_service.model.freed import UNBOUNDED
from scaling_service.model.parameters import LETTERS, UNITS
from scaling_service.model.people import read_people
from scaling_service.model.poses import pose_neutral_frames
from scaling_service.model.trial import Rotations, Trial
from scaling_service.numerics.least_squares.posterior import solve_posterior
from scaling_service.numerics.least_squares.whitening import GaussianPrior
from scaling_service.numerics.multibody.sweep import SweepSettings
from scaling_service.numerics.multibody.rigid import (
    convert_rotation_to_vector,
    find_nearest_rotation,
    rotate_about,
)

_MARKER_M = 0.010  # the marker beside which rotations are weighed; motion/ranges.py has its source
_HEADING = "heading"
_HEADINGS_DEG = 30.0  # chosen: step of the headings that are tried; steps of Gauss-Newton go on from the best
_HEADING_SD = np.pi / np.sqrt(3.0)  # rad: any way round is as likely
_LOOKED_AT = 12  # chosen: frames, evenly spaced, by which hypotheses are compared
_SOLVED = 40  # chosen: frames, evenly spaced, that tell of the mounting
_ROUGH = SweepSettings(left=2e-2)  # chosen: hypotheses differ by more
_SHAPES = tuple(
    turn
    for order in permutations(range(3))
    for signs in product((1.0, -1.0), repeat=3)
    if np.linalg.det(turn := np.diag(signs)[list(order)]) > 0.0
)
"""The 24 ways to name the axes of a frame."""

_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""From a world with z up to ours, by the smallest turn."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Noise:
    """How one rotation errs about each axis, rad: what passes from frame to frame, and what lasts."""

    passing: float
    lasting: float
    white: float

    @classmethod
    def of(cls, table: RotationTable, white: float, passing: float) -> Noise:
        """``passing``: where it is more than people's; what is left of people's whole lasts."""
        passing = max(white, passing, table.passing)
        lasting = max(float(np.sqrt(max(table.total**2 - passing**2, 0.0))), table.lasting)
        return cls(passing=passing, lasting=lasting, white=white)

    @property
    def arm(self) -> float:
        """Length of its directions, m, at which their tips err as a marker does."""
        return float(_MARKER_M / (np.sqrt(2.0) * np.hypot(self.passing, self.lasting)))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Mounted:
    """A model that carries the frames of the rotations, recordings with their directions, and what to tell."""

    model: BodyModel
    trials: tuple[Trial, ...]
    segments: Mapping[str, str]  # label to the segment it is on
    notes: tuple[Note, ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Hypothesis:
    """What frames and their world may be.

    ``turn`` (3, 3): from the recordings' world to ours. ``before``, ``after``: label to the constant turns of
    its mounting, which is before · (turn about y by the heading) · after.
    """

    told: str
    turn: Array
    before: Mapping[str, Array]
    after: Mapping[str, Array]
    heading: float | None = None  # rad; None where a person's heading is not told by a pose
    calibrated: bool = False


def mount(
    model: BodyModel, trials: Sequence[Trial], standing: Trial | None = None, *, turned: bool = False
) -> Mounted:
    """Put the frames of all rotations on a model, and find how they are mounted.

    ``trials``: in the session's axes, but for sensors, whose world is found here unless ``turned`` says that it
    is the session's. ``standing``: sensors' orientations while the person stands as the model does by default;
    else the first frame of the first recording is taken so, unless sensors have the segments' own axes.

    Raises TrialUnusable: no rotation belongs to a segment of the model.
    """
    table, measured = read_rotation_table(), [t for t in trials if t.rotations is not None]
    labels = dict.fromkeys(label for t in measured for label in _get(t).labels)
    matched = {label: match_rotation(label, model) for label in labels}
    segments = {label: segment for label, segment in matched.items() if segment is not None}
    if not segments:
        raise TrialUnusable(
            f"none of its rotations ({list_few(list(labels))}) is on a segment of model '{model.name}'",
            file=measured[0].name,
            field="ROTATION:LABELS" if _get(measured[0]).of == "segments" else "columns",
            remedy=f"Name them as the segments are: {list_few(list(model.segment_names))}",
        )
    noise = {label: _measure_noise(table, measured, label) for label in segments}
    hypotheses = [*_list_hypotheses(model, table, measured, segments, standing, turned=turned)]
    chosen, misfits = _choose(model, measured, segments, noise, hypotheses)
    calibrating = None
    if chosen.calibrated:
        calibrating = 1 if standing is None else standing.n_frames

    def solve(one: _Hypothesis) -> tuple[BodyModel, float, tuple[Trial, ...]]:
        placed = _add_frames(model, segments, noise, one, table, measured)
        ready = tuple(_with_directions(t, segments, noise, one) if t in measured else t for t in trials)
        found, level = _solve(placed, ready, segments, noise, calibrating)
        return found, level, ready

    solved, level, ready = solve(chosen)
    facing = None
    if chosen.heading is not None:
        # Forward is where the person faces in that pose, as OpenSense has it.
        facing = next(p.value for p in solved.parameters if p.name == _HEADING)
        back = rotate_about((0.0, 1.0, 0.0), -facing)
        after = {label: back @ turn for label, turn in chosen.after.items()}
        chosen = replace(chosen, turn=back @ chosen.turn, after=after, heading=0.0)
    if level > 1.0 or chosen.heading is not None:
        # What the model does not follow passes, too: never less than people's, more where it is more.
        noise = {label: Noise.of(table, own.white, max(level, 1.0) * own.passing) for label, own in noise.items()}
        solved, _, ready = solve(chosen)
    return Mounted(
        model=solved,
        trials=ready,
        segments={label: segments[label] for label in segments if label in chosen.before},
        notes=tuple(_tell(matched, noise, chosen, misfits, facing)),
    )


def _get(trial: Trial) -> Rotations:
    assert trial.rotations is not None
    return trial.rotations


def _take(trial: Trial, label: str) -> Array:
    """One rotation, (n_frames, 3, 3); NaN where not measured, or not in this recording."""
    held = _get(trial)
    if label not in held.labels:
        return np.full((trial.n_frames, 3, 3), np.nan)
    return held.matrices[:, held.labels.index(label)]


def _measure_noise(table: RotationTable, trials: Sequence[Trial], label: str) -> Noise:
    """The whole of it is people's; the white part is measured, and what is left of the whole lasts.

    White noise of variance v has third differences of 20 v, and a movement hardly any at a camera's rate.
    """
    found = [np.zeros((0, 3))]
    for trial in trials:
        turns = _take(trial, label)
        steps = convert_rotation_to_vector(np.where(np.isfinite(turns[:-1]), turns[:-1].swapaxes(1, 2), np.nan) @ turns[1:])
        found.append(np.diff(steps, n=2, axis=0))
    sizes = np.abs(np.concatenate(found)).ravel()
    sizes = sizes[np.isfinite(sizes)]
    white = 1.4826 * float(np.median(sizes)) / np.sqrt(20.0) if len(sizes) else 0.0
    return Noise.of(table, white, white)


def _list_hypotheses(
    model: BodyModel,
    table: RotationTable,
    trials: Sequence[Trial],
    segments: Mapping[str, str],
    standing: Trial | None,
    *,
    turned: bool,
) -> Iterator[_Hypothesis]:
    same = dict.fromkeys(segments, np.eye(3))
    if _get(trials[0]).of == "segments":
        yield from _list_axes(table, trials, segments)
        return
    worlds = {"as given": np.eye(3)} if turned else {"y up": np.eye(3), "z up": _Z_UP}
    # Where sensors have the segments' own axes, these say which way is up.
    ups = [m[:, 1] for label in _list_upright(segments) if (m := _average_plain(trials, label)) is not None]
    mean = np.sum(ups, axis=0)
    own = max(worlds, key=lambda world: float(worlds[world][1] @ mean))
    yield _Hypothesis(
        told=f"sensors' axes are those of their segments, their world is {own}",
        turn=worlds[own],
        before=same,
        after=same,
    )
    neutral = pose_neutral_frames(model)
    calibrating = trials[0] if standing is None else standing
    rows = slice(0, 1) if standing is None else slice(None)
    pose = {label: _average(_take(calibrating, label)[rows]) for label in segments}
    for world, turn in worlds.items():
        known = {label: turn @ first for label, first in pose.items() if first is not None}
        before = {label: neutral[segments[label]][0].T for label in known}
        where = "the first frame" if standing is None else f"'{calibrating.name}'"
        for degrees in np.arange(-180.0, 180.0, _HEADINGS_DEG):
            yield _Hypothesis(
                told=f"the person stands in {where} as the model does by default, the sensors' world is {world}",
                turn=turn,
                before=before,
                after=known,
                heading=float(np.radians(degrees)),
                calibrated=True,
            )


def _average(turns: Array) -> Array | None:
    """The mean of some rotations (n, 3, 3); None where all are unknown."""
    known = turns[np.isfinite(turns).all(axis=(1, 2))]
    return find_nearest_rotation(known.mean(axis=0)) if len(known) else None


def _list_axes(
    table: RotationTable, trials: Sequence[Trial], segments: Mapping[str, str]
) -> Iterator[_Hypothesis]:
    """The axes of a markerless system: as documented; others where pelvis, trunk and legs point otherwise.

    Up is the axis that is nearest to the vertical on average, and right the one along the line of the hips.
    """
    means = [m for label in _list_upright(segments) if (m := _average_plain(trials, label)) is not None]
    vertical = np.array([m.T @ [0.0, 1.0, 0.0] for m in means]).sum(axis=0)
    across = np.zeros(3)
    for trial in trials:
        held = _get(trial)
        row = {segments[x]: k for k, x in enumerate(held.labels) if x in segments}
        if held.origins is not None and {"femur_r", "femur_l", "pelvis"} <= row.keys():
            line = held.origins[:, row["femur_r"]] - held.origins[:, row["femur_l"]]
            local = np.einsum("nji,nj->ni", held.matrices[:, row["pelvis"]], line)
            across += np.nansum(local, axis=0)
    scores = []
    for shape in _SHAPES:
        score = shape[1] @ vertical / np.linalg.norm(vertical)
        if np.linalg.norm(across) > 0.0:
            score += shape[2] @ across / np.linalg.norm(across)
        scores.append((float(score), shape))
    best = max(score for score, _ in scores)
    fitting = [shape for score, shape in scores if score > best - 1e-6]
    documented = next((s for s in fitting if np.array_equal(s, table.axes)), None)
    chosen = documented if documented is not None else next(
        (s for s in fitting if np.array_equal(s, np.eye(3))), fitting[0]
    )
    names = [("-" if row.sum() < 0 else "") + "xyz"[int(np.abs(row).argmax())] for row in chosen]
    told = f"segments' axes are {names[0]} forward, {names[1]} up, {names[2]} right"
    said = ", as documented" if documented is not None else ", by where they point in the recordings"
    yield _Hypothesis(
        told=told + said, turn=np.eye(3), before=dict.fromkeys(segments, chosen), after=dict.fromkeys(segments, np.eye(3))
    )


_UPRIGHT = ("pelvis", "torso", "thorax", "femur", "tibia")


def _list_upright(segments: Mapping[str, str]) -> list[str]:
    """Labels of what stands more or less upright, all where nothing does."""
    return [x for x, name in segments.items() if name.lower().startswith(_UPRIGHT)] or list(segments)


def _average_plain(trials: Sequence[Trial], label: str) -> Array | None:
    every = np.concatenate([_take(trial, label) for trial in trials])
    known = every[np.isfinite(every).all(axis=(1, 2))]
    return known.mean(axis=0) if len(known) else None


def _choose(
    model: BodyModel,
    trials: Sequence[Trial],
    segments: Mapping[str, str],
    noise: Mapping[str, Noise],
    hypotheses: Sequence[_Hypothesis],
) -> tuple[_Hypothesis, dict[str, float]]:
    """The hypothesis under which the model follows the rotations best, and the misfit of each kind, rad."""
    if len(hypotheses) == 1:
        return hypotheses[0], {}
    found: dict[str, tuple[float, _Hypothesis]] = {}
    bare = model.with_markers(())
    for one in hypotheses:
        placed = _add_frames(bare, segments, noise, one, None, ())
        some = [_with_directions(_pick(t, _LOOKED_AT), segments, noise, one) for t in trials]
        misfit, count = 0.0, 0
        for trial in some:
            task = Task.of(placed, trial)
            task = replace(task, bounds=list_coordinate_ranges(placed))
            neutral = repeat_default_pose(placed, 1)[0]
            start = guess_start(task.tree, task.measured, neutral, task.p, task.free)
            solution = solve_from(task, slice(None), start, settings=_ROUGH)
            misfit += float(solution.cost.sum())
            count += int(np.isfinite(task.measured[:, ::3, 0]).sum())
        angle = float(np.sqrt(misfit / max(count, 1)) / _MARKER_M * read_rotation_table().total)
        if one.told not in found or angle < found[one.told][0]:
            found[one.told] = angle, one
    best = min(found.values(), key=lambda pair: pair[0])[1]
    return best, {told: angle for told, (angle, _) in found.items()}


def _pick(trial: Trial, count: int) -> Trial:
    rows = np.unique(np.linspace(0, trial.n_frames - 1, min(count, trial.n_frames)).round().astype(np.intp))
    return trial.frames(rows)


def _turn_by(matrix: Array) -> tuple[Joint, ...]:
    """A constant rotation as a joint."""
    vector = convert_rotation_to_vector(matrix)
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return ()
    return (Joint("rotation", to_vector(vector / angle), Law.constant(angle)),)


def _name_parameters(label: str) -> list[str]:
    return [f"mounting.{label}.{letter}" for letter in LETTERS]


def _add_frames(
    model: BodyModel,
    segments: Mapping[str, str],
    noise: Mapping[str, Noise],
    chosen: _Hypothesis,
    table: RotationTable | None,
    trials: Sequence[Trial],
) -> BodyModel:
    """The model with a frame for every rotation, its directions as markers, and its mounting as parameters.

    ``table``: where given, hips that a markerless system tells are points of the pelvis, too.
    """
    added, markers, parameters = [], [], []
    about_y = (0.0, 1.0, 0.0)
    if chosen.heading is not None:
        parameters.append(_make_parameter(_HEADING, chosen.heading))
    for label, segment in segments.items():
        if label not in chosen.after:
            continue
        heading: tuple[Joint, ...] = ()
        if chosen.heading is not None:
            heading = (Joint("rotation", about_y, Law((Term(-1.0, parameter=_HEADING),))),)
        names = _name_parameters(label)
        turns = tuple(
            Joint("rotation", axis, Law((Term(1.0, parameter=name),)))
            for axis, name in zip(UNITS, names, strict=True)
        )
        joints = (*_turn_by(chosen.before[label]), *heading, *_turn_by(chosen.after[label]), *turns)
        frame = f"frame of {label}"
        added.append(Segment(name=frame, parent=segment, joint_name=frame, joints=joints))
        parameters += [_make_parameter(name, 0.0) for name in names]
        own = noise[label]
        size = float(np.sqrt(2.0) * own.arm * own.passing)
        for letter, axis in zip(LETTERS, own.arm * np.eye(3), strict=True):
            tip = Marker.at(f"{label}@{letter}", frame, to_vector(axis))
            markers.append(replace(tip, is_direction=True, noise=size, follows_size=False))
    for label, side in _list_hips(segments, trials) if table is not None else ():
        ends, pelvis = find_joint_ends(model, "hip", side), _find_pelvis(model, segments[label])
        if table is not None and pelvis in ends:
            frame = f"origin of {label}"
            added.append(Segment(name=frame, parent=pelvis, joint_name=frame, joints=()))
            weight = (_MARKER_M / table.centre) ** 2
            point = Marker.at(f"{label}@origin", frame, to_vector(ends[pelvis]), weight=weight)
            markers.append(replace(point, noise=table.centre))
    return replace(
        model,
        segments=(*model.segments, *added),
        markers=(*model.markers, *markers),
        parameters=(*model.parameters, *parameters),
    )


def _make_parameter(name: str, value: float) -> Parameter:
    return Parameter(
        name=name, value=value, unit="rad", lower=-UNBOUNDED, upper=UNBOUNDED, group="mounting", target=name
    )


def _find_pelvis(model: BodyModel, femur: str) -> str:
    return model.segment(femur).parent


def _list_hips(segments: Mapping[str, str], trials: Sequence[Trial]) -> Iterator[tuple[str, str]]:
    """Labels of thighs whose origins are told, and their sides."""
    told = {x for t in trials if _get(t).origins is not None for x in _get(t).labels}
    for label, segment in segments.items():
        if label in told and segment in ("femur_r", "femur_l"):
            yield label, segment[-1]


def _with_directions(
    trial: Trial, segments: Mapping[str, str], noise: Mapping[str, Noise], chosen: _Hypothesis
) -> Trial:
    """The recording with the axes of its rotations, and the hips that these tell, as further markers."""
    held, labels, columns = _get(trial), list(trial.labels), [trial.markers]
    for k, label in enumerate(held.labels):
        if label not in segments:
            continue
        labels += [f"{label}@{letter}" for letter in LETTERS]
        columns.append(noise[label].arm * (chosen.turn @ held.matrices[:, k]).swapaxes(1, 2))
        if held.origins is not None:
            labels.append(f"{label}@origin")
            columns.append(held.origins[:, [k]])
    return replace(trial, labels=tuple(labels), markers=np.concatenate(columns, axis=1))


def _solve(
    model: BodyModel,
    trials: Sequence[Trial],
    segments: Mapping[str, str],
    noise: Mapping[str, Noise],
    calibrating: int | None,
) -> tuple[BodyModel, float]:
    """The model with its mountings and heading as likely as some frames make them, and how well they are known.

    And how much larger residuals are than expected, as a ratio of lengths.

    ``calibrating``: frames of the pose that tells how sensors are put on; None where no pose does.
    """
    names = [p.name for p in model.parameters if p.group == "mounting"]
    prior = GaussianPrior([p.name for p in model.parameters])
    for label in segments:
        own = noise[label]
        variance = own.lasting**2 + (0.0 if calibrating is None else own.white**2 / calibrating)
        if f"mounting.{label}.x" in names:
            prior.add_values(_name_parameters(label), np.zeros(3), variance * np.eye(3))
    if _HEADING in names:
        start = next(p.value for p in model.parameters if p.name == _HEADING)
        prior.add_values([_HEADING], np.array([start]), np.array([[_HEADING_SD**2]]))
    some = [_pick(t, max(_SOLVED // len(trials), 2)) for t in trials]
    wanted = list(dict.fromkeys(label for t in some for label in t.labels))
    joined = replace(
        some[0].select(wanted),
        rotations=None,
        times=np.arange(sum(t.n_frames for t in some), dtype=float),
        markers=np.concatenate([t.select(wanted).markers for t in some]),
    )
    spacing = np.concatenate(
        [np.full(t.n_frames, float(np.median(np.diff(t.times))) if t.n_frames > 1 else 1.0) for t in some]
    )
    people = read_people()
    shares = np.minimum(spacing / (2.0 * people.loose_s), 1.0)
    problem, task = pose_problem(model, joined, people, prior=prior, shares=shares)
    neutral = repeat_default_pose(model, 1)[0]
    within = replace(task, bounds=list_coordinate_ranges(model))
    start_q = guess_start(task.tree, task.measured, neutral, task.p, task.free)
    posterior = solve_posterior(problem, solve_from(within, slice(None), start_q).q, task.p)
    values = dict(zip(prior.names, posterior.p.tolist(), strict=True))
    parameters = tuple(replace(p, value=values[p.name]) for p in model.parameters)
    level = float(np.sqrt(posterior.misfit / posterior.freedom)) if posterior.freedom > 0.0 else 1.0
    return pack_posterior(replace(model, parameters=parameters), prior.names, posterior.covariance), level


def _tell(
    matched: Mapping[str, str | None],
    noise: Mapping[str, Noise],
    chosen: _Hypothesis,
    misfits: Mapping[str, float],
    facing: float | None,
) -> Iterator[Note]:
    used = ", ".join(f"{label} on {segment}" for label, segment in matched.items() if segment is not None)
    yield Note(code="rotations", severity="note", problem=f"rotations are followed: {used}")
    ignored = [label for label in matched if is_ignored(label)]
    left = [label for label, segment in matched.items() if segment is None and label not in ignored]
    if left:
        yield Note(
            code="rotations_unmatched",
            severity="note",
            problem=f"rotations that no segment of the model has are not used: {list_few(left)}",
            remedy="Nothing is to be done where the model has no such segment; else name them as its segments are",
        )
    if ignored:
        said = f"the laboratory's own frame, and frames for another program, are not used: {list_few(ignored)}"
        yield Note(code="rotations_ignored", severity="note", problem=said, remedy="Nothing is to be done")
    turned = [] if facing is None else [f"forward is where they face there, {np.degrees(facing):.0f} deg about the vertical"]
    yield Note(
        code="mounting",
        severity="warning" if chosen.calibrated else "note",
        problem="; ".join([chosen.told, *turned]),
        remedy="If it is not so, give the orientations of such a pose (`--standing`, `standing` over HTTP)",
    )
    missed = misfits.get(chosen.told, 0.0)
    if missed > read_rotation_table().total:
        yield Note(
            code="mounting_doubtful",
            severity="warning",
            problem=f"so mounted the model misses rotations by {np.degrees(missed):.1f} deg, more than ordinary "
            f"{np.degrees(read_rotation_table().total):.1f}: angles may be off by as much all through",
            remedy="Give the orientations of a pose in which the person stands as the model does by default",
        )
    lasting = [own.lasting for label, own in noise.items() if matched[label] is not None]
    white = [own.white for label, own in noise.items() if matched[label] is not None]
    yield Note(
        code="rotation_noise",
        severity="note",
        problem=f"rotations are taken to be off by {np.degrees(max(lasting)):.1f} deg about each axis all through "
        f"(mounting), and by {np.degrees(max(o.passing for o in noise.values())):.1f} deg from moment to moment "
        f"(they jitter by {np.degrees(np.median(white)):.1f} deg); deviations hold both",
        remedy="Nothing is to be done",
    )
