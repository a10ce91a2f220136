"""Rotations that a system measures, as observations of a model beside its markers.

A rotation R is three directions, the axes of its frame: points at infinity, which turn with their segment and
know nothing of where it is. Three directions of length L that miss by a turn of angle a are off by
``8 L^2 sin(a/2)^2`` in squares, ``2 L^2 a^2`` to within a thousandth up to 12 deg: the squared length of
log(R_measured^T R_model), weighed. So they go through every solver that markers go through.

Each system's frame hangs on its segment by a mounting: three turns that are shared by all frames of all
recordings, with a prior about what a system's axes or a pose say. Sensors also have a heading: which way the
person faces in their world. They are parameters of the model and solved with the motion; what is left open of
them goes into every deviation.
"""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from scaling_service.capabilities.motion import everyday, frames
from scaling_service.capabilities.motion.beside_markers import find_beside_markers, share_world
from scaling_service.capabilities.motion.solving import guess_start, solve_from
from scaling_service.capabilities.motion.task import Task
from scaling_service.core.arrays import Array
from scaling_service.core.errors import TrialUnusable
from scaling_service.core.names import say_name
from scaling_service.core.notes import Note
from scaling_service.core.text import list_few
from scaling_service.model import compile as compiling
from scaling_service.model.anatomy import rotations
from scaling_service.model.body import BodyModel
from scaling_service.model.people import read_people
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares.posterior import solve_posterior
from scaling_service.numerics.least_squares.whitening import GaussianPrior
from scaling_service.numerics.multibody.rigid import rotate_about
from scaling_service.numerics.multibody.sweep import SweepSettings

NOWHERE: abc.Mapping[str, tuple[str, Array]] = MappingProxyType({})
"""No frame is on the model already."""

_HEADING_SD = np.pi / np.sqrt(3.0)  # rad: any way round is as likely
_NOTHING_TOLD = 1e-6  # of mountings: joints that turn every way leave them as they were
_LOOKED_AT = 12  # chosen: frames, evenly spaced, by which hypotheses are compared
_SOLVED = 40  # chosen: frames, evenly spaced, that tell of the mounting
_ROUGH = SweepSettings(left=2e-2)  # chosen: hypotheses differ by more


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Mounted:
    """A model that carries the frames of rotations, recordings with their directions, and what to tell."""

    model: BodyModel
    trials: tuple[Trial, ...]
    notes: tuple[Note, ...]


def mount(
    model: BodyModel,
    trials: abc.Sequence[Trial],
    standing: Trial | None = None,
    *,
    placed: abc.Mapping[str, tuple[str, Array]] = NOWHERE,
    turned: bool = False,
) -> Mounted:
    """Put the frames of all rotations on a model, and find how they are mounted.

    ``trials``: in the session's axes, but for sensors, whose world is found here unless ``turned`` says that
    it is the session's. ``standing``: sensors' orientations while the person stands as the model does by
    default; else the first frame of the first recording is taken so, unless markers are beside them, sensors
    have the segments' own axes, or the model has them: ``placed``, frame to its segment and its axes there,
    (3, 3), columns.

    Raises TrialUnusable: no rotation belongs to a segment of the model.
    """
    table, measured = rotations.read_rotation_table(), [t for t in trials if t.rotations is not None]
    if len({frames.get_rotations(t).of for t in measured}) > 1:
        raise TrialUnusable(
            f"recordings of segments and of sensors ({list_few([t.name for t in measured])}) are to be apart",
            field="recordings",
            remedy="Give them in two commands",
        )
    labels = dict.fromkeys(label for t in measured for label in frames.get_rotations(t).labels)
    matched = {
        label: placed[label][0] if label in placed else rotations.match_rotation(label, model)
        for label in labels
    }
    segments = {label: segment for label, segment in matched.items() if segment is not None}
    if not segments:
        raise TrialUnusable(
            f"none of its rotations ({list_few(list(labels))}) is on a segment of model '{model.name}'",
            file=measured[0].name,
            field="ROTATION:LABELS" if frames.get_rotations(measured[0]).of == "segments" else "columns",
            remedy=f"Name them as the segments are: {list_few(list(model.segment_names))}",
        )
    noise = {label: frames.measure_noise(table, measured, label) for label in segments}
    axes = {label: placed[label][1] for label in segments if label in placed}
    hypotheses = [
        *frames.list_hypotheses(model, table, measured, segments, standing, placed=axes, turned=turned)
    ]
    both = next((t for t in measured if t.labels and frames.get_rotations(t).of == "sensors"), None)
    if both is not None:
        beside = find_beside_markers(model, both, segments, turned=turned)
        if beside is not None:
            trials, beside = share_world(model, trials, segments, beside, turned=turned)
            measured = [t for t in trials if t.rotations is not None]
            hypotheses = [beside]
    chosen, misfits = _choose(model, measured, segments, noise, hypotheses)
    calibrating = None
    if chosen.calibrated:
        calibrating = 1 if standing is None else standing.n_frames

    def solve(one: frames.Hypothesis) -> tuple[tuple[Trial, ...], BodyModel, float, float]:
        placed = frames.add_frames(model, segments, noise, one, table, measured)
        ready = tuple(frames.add_directions(t, segments, noise, one) if t in measured else t for t in trials)
        return (ready, *_solve(placed, ready, segments, noise, calibrating))

    # First with all that frames may sit askew, to see by how much they do and how well they are followed.
    noise = {label: frames.Noise.of(table, own.white, lasting=table.total) for label, own in noise.items()}
    _, solved, level, askew = solve(chosen)
    facing = None
    if chosen.heading is not None:
        # Forward is where the person faces in that pose, as OpenSense has it.
        facing = next(p.value for p in solved.parameters if p.name == frames.HEADING)
        back = rotate_about((0.0, 1.0, 0.0), -facing)
        after = {label: back @ turn for label, turn in chosen.after.items()}
        chosen = replace(chosen, turn=back @ chosen.turn, after=after, heading=0.0)
    # What the recordings show beyond people's widens it, and nothing narrows it.
    noise = {
        label: frames.Noise.of(table, own.white, max(level, 1.0) * own.passing, askew)
        for label, own in noise.items()
    }
    ready, solved, *_ = solve(chosen)
    notes = tuple(_tell(matched, noise, chosen, misfits, facing))
    return Mounted(model=solved, trials=ready, notes=notes)


