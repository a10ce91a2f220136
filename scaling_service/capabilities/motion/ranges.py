"""What markers tell of a coordinate beside what its joint's ordinary range tells anyway.

Each coordinate of a joint has a normal prior: its middle is the model's default pose, and its range holds two
standard deviations to either side. With the markers' information it makes a posterior. A coordinate of which
the markers tell less than the range does (its posterior variance is more than half of the prior one) is
*held*: two markers on a foot show where it points, hardly how it is rolled. The solver then weighs its range
beside the markers, and so does its deviation. A coordinate of which they tell nothing is *not shown*, and
results do not tell it. Those that the markers show are left to the markers alone.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.core import arrays
from scaling_service.model import body
from scaling_service.model import compile as compiling
from scaling_service.model.builtin import lock_unmarked
from scaling_service.numerics.least_squares.problem import find_seen
from scaling_service.numerics.multibody import tree as trees

_MARKER_M = 0.010
"""Standard deviation of a marker about the model's bone along one axis: reference_models/people.yaml has
4 to 9 mm between foot and thigh; a model that is scaled, not measured, adds its own."""

_RANGE_SDS = 2.0
"""Standard deviations from the middle of a joint's range to its ends: 95 % of postures lie within."""

_MORE = 0.5
"""Share of the prior's variance that may be left. Chosen: at half, markers and range tell as much."""

_NOTHING = 0.99
"""Share of the prior's variance from which on the markers tell nothing: what is left is rounding."""

_FOLLOWS = 0.01
"""Chosen: of the median weight; what counts for less follows and tells nothing. Weights in set-ups go from 1
to 50 by what their author trusts, and are no accuracies."""

_WIDEST = np.pi
"""rad: a range that is wider than half a turn to either side, or a way of a translation without ends, tells
nothing."""

_BENT = (0.0, 0.5)
"""Poses that are asked, as shares of the way from the default to the middle of the range: an arm that can be
bent shows how its shoulder turns though it hangs straight by default."""

_LEAST = 1e-4
"""1/m2 or 1/rad2: of what has no range, such as the body's place in the laboratory (a spread of 100 m)."""


