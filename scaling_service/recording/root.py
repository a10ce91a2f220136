"""Whether the segment that carries all others is shown."""

from __future__ import annotations

from collections import abc

import numpy as np

from scaling_service.core.names import say_name, say_names
from scaling_service.core.text import list_few
from scaling_service.model import body
from scaling_service.model import compile as compiling
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody import tree as trees
from scaling_service.recording.exchanged import Clusters
from scaling_service.recording.findings import Finding
from scaling_service.recording.witnesses import FRAMES

_NOISE_M = 0.01  # chosen: skin over bone
_LARGEST_SD = np.radians(30.0)
"""Chosen: the root's turn that markers with this noise leave less certain is not shown by them."""

_ACROSS_M = 0.01  # chosen: three markers that lie nearer to one line show no turn about it


def ask_root(trial: Trial, model: body.BodyModel | None, clusters: Clusters) -> abc.Iterator[Finding]:
    """Whether the segment that carries all others is shown, by its own markers or by what hangs on it.

    A root at the end of what is shown (an arm or a leg alone) is only not told; one between two branches
    would be invented from them.
    """
    if model is None:
        return
    shown = set(trial.shown_labels)
    carried = {m.name: m.segment for m in model.markers if m.name in shown and m.weight > 0.0}
    if model.shows_key_points_alone(shown):
        return  # loading tells that they leave a pelvis's tilt to what is ordinary
    for root in model.children(body.GROUND):
        free = {t.coordinate for j in root.joints for t in j.law.terms if t.coordinate is not None}
        branches = [
            child for child in model.children(root.name) if _list_below(model, child) & {*carried.values()}
        ]
        if len(free) < 6 or len(branches) < 2 or not carried or _is_shown(trial, clusters.get(root.name, ())):
            continue
        if _measure_root_sd(model, root, tuple(carried)) > _LARGEST_SD:
            own = [
                m.name
                for m in model.markers
                if m.segment == root.name and m.name not in shown and m.weight > 0.0
            ]
            seen = [name for name, segment in carried.items() if segment == root.name]
            shows = f"only {list_few(seen)} show it" if seen else "no marker shows it"
            yield Finding(
                code="no_root",
                place=trial.name,
                severity="refusal",
                labels=tuple(own),
                problem=f"the {say_name(root.name)} is not shown, which carries "
                f"{say_names(branch.name for branch in branches)}: {shows}",
                remedy=f"Record or label {list_few(own)}; if they have other names, map them under "
                "`markers:`; if other markers sit on it, name them under `extra_markers:`",
            )


def _is_shown(trial: Trial, labels: abc.Sequence[str]) -> bool:
    """Whether some frame shows three markers of a segment off one line."""
    step = max(1, trial.n_frames // FRAMES)
    some = trial.select(list(labels)).markers[::step]
    for frame in some[np.isfinite(some).all(axis=2).sum(axis=1) >= 3][:1]:
        known = frame[np.isfinite(frame).all(axis=1)]
        return bool(np.linalg.svd(known - known.mean(axis=0), compute_uv=False)[1] > _ACROSS_M)
    return False


def _list_below(model: body.BodyModel, segment: body.Segment) -> set[str]:
    below = {segment.name}
    for child in model.children(segment.name):
        below |= _list_below(model, child)
    return below


def _measure_root_sd(model: body.BodyModel, root: body.Segment, markers: tuple[str, ...]) -> float:
    """The largest standard deviation of the root's turns, rad, near the neutral pose."""
    tree = compiling.compile_model(model, markers)
    free = compiling.free_coordinates(model)
    names = [c.name for c in model.coordinates]
    kinds = [c.kind for c in model.coordinates]
    own = {t.coordinate for j in root.joints for t in j.law.terms if t.coordinate is not None}
    turns = [k for k, name in enumerate(names) if name in own and kinds[k] == "rotation" and free[k]]
    q = np.array([c.default for c in model.coordinates])
    # A little bent: at the neutral pose axes may coincide that no person keeps aligned.
    q = q + np.where(
        free & np.array([kind == "rotation" for kind in kinds]), 0.15 + 0.01 * np.arange(len(q)) % 0.1, 0.0
    )
    poses = trees.pose_links(tree, np.ascontiguousarray(q[:, None]), compiling.list_parameter_values(model))
    variables = np.flatnonzero(free)
    rates = trees.order_by_frame(
        trees.compute_jacobian(tree, poses, trees.place_tree_markers(tree, poses), variables)
    )[0]
    values, vectors = np.linalg.eigh(rates @ rates.T)
    variance = (np.square(vectors) / np.maximum(values, 1e-9)).sum(axis=1) * _NOISE_M**2
    return float(np.sqrt(max((variance[np.flatnonzero(variables == k)[0]] for k in turns), default=0.0)))