def _choose(
    model: BodyModel,
    trials: abc.Sequence[Trial],
    segments: abc.Mapping[str, str],
    noise: abc.Mapping[str, frames.Noise],
    hypotheses: abc.Sequence[frames.Hypothesis],
) -> tuple[frames.Hypothesis, dict[str, float]]:
    """The hypothesis under which the model follows the rotations best, and the misfit of each kind, rad."""
    if len(hypotheses) == 1:
        return hypotheses[0], {}
    found: dict[str, tuple[float, frames.Hypothesis]] = {}
    bare = model.with_markers(())
    for one in hypotheses:
        placed = frames.add_frames(bare, segments, noise, one, None, ())
        some = [frames.add_directions(_pick(t, _LOOKED_AT), segments, noise, one) for t in trials]
        misfit, count = 0.0, 0
        for trial in some:
            task = Task.of(placed, trial)
            task = replace(task, bounds=compiling.list_coordinate_ranges(placed))
            start = guess_start(task, compiling.repeat_default_pose(placed, 1)[0])
            solution = solve_from(task, start, settings=_ROUGH)
            misfit += float(solution.cost.sum())
            count += int(np.isfinite(task.measured[:, ::3, 0]).sum())
        angle = float(
            np.sqrt(misfit / max(count, 1)) / frames.MARKER_M * rotations.read_rotation_table().total
        )
        if one.told not in found or angle < found[one.told][0]:
            found[one.told] = angle, one
    best = min(found.values(), key=lambda pair: pair[0])[1]
    return best, {told: angle for told, (angle, _) in found.items()}


def _pick(trial: Trial, count: int) -> Trial:
    rows = np.unique(np.linspace(0, trial.n_frames - 1, min(count, trial.n_frames)).round().astype(np.intp))
    return trial.frames(rows)


