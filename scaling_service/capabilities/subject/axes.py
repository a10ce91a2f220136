"""Which way is up and forward in a subject's recordings: one decision from plates, model and landmarks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from scaling_service.capabilities.shared.settings import Settings
from scaling_service.core.arrays import Array
from scaling_service.core.errors import TrialUnusable, blame_file
from scaling_service.files.recording import Recording
from scaling_service.model import compile as compiling
from scaling_service.model.anatomy.markers import find_canonical
from scaling_service.model.body import BodyModel
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody import tree as trees
from scaling_service.numerics.multibody.rigid import fit_rigid
from scaling_service.recording import orientation


def decide_axes(
    trials: Mapping[Path, Trial],
    level: Mapping[Path, Array | None],
    model: BodyModel,
    settings: Settings,
    *,
    static: Path | None,
    facing: bool,
    vertical: int,
) -> orientation.Orientation:
    """One decision for the session: up from its first recording, forward from how most movements face.

    A person may stand for the static trial in another direction than they walk; what matters for
    forces and the direction of progression is the movement.

    ``trials``: as read, under the model's names. ``level``: corners of each recording's force plates, see
    :func:`list_level_corners`. ``static``: the recording of standing. ``facing``: whether forward is sought,
    as in :func:`scaling_service.recording.orientation.decide`. ``vertical``: the axis along which the model
    stands.
    """
    decided: dict[Path, orientation.Orientation] = {}
    for path, trial in trials.items():
        roles = {label: role for label in trial.labels if (role := find_canonical(label)) is not None}
        up = next(iter(decided.values())).up if decided else settings.up
        with blame_file(path, [path]):
            decided[path] = orientation.decide(
                trial,
                roles=roles,
                up=up,
                forward=settings.forward,
                upright=None if up else find_upright(model, trial, vertical),
                level=level[path],
                facing=facing,
            )
    return agree_on_axes(decided, static)


def find_upright(model: BodyModel, trial: Trial, vertical: int = 1) -> Array | None:
    """Where the upright axis of the model's root points on average in a recording, (3,); None where not seen.

    ``vertical``: the axis along which the model stands by default.

    The root is placed by a rigid fit of its markers, where it has too few by one of the whole body as it
    stands by default; a person's pelvis or thorax stays near upright while legs and arms go anywhere.
    """
    own = [m for m in model.markers if m.name in trial.shown_labels]
    if not own:
        return None
    root = next(s.name for s in model.segments if s.name in {m.segment for m in own})
    neutral = np.ascontiguousarray(compiling.repeat_default_pose(model, 1).T)
    for names in ([m.name for m in own if m.segment == root], [m.name for m in own]):
        tree = compiling.compile_model(model, names)
        poses = trees.pose_links(tree, neutral, compiling.list_parameter_values(model))
        rotation, _ = fit_rigid(trees.place_tree_markers(tree, poses)[:, :, 0], trial.select(names).markers)
        axes = rotation[np.isfinite(rotation).all(axis=(1, 2)), :, vertical]
        if len(axes):
            return np.asarray(axes.mean(axis=0))
    return None


def list_level_corners(recording: Recording) -> Array | None:
    """Corners of a recording's force plates in the laboratory, (n_plates, 4, 3), m; None without any."""
    plates = recording.plates
    if plates is None or isinstance(plates, TrialUnusable) or not plates.plates:
        return None
    return np.array([plate.corners for plate in plates.plates])


def agree_on_axes(
    decided: Mapping[Path, orientation.Orientation], static: Path | None
) -> orientation.Orientation:
    """One decision from those on each recording: up from the first, forward from how most movements face.

    A movement counts the more the clearer it faces along an axis: a turn counts less than a straight walk.

    ``decided``: file to its own decision, at least one, all with the same up. ``static``: the recording of
    standing, which counts only where there is no other.
    """
    moving = [axes for path, axes in decided.items() if path != static] or list(decided.values())
    votes = {axes.forward: sum(a.clarity for a in moving if a.forward == axes.forward) for axes in moving}
    chosen = max(moving, key=lambda axes: (votes[axes.forward], axes.clarity))
    why_up = [r for r in next(iter(decided.values())).repairs if r.what == "up_axis"]
    return replace(chosen, repairs=(*why_up, *(r for r in chosen.repairs if r.what != "up_axis")))
