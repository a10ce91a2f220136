"""Sensors beside markers in one movement: markers tell how sensors sit, and which way their world faces.

A turn of a segment from one moment to another is the same in both worlds but for the heading g between them,
``b = R_y(g) a`` for their rotation vectors (in a sensor's world turned y up). The g that fits all segments
and moments best has a closed form, as have the mountings then.
"""

from __future__ import annotations

from collections import abc
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from scaling_service.capabilities.motion import frames
from scaling_service.capabilities.motion.inverse_kinematics import solve_task
from scaling_service.capabilities.motion.task import Task
from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel
from scaling_service.model.poses import pose_segments
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody import rigid


def join_recordings(trials: abc.Sequence[Trial]) -> tuple[Trial, ...]:
    """Recordings of one name as one: of markers, and of rotations, which are put on the markers' times.

    Both clocks are taken to be one.
    """
    joined: dict[str, Trial] = {}
    for trial in sorted(trials, key=lambda one: not one.labels):  # markers first
        before = joined.get(trial.name)
        if before is None or trial.rotations is None or before.rotations is not None:
            joined[trial.name] = trial
        else:
            # Rotations between their moments, by the shortest turn; NaN before the first and after the
            # last.
            matrices = np.full((len(before.times), len(trial.rotations.labels), 3, 3), np.nan)
            for k in range(len(trial.rotations.labels)):
                known = np.isfinite(trial.rotations.matrices[:, k]).all(axis=(1, 2))
                if known.sum() > 1:
                    own = trial.times[known]
                    within = (before.times >= own[0]) & (before.times <= own[-1])
                    turned = Slerp(own, Rotation.from_matrix(trial.rotations.matrices[known, k]))
                    matrices[within, k] = turned(before.times[within]).as_matrix()
            joined[trial.name] = replace(
                before, rotations=replace(trial.rotations, matrices=matrices, origins=None)
            )
    return tuple(joined[name] for name in dict.fromkeys(trial.name for trial in trials))


def find_beside_markers(
    model: BodyModel, trial: Trial, segments: abc.Mapping[str, str], *, turned: bool
) -> frames.Hypothesis | None:
    """How sensors sit by the markers of the same movement; None where no segment turns enough to tell.

    ``segments``: label to its segment. ``turned``: whether the sensors' world is the session's but for its
    heading.
    """
    shown = {m.segment for m in model.markers if m.name in trial.shown_labels}
    q = solve_task(Task.of(model, trial), trial.times).q
    turns = Rotation.from_quat(pose_segments(model, q)[..., 3:].reshape(-1, 4)).as_matrix()
    bodies = turns.reshape(trial.n_frames, -1, 3, 3)
    pairs = {
        label: (bodies[:, model.segment_names.index(segment)], frames.take_rotation(trial, label))
        for label, segment in segments.items()
        if segment in shown
    }
    best: tuple[float, str, Array] | None = None
    for world, turn in (
        {"as given": np.eye(3)} if turned else {"y up": np.eye(3), "z up": frames.Z_UP}
    ).items():
        a, b = (np.concatenate(parts) for parts in zip(*_list_steps(pairs.values(), turn), strict=True))
        across = float((a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]).sum())
        along = float((a[:, 0] * b[:, 0] + a[:, 2] * b[:, 2]).sum())
        fit = np.hypot(across, along) + float((a[:, 1] * b[:, 1]).sum())
        heading = float(np.arctan2(across, along))
        if best is None or fit > best[0]:
            said = f"their world is {world}, turned by {np.degrees(heading):.0f} deg against the markers'"
            best = fit, said, rigid.rotate_about((0.0, 1.0, 0.0), -heading) @ turn
    if best is None or best[0] <= 0.0:
        return None
    found = {
        label: frames.average_rotations(body.swapaxes(1, 2) @ best[2] @ sensor)
        for label, (body, sensor) in pairs.items()
    }
    before = {label: sits for label, sits in found.items() if sits is not None}
    return frames.Hypothesis(
        told=f"sensors sit as the markers of '{trial.name}' show, {best[1]}",
        turn=best[2],
        before=before,
        after=dict.fromkeys(before, np.eye(3)),
    )


def share_world(
    model: BodyModel,
    trials: abc.Sequence[Trial],
    segments: abc.Mapping[str, str],
    shared: frames.Hypothesis,
    *,
    turned: bool,
) -> tuple[tuple[Trial, ...], frames.Hypothesis]:
    """Recordings in one world of sensors, that of the first: markers show where another's faces elsewhere.

    A recording without markers stays as it is: there a heading is the whole body's, and nothing else.
    ``shared``: from the first; its sentence goes on with how the others' worlds are turned.
    """
    ready, told = [], shared.told
    for trial in trials:
        own = None
        if trial.labels and trial.rotations is not None and f"'{trial.name}'" not in shared.told:
            own = find_beside_markers(model, trial, segments, turned=turned)
        if own is not None and trial.rotations is not None:
            trial = replace(trial, rotations=trial.rotations.turn(shared.turn.T @ own.turn))
            told += f"; in '{trial.name}' {own.told.rpartition(', ')[2]}"
        ready.append(trial)
    return tuple(ready), replace(shared, told=told)


def _list_steps(pairs: abc.Iterable[tuple[Array, Array]], turn: Array) -> list[tuple[Array, Array]]:
    """Rotation vectors of segments and of their sensors from the middle of a recording, (n, 3) each, rad."""
    found = [(np.zeros((0, 3)), np.zeros((0, 3)))]
    for body, sensor in pairs:
        seen = np.flatnonzero(np.isfinite(sensor).all(axis=(1, 2)))
        if len(seen):
            middle = seen[len(seen) // 2]
            a = rigid.convert_rotation_to_vector(body[seen] @ body[middle].T)
            b = rigid.convert_rotation_to_vector(turn @ sensor[seen] @ sensor[middle].T @ turn.T)
            found.append((a, b))
    return found
