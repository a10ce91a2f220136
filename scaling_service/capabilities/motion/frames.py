"""Frames of measured rotations: how they err, what axes they may have, and a model that carries them.

See :mod:`.mounting`, which decides.
"""

from __future__ import annotations

import itertools
from collections import abc
from dataclasses import dataclass, replace

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.model import body
from scaling_service.model.anatomy.lengths import find_joint_ends
from scaling_service.model.anatomy.rotations import RotationTable
from scaling_service.model.freed import UNBOUNDED
from scaling_service.model.parameters import LETTERS, UNITS
from scaling_service.model.poses import pose_neutral_frames
from scaling_service.model.trial import Rotations, Trial
from scaling_service.numerics.multibody import rigid

MARKER_M = 0.010  # the marker beside which rotations are weighed; motion/ranges.py has its source
HEADING = "heading"
_HEADINGS_DEG = 30.0  # chosen: step of the headings that are tried; steps of Gauss-Newton go on from the best
_SHAPES = tuple(
    turn
    for order in itertools.permutations(range(3))
    for signs in itertools.product((1.0, -1.0), repeat=3)
    if np.linalg.det(turn := np.diag(signs)[list(order)]) > 0.0
)
"""The 24 ways to name the axes of a frame."""
Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""From a world with z up to ours, by the smallest turn."""
_UPRIGHT = ("pelvis", "torso", "thorax", "femur", "tibia")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Noise:
    """How one rotation errs about each axis, rad: what passes from frame to frame, and what lasts."""

    passing: float
    lasting: float
    white: float

    @classmethod
    def of(cls, table: RotationTable, white: float, passing: float = 0.0, lasting: float = 0.0) -> Noise:
        """``passing``, ``lasting``: where they are more than people's, of whose whole lasts what is left."""
        passing = max(white, passing, table.passing)
        left = float(np.sqrt(max(table.total**2 - passing**2, 0.0)))
        lasting = max(left, table.lasting, lasting)
        return cls(passing=passing, lasting=lasting, white=white)

    @property
    def arm(self) -> float:
        """Length of its directions, m, at which their tips err as a marker does."""
        return float(MARKER_M / (np.sqrt(2.0) * np.hypot(self.passing, self.lasting)))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Hypothesis:
    """What frames and their world may be.

    ``turn`` (3, 3): from the recordings' world to ours. ``before``, ``after``: label to the constant turns of
    its mounting, which is before · (turn about y by the heading) · after.
    """

    told: str
    turn: Array
    before: abc.Mapping[str, Array]
    after: abc.Mapping[str, Array]
    heading: float | None = None  # rad; None where a person's heading is not told by a pose
    calibrated: bool = False


def get_rotations(trial: Trial) -> Rotations:
    """The rotations of a recording that has some."""
    assert trial.rotations is not None
    return trial.rotations


def take_rotation(trial: Trial, label: str) -> Array:
    """One rotation, (n_frames, 3, 3); NaN where not measured, or not in this recording."""
    held = get_rotations(trial)
    if label not in held.labels:
        return np.full((trial.n_frames, 3, 3), np.nan)
    return held.matrices[:, held.labels.index(label)]


def measure_noise(table: RotationTable, trials: abc.Sequence[Trial], label: str) -> Noise:
    """The whole of it is people's; the white part is measured, and what is left of the whole lasts.

    White noise of variance v has third differences of 20 v, and a movement hardly any at a camera's rate.
    """
    found = [np.zeros((0, 3))]
    for trial in trials:
        turns = take_rotation(trial, label)
        steps = rigid.convert_rotation_to_vector(
            np.where(np.isfinite(turns[:-1]), turns[:-1].swapaxes(1, 2), np.nan) @ turns[1:]
        )
        found.append(np.diff(steps, n=2, axis=0))
    sizes = np.abs(np.concatenate(found)).ravel()
    sizes = sizes[np.isfinite(sizes)]
    white = 1.4826 * float(np.median(sizes)) / np.sqrt(20.0) if len(sizes) else 0.0
    return Noise.of(table, white)


