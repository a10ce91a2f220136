"""Where two moving segments turn against each other: centre (SCoRE) and axis (SARA) of rotation.

Neither segment is taken to be at rest. A point that both carry has constant coordinates ``c1`` in the
proximal and ``c2`` in the distal segment, so ``R c1 + t = S c2 + d`` in every frame; stacked over the
frames, ``[R, -S] [c1; c2] = d - t`` is one linear least-squares problem (Ehrig et al. 2006, J Biomech
39:2798-2809). If the segments share an axis and not only a point, the stacked matrix maps the axis'
directions in both segments to nothing: they are its singular vector of the smallest singular value
(Ehrig et al. 2007, J Biomech 40:2150-2157).

The matrix is divided by the root of the number of frames, so that singular values do not depend on it:
they lie between 0 and the root of 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scaling_service.core.arrays import Array
from scaling_service.numerics.multibody import rigid

FEWEST_FRAMES = 3
"""Three poses are the least that fix a common point: one gives three equations for six unknowns, two leave
the axis between them free."""

_RANK = 1e-9  # chosen: singular values are of the order of one, and rounding leaves 1e-16 of them


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """A segment's pose over time: a point ``p`` of the segment is at ``rotation @ p + position``."""

    rotation: Array  # (..., n_frames, 3, 3)
    position: Array  # (..., n_frames, 3), m: NaN in frames in which the pose is not known

    @property
    def known(self) -> NDArray[np.bool_]:
        """Whether each frame's pose is known, (..., n_frames)."""
        turned = np.isfinite(self.rotation).all(axis=(-2, -1))
        return np.asarray(turned & np.isfinite(self.position).all(axis=-1))

    def place(self, points: ArrayLike) -> Array:
        """A point of the segment, (..., 3), in every frame, (..., n_frames, 3), m."""
        moved: Array = np.einsum("...nij,...j->...ni", self.rotation, np.asarray(points, float))
        return moved + self.position

    def turn(self, directions: ArrayLike) -> Array:
        """A direction of the segment, (..., 3), in every frame, (..., n_frames, 3)."""
        return np.asarray(np.einsum("...nij,...j->...ni", self.rotation, np.asarray(directions, float)))


def join_poses(parts: Sequence[Poses]) -> Poses:
    """The frames of several recordings as one; the shape of ``Poses`` without batch axes."""
    return Poses(np.concatenate([p.rotation for p in parts]), np.concatenate([p.position for p in parts]))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RotationCentre:
    """The point that two segments share. All (...) are the batch axes."""

    # proximal, distal: (..., 3), m: its coordinates in both segments; NaN where fewer than ``FEWEST_FRAMES``
    # frames are known
    proximal: Array
    distal: Array
    rms: Array  # (...), m: root mean square distance between its two images, over the frames
    # (...), m: standard deviation (of the distance) of ``proximal``, from the residuals, frames taken as
    # independent: the least that it can be. Skin moves with the movement, and noise in the poses draws the
    # centre towards the markers where the range of motion is small.
    sd: Array
    frames: NDArray[np.intp]  # (...): how many were used


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RotationAxis:
    """The line that two segments share. All (...) are the batch axes."""

    # proximal, distal: (..., 3): its unit direction in both segments, the same way round; NaN where fewer
    # than ``FEWEST_FRAMES`` frames are known
    proximal: Array
    distal: Array
    # point_proximal, point_distal: (..., 3), m: one point of it in both segments: of all that fit equally,
    # the one nearest to both origins
    point_proximal: Array
    point_distal: Array
    rms: Array  # (...), m: root mean square distance between the point's two images, over the frames
    spread: Array  # (...), rad: root mean square angle between the direction's two images, over the frames
    # (...): smallest over second smallest singular value: zero for a pure hinge, one where no direction
    # stands out, as for a ball joint moved in all directions
    sharpness: Array
    frames: NDArray[np.intp]  # (...)


def find_rotation_centre(proximal: Poses, distal: Poses) -> RotationCentre:
    """Symmetrical centre of rotation estimation (SCoRE).

    ``proximal``, ``distal``: of the same frames. Origins near the joint keep the most digits.

    Ehrig R. et al. (2006) J Biomech 39:2798-2809, section 2.2.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> R, S = (np.linalg.qr(rng.normal(size=(9, 3, 3)))[0] for _ in range(2))
    >>> t = rng.normal(size=(9, 3))
    >>> first = Poses(R, t)
    >>> second = Poses(S, first.place([0.1, 0.2, 0.3]) - S @ np.array([0.0, 0.4, 0.0]))
    >>> found = find_rotation_centre(first, second)
    >>> found.proximal.round(9).tolist(), np.abs(found.distal).round(9).tolist()
    ([0.1, 0.2, 0.3], [0.0, 0.4, 0.0])
    """
    stack = _stack_frames(proximal, distal)
    solution = _solve_least_squares(stack, stack.values > _RANK)
    first, second = solution[..., :3], solution[..., 3:]
    gaps = proximal.place(first) - distal.place(second)
    return RotationCentre(
        proximal=first,
        distal=second,
        rms=_compute_rms(gaps, stack),
        sd=_estimate_deviation(stack, gaps),
        frames=stack.frames,
    )