def _solve(
    model: BodyModel,
    trials: abc.Sequence[Trial],
    segments: abc.Mapping[str, str],
    noise: abc.Mapping[str, frames.Noise],
    calibrating: int | None,
) -> tuple[BodyModel, float, float]:
    """Mountings and heading as some frames make them likely.

    ``calibrating``: frames of the pose that tells how sensors are put on; None where no pose does.
    Returns the model; how much larger residuals are than expected, as a ratio of lengths; and the root mean
        square of how far frames sit off their priors, rad, as far as joints show it.
    """
    names = [p.name for p in model.parameters if p.group == "mounting"]
    prior = GaussianPrior([p.name for p in model.parameters])
    for label in segments:
        own = noise[label]
        variance = own.lasting**2 + (0.0 if calibrating is None else own.white**2 / calibrating)
        if f"mounting.{label}.x" in names:
            prior.add_values(frames.name_parameters(label), np.zeros(3), variance * np.eye(3))
    if frames.HEADING in names:
        start = next(p.value for p in model.parameters if p.name == frames.HEADING)
        prior.add_values([frames.HEADING], np.array([start]), np.array([[_HEADING_SD**2]]))
    measured = [t for t in trials if t.rotations is not None]
    some = [_pick(t, max(_SOLVED // len(measured), 2)) for t in measured]
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
    if not any(t.labels and not all("@" in label for label in t.labels) for t in measured):
        # Skin lasts from frame to frame, jitter does not.
        own_shares = [(noise[label].white / noise[label].passing) ** 2 for label in segments]
        shares = shares + (1.0 - shares) * float(np.median(own_shares))
    lawful = everyday.holds_skin(model)
    problem, task = everyday.pose_problem(model, joined, people, prior=prior, shares=shares, lawful=lawful)
    problem = problem.hold_once()
    neutral = compiling.repeat_default_pose(model, 1)[0]
    within = replace(task, bounds=compiling.list_coordinate_ranges(model))
    start_q = guess_start(task, neutral)
    posterior = solve_posterior(problem, solve_from(within, start_q).q, task.p)
    values = dict(zip(prior.names, posterior.p.tolist(), strict=True))
    parameters = tuple(replace(p, value=values[p.name]) for p in model.parameters)
    level = float(np.sqrt(posterior.misfit / posterior.freedom)) if posterior.freedom > 0.0 else 1.0
    turned = [k for k, name in enumerate(prior.names) if name in names and name != frames.HEADING]
    before = 1.0 / np.diag(prior.precision)[turned]
    after, mean = posterior.covariance[np.ix_(turned, turned)], posterior.p[turned]
    # Mountings of variance s are estimated as K m + e with K = 1 - C/P and the covariance K C of e.
    told = np.eye(len(turned)) - after / before
    askew = (mean @ mean - np.trace(told @ after)) / max(float(np.square(told).sum()), _NOTHING_TOLD)
    packed = everyday.pack_posterior(replace(model, parameters=parameters), prior.names, posterior.covariance)
    return packed, level, float(np.sqrt(max(askew, 0.0)))


def _tell(
    matched: abc.Mapping[str, str | None],
    noise: abc.Mapping[str, frames.Noise],
    chosen: frames.Hypothesis,
    misfits: abc.Mapping[str, float],
    facing: float | None,
) -> abc.Iterator[Note]:
    used = ", ".join(
        f"{label} on {say_name(segment)}" for label, segment in matched.items() if segment is not None
    )
    yield Note(code="rotations", severity="note", problem=f"rotations are followed: {used}")
    ignored = [label for label in matched if rotations.is_ignored(label)]
    left = [label for label, segment in matched.items() if segment is None and label not in ignored]
    if left:
        yield Note(
            code="rotations_unmatched",
            severity="note",
            problem=f"rotations that no segment of the model has are not used: {list_few(left)}",
            remedy="Nothing is to be done where the model has no such segment; else name them as its are",
        )
    if ignored:
        said = (
            f"the laboratory's own frame, and frames for another program, are not used: {list_few(ignored)}"
        )
        yield Note(code="rotations_ignored", severity="note", problem=said, remedy="Nothing is to be done")
    turned = f"; forward is where they face there, {np.degrees(facing or 0.0):.0f} deg about the vertical"
    yield Note(
        code="mounting",
        severity="warning" if chosen.calibrated else "note",
        problem=chosen.told + (turned if facing is not None else ""),
        remedy="If it is not so, give the orientations of such a pose (`--standing`, `standing` over HTTP)",
    )
    missed, usual = np.degrees([misfits.get(chosen.told, 0.0), rotations.read_rotation_table().total])
    if missed > usual:
        yield Note(
            code="mounting_doubtful",
            severity="warning",
            problem=f"so mounted the model misses rotations by {missed:.1f} deg, {usual:.1f} is usual: "
            "angles may be off by as much all through",
            remedy="Give the orientations of a pose in which the person stands as the model does by default",
        )
    own = [noise[label] for label, segment in matched.items() if segment is not None]
    lasting, passing = np.degrees([(o.lasting, o.passing) for o in own]).max(axis=0)
    jitter = np.degrees(np.median([o.white for o in own]))
    yield Note(
        code="rotation_noise",
        severity="note",
        problem=f"rotations are taken to be off by {lasting:.1f} deg about each axis all through (mounting), "
        f"and by {passing:.1f} deg from moment to moment (they jitter by {jitter:.1f} deg): deviations hold "
        "both",
        remedy="Nothing is to be done",
    )