@dataclass(frozen=True, slots=True, eq=False)
class Ranges:
    """What holds the coordinates that are not shown.

    ``middle`` and ``spread`` (n_coordinates,), rad or m; ``weight`` (n_frames, n_coordinates), in the units
    of squared marker distances times their weights: zero where the markers tell enough. ``shown`` of the same
    shape: whether they tell anything.
    """

    middle: arrays.Array
    spread: arrays.Array
    weight: arrays.Array
    shown: arrays.Mask

    def in_frames(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> Ranges:
        """The same in some frames."""
        return Ranges(self.middle, self.spread, self.weight[rows], self.shown[rows])

    def combine(self, sd: arrays.Array) -> arrays.Array:
        """Deviations by markers (n_frames, n_coordinates) with what the range tells of those held."""
        with np.errstate(invalid="ignore"):
            both = sd / np.sqrt(1.0 + np.square(sd / self.spread))
        return np.asarray(np.where(self.weight > 0.0, both, sd))

    @property
    def prior(self) -> tuple[arrays.Array, arrays.Array] | None:
        """Values and weights for the solver, each (n_frames, n_coordinates); None if nothing is held."""
        held = self.weight > 0.0
        return (np.broadcast_to(self.middle, held.shape), self.weight) if held.any() else None


def weigh_ranges(
    model: body.BodyModel,
    tree: trees.Tree,
    measured: arrays.Array,
    weights: arrays.Array,
    free: arrays.Mask,
    p: arrays.Array,
) -> Ranges:
    """Which coordinates each frame's markers show, and how the others are held.

    ``measured`` (n_frames, n_markers, 3), m, NaN where not seen; ``weights`` (n_markers,); ``free``
    (n_coordinates,); ``p`` (n_parameters,).
    """
    seen = find_seen(measured)
    first, which = find_distinct_patterns(seen)
    patterns = seen[first]
    spread = list_prior_sds(model)
    unit = float(np.median(weights[weights > 0.0])) if (weights > 0.0).any() else 1.0
    leads = weights > _FOLLOWS * unit
    share = measure_left(model, tree, (patterns & leads).astype(float), free, p)
    weight = np.where(share <= _MORE, 0.0, unit * (_MARKER_M / spread) ** 2)
    if (~leads & (weights > 0.0)).any():  # what followers show, where nothing else does, is left to them
        followed = measure_left(model, tree, (patterns & (weights > 0.0)).astype(float), free, p) <= _MORE
        weight = np.where(followed, 0.0, weight)
    return Ranges(
        compiling.repeat_default_pose(model, 1)[0], spread, weight[which], (share < _NOTHING)[which]
    )


def find_distinct_patterns(shown: arrays.Mask) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The first frame of every pattern (n_frames, n_markers), and the pattern of every frame."""
    packed = np.ascontiguousarray(np.packbits(shown, axis=1))  # one item a frame sorts far faster than rows
    items = packed.view(np.dtype((np.void, packed.shape[1])))[:, 0]
    _, first, which = np.unique(items, return_index=True, return_inverse=True)
    return first, which


def list_prior_sds(model: body.BodyModel) -> arrays.Array:
    """Standard deviation of each coordinate in ordinary postures, rad or m; infinite without a range."""
    lower, upper = compiling.list_coordinate_ranges(model)
    spread = (upper - lower) / (2.0 * _RANGE_SDS)
    turns = np.array([c.kind == "rotation" for c in model.coordinates], dtype=bool)
    return np.where(turns & (spread < _WIDEST / _RANGE_SDS), spread, np.inf)


def measure_left(
    model: body.BodyModel, tree: trees.Tree, told: arrays.Array, free: arrays.Mask, p: arrays.Array
) -> arrays.Array:
    """Posterior over prior variance of each coordinate, (n_patterns, n_coordinates); zero where not asked.

    ``told`` (n_patterns, n_markers): how much each marker counts, 1 for one that is seen. The lower of that
    in the default pose and that half-way to the middle of all ranges.
    """
    spread = list_prior_sds(model)
    asked = free & np.isfinite(spread)
    left = np.zeros((len(told), len(free)))
    if not asked.any():
        return left
    neutral = compiling.repeat_default_pose(model, 1)[0]
    lower, upper = compiling.list_coordinate_ranges(model)
    with np.errstate(invalid="ignore"):
        middle = np.where(asked, 0.5 * (lower + upper), neutral)
    variables = np.flatnonzero(free)
    poses = trees.pose_links(tree, np.stack([neutral + s * (middle - neutral) for s in _BENT], axis=1), p)
    rates = trees.compute_jacobian(tree, poses, trees.place_tree_markers(tree, poses), variables)
    rates = rates.transpose(3, 1, 2, 0) / _MARKER_M  # (n_poses, n_markers, 3, n_variables)
    prior = np.where(asked, 1.0 / np.square(spread), _LEAST)[variables]
    each = rates.swapaxes(2, 3) @ rates
    count, few = len(variables), len(_BENT)
    information = (told @ each.swapaxes(0, 1).reshape(len(each[0]), -1)).reshape(-1, few, count, count)
    variance = np.einsum("npkk->npk", np.linalg.inv(information + np.diag(prior)))
    left[:, variables] = np.where(asked[variables], (variance * prior).min(axis=1), 0.0)
    return left


def list_unshown(model: body.BodyModel, markers: Collection[str]) -> frozenset[str]:
    """Coordinates that none of these markers shows, of those that have a range and are not locked."""
    names = [m.name for m in model.markers if m.weight > 0.0]
    tree, free = compiling.compile_model(model, names), compiling.free_coordinates(model)
    told = np.isin(names, list(markers))[None].astype(float)
    left = measure_left(model, tree, told, free, compiling.list_parameter_values(model))[0]
    return frozenset(
        c.name for c, share in zip(model.coordinates, left.tolist(), strict=True) if share > _MORE
    )


def list_joint_coordinates(model: body.BodyModel, segment: body.Segment) -> frozenset[str]:
    """The free coordinates of the joint that carries a segment."""
    loose = {c.name for c in model.coordinates if not c.locked}
    return frozenset(loose & {t.coordinate for j in segment.joints for t in j.law.terms})


def list_hidden_segments(model: body.BodyModel, markers: Collection[str]) -> list[str]:
    """Segments of which these markers show nothing: no coordinate of the joint that carries them."""
    segments = {m.name: m.segment for m in model.markers if m.name in markers}
    model, _ = lock_unmarked(model, segments)
    unshown = list_unshown(model, markers)
    joints = {s.name: list_joint_coordinates(model, s) for s in model.segments}
    return [name for name, own in joints.items() if own and own <= unshown]