def find_rotation_axis(proximal: Poses, distal: Poses) -> RotationAxis:
    """Symmetrical axis of rotation approach (SARA).

    ``proximal``, ``distal``: of the same frames.

    Ehrig R. et al. (2007) J Biomech 40:2150-2157.
    """
    stack = _stack_frames(proximal, distal)
    kept = stack.values > _RANK
    kept[..., -1] = False
    solution = _solve_least_squares(stack, kept)
    axis = stack.right[..., -1]
    first, second = _normalise(axis[..., :3]), _normalise(axis[..., 3:])
    gap = np.linalg.norm(proximal.turn(first) - distal.turn(second), axis=-1)
    angle = 2.0 * np.arcsin(np.clip(0.5 * gap, 0.0, 1.0))
    return RotationAxis(
        proximal=first,
        distal=second,
        point_proximal=solution[..., :3],
        point_distal=solution[..., 3:],
        rms=_compute_rms(proximal.place(solution[..., :3]) - distal.place(solution[..., 3:]), stack),
        spread=_compute_rms(angle[..., None], stack),
        sharpness=stack.values[..., -1] / np.maximum(stack.values[..., -2], _RANK),
        frames=stack.frames,
    )


def measure_ranges_of_motion(proximal: Poses, distal: Poses, share: float = 0.98) -> Array:
    """How far the distal segment turned against the proximal one, about its three principal directions.

    ``share``: of the frames that the ranges hold (chosen default: the outermost hundredth at either end may
        be labelling errors).
    Returns (..., 3), rad: descending; NaN where fewer than ``FEWEST_FRAMES`` frames are known. The directions
        are the principal axes of the rotation vectors about their mean pose, so that a movement in one plane
        has one range and a circumduction two.
    """
    known = proximal.known & distal.known
    relative = np.einsum("...nji,...njk->...nik", proximal.rotation, distal.rotation)
    relative = np.where(known[..., None, None], relative, np.eye(3))
    weight = known / np.maximum(known.sum(axis=-1, keepdims=True), 1)
    middle = rigid.find_nearest_rotation(np.einsum("...n,...nij->...ij", weight, relative))
    vectors = rigid.convert_rotation_to_vector(np.einsum("...ji,...njk->...nik", middle, relative))
    centred = vectors - np.einsum("...n,...ni->...i", weight, vectors)[..., None, :]
    spread = np.einsum("...n,...ni,...nj->...ij", weight, centred, centred)
    turned = np.einsum("...ni,...ij->...nj", centred, np.linalg.eigh(spread)[1])
    turned = np.where(known[..., None], turned, np.nan)
    enough = known.sum(axis=-1) >= FEWEST_FRAMES
    filled = np.where(enough[..., None, None], turned, 0.0)  # quantiles of nothing would warn
    low, high = np.nanquantile(filled, (0.5 - share / 2.0, 0.5 + share / 2.0), axis=-2)
    sizes: Array = np.sort(high - low, axis=-1)[..., ::-1]
    return np.where(enough[..., None], sizes, np.nan)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Stack:
    """The scaled matrix of all frames as its singular value decomposition, and its right-hand side."""

    rows: Array
    left: Array
    values: Array
    right: Array
    side: Array
    known: NDArray[np.bool_]
    frames: NDArray[np.intp]


def _stack_frames(proximal: Poses, distal: Poses) -> _Stack:
    """Frames that are not known become rows of zeros, which say nothing."""
    known = proximal.known & distal.known
    frames = known.sum(axis=-1)
    scale = 1.0 / np.sqrt(np.maximum(frames, 1))
    rows = np.concatenate([proximal.rotation, -distal.rotation], axis=-1)
    side = distal.position - proximal.position
    rows = np.where(known[..., None, None], rows, 0.0) * scale[..., None, None, None]
    side = np.where(known[..., None], side, 0.0) * scale[..., None, None]
    matrix = rows.reshape(*rows.shape[:-3], -1, 6)
    left, values, right = np.linalg.svd(matrix, full_matrices=False)
    lost = (frames < FEWEST_FRAMES)[..., None]
    values = np.where(lost, np.nan, values)
    return _Stack(
        rows=rows,
        left=left,
        values=values,
        right=np.where(lost[..., None], np.nan, np.swapaxes(right, -1, -2)),
        side=side.reshape(*side.shape[:-2], -1),
        known=known,
        frames=frames,
    )


def _solve_least_squares(stack: _Stack, kept: NDArray[np.bool_]) -> Array:
    """The shortest solution in the singular directions kept, (..., 6)."""
    along = np.einsum("...mk,...m->...k", stack.left, stack.side)
    along = np.where(kept, along / np.where(kept, stack.values, 1.0), 0.0)
    return np.asarray(np.einsum("...ik,...k->...i", stack.right, along))


def _estimate_deviation(stack: _Stack, gaps: Array) -> Array:
    """Scatter of the first three unknowns, (...): the sandwich of Huber (1967), one slope for each frame.

    The components of a gap are not independent of each other: an error of a segment's direction moves
    its image of the centre across its lever arm.
    """
    known = stack.known[..., None]
    slopes = np.where(known, gaps, 0.0)[..., None, :] @ stack.rows
    inverse = np.where(stack.values > _RANK, 1.0 / np.maximum(stack.values, _RANK), 0.0)
    steps = np.einsum("...nz,...zk->...nk", slopes[..., 0, :], stack.right) * inverse[..., None, :] ** 2
    moved = np.einsum("...nk,...ik->...ni", steps, stack.right[..., :3, :])
    spare = stack.frames / np.where(stack.frames > FEWEST_FRAMES, stack.frames - 2, np.nan)
    variance: Array = spare * (moved**2).sum(axis=(-2, -1)) / np.maximum(stack.frames, 1)
    return np.sqrt(variance)


def _compute_rms(gaps: Array, stack: _Stack) -> Array:
    """Of the lengths of gaps (..., n_frames, k) over the frames known; NaN where there are too few."""
    squared = np.where(stack.known, (gaps**2).sum(axis=-1), 0.0).sum(axis=-1)
    mean: Array = squared / np.where(stack.frames < FEWEST_FRAMES, np.nan, stack.frames)
    return np.sqrt(mean)


def _normalise(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