def list_hypotheses(
    model: body.BodyModel,
    table: RotationTable,
    trials: abc.Sequence[Trial],
    segments: abc.Mapping[str, str],
    standing: Trial | None,
    *,
    placed: abc.Mapping[str, Array],
    turned: bool,
) -> abc.Iterator[Hypothesis]:
    """What the frames may be, of a markerless system one, of sensors several; options as of ``mount``."""
    same = dict.fromkeys(segments, np.eye(3))
    if get_rotations(trials[0]).of == "segments":
        yield _find_axes(table, trials, segments)
        return
    worlds = {"as given": np.eye(3)} if turned else {"y up": np.eye(3), "z up": Z_UP}
    # Where it is known how frames sit on their segments, these say which way is up.
    sat = {label: placed[label] for label in segments if label in placed} or same
    ups = [
        m @ sat[label][1]
        for label in _list_upright({x: segments[x] for x in sat})
        if (m := _average_plain(trials, label)) is not None
    ]
    mean = np.sum(ups, axis=0)
    own = max(worlds, key=lambda world: float(worlds[world][1] @ mean))
    said = "sensors sit as the model has them" if placed else "sensors' axes are those of their segments"
    yield Hypothesis(
        told=f"{said}, their world is {own}",
        turn=worlds[own],
        before=sat,
        after=dict.fromkeys(sat, np.eye(3)),
    )
    if placed:
        return
    neutral = pose_neutral_frames(model)
    calibrating = trials[0] if standing is None else standing
    rows = slice(0, 1) if standing is None else slice(None)
    pose = {label: average_rotations(take_rotation(calibrating, label)[rows]) for label in segments}
    for world, turn in worlds.items():
        known = {label: turn @ first for label, first in pose.items() if first is not None}
        before = {label: neutral[segments[label]][0].T for label in known}
        where = "the first frame" if standing is None else f"'{calibrating.name}'"
        for degrees in np.arange(-180.0, 180.0, _HEADINGS_DEG):
            yield Hypothesis(
                told=f"the person stands in {where} as the model does by default, the sensors' world is "
                f"{world}",
                turn=turn,
                before=before,
                after=known,
                heading=float(np.radians(degrees)),
                calibrated=True,
            )


def average_rotations(turns: Array) -> Array | None:
    """The mean of some rotations (n, 3, 3); None where all are unknown."""
    known = turns[np.isfinite(turns).all(axis=(1, 2))]
    return rigid.find_nearest_rotation(known.mean(axis=0)) if len(known) else None


def _find_axes(
    table: RotationTable, trials: abc.Sequence[Trial], segments: abc.Mapping[str, str]
) -> Hypothesis:
    """The axes of a markerless system: as documented; others where pelvis, trunk and legs point otherwise.

    Up is the axis that is nearest to the vertical on average, and right the one along the line of the hips.
    """
    means = [m for label in _list_upright(segments) if (m := _average_plain(trials, label)) is not None]
    vertical = np.array([m.T @ [0.0, 1.0, 0.0] for m in means]).sum(axis=0)
    across = np.zeros(3)
    for trial in trials:
        held = get_rotations(trial)
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
    usual = next((s for s in fitting if np.array_equal(s, np.eye(3))), fitting[0])
    chosen = usual if documented is None else documented
    names = [("-" if row.sum() < 0 else "") + "xyz"[int(np.abs(row).argmax())] for row in chosen]
    said = "as documented" if documented is not None else "by where they point in the recordings"
    return Hypothesis(
        told=f"segments' axes are {names[0]} forward, {names[1]} up, {names[2]} right, {said}",
        turn=np.eye(3),
        before=dict.fromkeys(segments, chosen),
        after=dict.fromkeys(segments, np.eye(3)),
    )


def _list_upright(segments: abc.Mapping[str, str]) -> list[str]:
    """Labels of what stands more or less upright, all where nothing does."""
    return [x for x, name in segments.items() if name.lower().startswith(_UPRIGHT)] or list(segments)


def _average_plain(trials: abc.Sequence[Trial], label: str) -> Array | None:
    every = np.concatenate([take_rotation(trial, label) for trial in trials])
    known = every[np.isfinite(every).all(axis=(1, 2))]
    return known.mean(axis=0) if len(known) else None


def _turn_by(matrix: Array) -> tuple[body.Joint, ...]:
    """A constant rotation as a joint."""
    vector = rigid.convert_rotation_to_vector(matrix)
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return ()
    return (body.Joint("rotation", body.to_vector(vector / angle), body.Law.constant(angle)),)


def name_parameters(label: str) -> list[str]:
    """The three turns of a mounting."""
    return [f"mounting.{label}.{letter}" for letter in LETTERS]


def add_frames(
    model: body.BodyModel,
    segments: abc.Mapping[str, str],
    noise: abc.Mapping[str, Noise],
    chosen: Hypothesis,
    table: RotationTable | None,
    trials: abc.Sequence[Trial],
) -> body.BodyModel:
    """The model with a frame for every rotation, its directions as markers, and its mounting as parameters.

    ``table``: where given, hips that a markerless system tells are points of the pelvis, too.
    """
    added, markers, parameters = [], [], []
    about_y = (0.0, 1.0, 0.0)
    if chosen.heading is not None:
        parameters.append(_make_parameter(HEADING, chosen.heading))
    for label, segment in segments.items():
        if label not in chosen.after:
            continue
        heading: tuple[body.Joint, ...] = ()
        if chosen.heading is not None:
            heading = (body.Joint("rotation", about_y, body.Law((body.Term(-1.0, parameter=HEADING),))),)
        names = name_parameters(label)
        turns = tuple(
            body.Joint("rotation", axis, body.Law((body.Term(1.0, parameter=name),)))
            for axis, name in zip(UNITS, names, strict=True)
        )
        joints = (*_turn_by(chosen.before[label]), *heading, *_turn_by(chosen.after[label]), *turns)
        frame = f"frame of {label}"
        added.append(body.Segment(name=frame, parent=segment, joint_name=frame, joints=joints))
        parameters += [_make_parameter(name, 0.0) for name in names]
        own = noise[label]
        size = float(np.sqrt(2.0) * own.arm * own.passing)
        for letter, axis in zip(LETTERS, own.arm * np.eye(3), strict=True):
            tip = body.Marker.at(f"{label}@{letter}", frame, body.to_vector(axis))
            markers.append(replace(tip, is_direction=True, noise=size, follows_size=False))
    for label, side in _list_hips(segments, trials) if table is not None else ():
        ends, pelvis = find_joint_ends(model, "hip", side), model.segment(segments[label]).parent
        if table is not None and pelvis in ends:
            frame = f"origin of {label}"
            added.append(body.Segment(name=frame, parent=pelvis, joint_name=frame, joints=()))
            weight = (MARKER_M / table.centre) ** 2
            point = body.Marker.at(f"{label}@origin", frame, body.to_vector(ends[pelvis]), weight=weight)
            markers.append(replace(point, noise=table.centre))
    return replace(
        model,
        segments=(*model.segments, *added),
        markers=(*model.markers, *markers),
        parameters=(*model.parameters, *parameters),
    )


def _make_parameter(name: str, value: float) -> body.Parameter:
    return body.Parameter(
        name=name, value=value, unit="rad", lower=-UNBOUNDED, upper=UNBOUNDED, group="mounting", target=name
    )


def _list_hips(segments: abc.Mapping[str, str], trials: abc.Sequence[Trial]) -> abc.Iterator[tuple[str, str]]:
    """Labels of thighs whose origins are told, and their sides."""
    told = {x for t in trials if get_rotations(t).origins is not None for x in get_rotations(t).labels}
    for label, segment in segments.items():
        if label in told and segment in ("femur_r", "femur_l"):
            yield label, segment[-1]


def add_directions(
    trial: Trial, segments: abc.Mapping[str, str], noise: abc.Mapping[str, Noise], chosen: Hypothesis
) -> Trial:
    """The recording with the axes of its rotations, and the hips that these tell, as further markers."""
    held, labels, columns = get_rotations(trial), list(trial.labels), [trial.markers]
    for k, label in enumerate(held.labels):
        if label not in segments:
            continue
        labels += [f"{label}@{letter}" for letter in LETTERS]
        columns.append(noise[label].arm * (chosen.turn @ held.matrices[:, k]).swapaxes(1, 2))
        if held.origins is not None:
            labels.append(f"{label}@origin")
            columns.append(held.origins[:, [k]])
    return replace(trial, labels=tuple(labels), markers=np.concatenate(columns, axis=1))
