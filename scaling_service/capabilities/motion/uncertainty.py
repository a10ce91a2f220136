"""Which coordinates the markers of each frame determine, and how surely, skin over bone included.

The estimate moves with the markers' noise as ``H^-1 J^T W e`` (``H = J^T W J``, the Gauss-Newton matrix of
the frame), so its covariance is ``H^-1 J^T W S W J H^-1`` whatever the weights W: the sandwich of Huber 1967.
S holds one variance for each marker, for skin moves more in one place than in another, and what markers of a
segment do alike, which looks like a motion of the bone and leaves no residual.

What skin does is people's (``reference_models/people.yaml``): a segment's markers shift and turn together,
and each moves beside that.

An error of the model's joints that the recording's residuals do not show is not in these numbers. A gap that
processing filled counts as seen.
"""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from scaling_service.model import people as population
from scaling_service.model.anatomy.skin import is_pin
from scaling_service.model.places import tell_landmarks
from scaling_service.numerics.least_squares import problem
from scaling_service.numerics.multibody import tree as trees
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.rigid import fit_rigid

if TYPE_CHECKING:
    from scaling_service.capabilities.motion.task import Task


_FRAMES = 200  # looked at, equally spaced (chosen: skin moves slowly, neighbours tell the same)
_LEAST_DEFORMATION = 0.01  # chosen: below it deformation is the cameras' noise

_BLOCK = 256  # frames linearised together, as elsewhere
_MOST_FRAMES = 1000  # chosen: equally spaced; their residuals give a variance to about 3 %
_PRIOR_FREEDOM = 30.0  # chosen: below about ten frames a marker's own residuals say less than all markers' do
_MIXING = 0.1  # chosen: combinations of markers that share a residual this much cannot be told apart
_RIDGE = 1e-13  # share of the largest curvature: keeps a singular pose from stopping all others
_NO_RATE = 1e-6  # chosen: of an angle on a coordinate, far above what differencing leaves
_WHOLE_TURN = 2.0 * np.pi  # rad: no camera's noise leaves more open
_RESOLUTION_M = 1e-6  # chosen: no camera resolves less, so a perfect fit is not taken for certainty

_NULL = 1e-7  # chosen: curvature per unit weight (1 m arm) below which a direction counts as free
_SHARE = 1e-2  # chosen: of a coordinate's direction that may be free before it counts as not determined
_JUDGED = (0.0, 0.5, 1.0)  # chosen: frames, as shares of those alike, judged in turn where some are left open


@dataclass(frozen=True, slots=True, eq=False)
class SkinField:
    """The skin over one segment."""

    markers: NDArray[np.intp]  # (m,): numbers of its markers in the task
    covariance: Array  # (3 m, 3 m), m2: of their displacements along the segment's axes, marker by marker


def list_skin_fields(task: Task) -> abc.Iterator[SkinField]:
    """The field over every segment that has markers, as people's skin moves.

    How far the markers depart from a rigid cluster in this recording tells a part of how much more, or less,
    than ordinary people's this person's skin moves there.
    """
    model, people = task.model, population.read_people()
    owners, told = [model.marker(name).segment for name in task.markers], tell_landmarks(model)
    for segment in dict.fromkeys(owners):
        rows = np.array([k for k, s in enumerate(owners) if s == segment], dtype=np.intp)
        names = [task.markers[k] for k in rows]
        places = np.array([model.marker(name).nominal for name in names])
        skin = cover_with_skin(model.bone_of(segment), people, told, names, places, 1.0)
        # How much more a cluster deforms than expected, as a ratio of lengths; one where nothing shows
        # it. `places` (m, 3), `measured` (n, m, 3), m; `skin` (3 m, 3 m): covariance of displacements.
        measured = task.measured[:, rows]
        count = len(places)
        whole = np.flatnonzero(np.isfinite(measured).all(axis=(1, 2)))
        some = measured[whole[np.linspace(0, len(whole) - 1, min(len(whole), _FRAMES)).astype(np.intp)]]
        rotation, shift = fit_rigid(places, some)
        known = np.isfinite(shift).all(axis=1)
        turns = np.cross(np.eye(3)[None], (places - places.mean(axis=0))[:, None]).transpose(0, 2, 1)
        rigid = np.concatenate([np.tile(np.eye(3), (count, 1)), turns.reshape(-1, 3)], axis=1)
        free = np.eye(3 * count) - rigid @ np.linalg.pinv(rigid)
        expected = float(np.trace(free @ skin))
        if count < 3 or not known.any() or expected <= 0.0:
            deformation = 1.0
        else:
            left = some[known] - np.einsum("nij,mj->nmi", rotation[known], places) - shift[known, None]
            deformation = max(
                float(np.sqrt(np.square(left).sum(axis=(1, 2)).mean() / expected)), _LEAST_DEFORMATION
            )
        level = deformation**people.recorded_share
        yield SkinField(rows, level**2 * skin)


def cover_with_skin(
    bone: str,
    people: population.People,
    told: abc.Mapping[str, str],
    markers: abc.Sequence[str],
    places: Array,
    share: float,
) -> Array:
    """Covariance of the displacements of one segment's markers over the bone, (3 m, 3 m), m2; none of pins.

    ``told``: markers that are landmarks. ``places`` (m, 3), m, in the segment's axes. ``share``: of sizes.
    """
    covariance = people.skin_covariance(bone, [told.get(name) for name in markers], places, share)
    moves = np.repeat([not is_pin(name) for name in markers], 3)
    return covariance * np.outer(moves, moves)


Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CoordinateSd:
    """Standard deviations of coordinates, and of the noise that they come from."""

    # (n_frames, n_coordinates), rad or m: zero for coordinates that the model locks; NaN where the markers do
    # not determine one, and where it stands at the end of its range, which then decides and not the markers
    sd: Array
    # (n_markers,), m: standard deviation of one coordinate of each marker about the model; NaN for one never
    # seen
    noise: Array
    at_range_end: Mask  # (n_frames, n_coordinates)
    # (n_frames, n_combined): of what was asked for beside the coordinates, such as conventional angles; NaN
    # where one depends on a coordinate whose own is not known
    combined: Array | None = None
    # (n_coordinates,), rad or m: of a coordinate's mean over the trial, for a model that knows what frames
    # have in common; None for others
    mean: Array | None = None


def estimate_coordinate_sd(
    task: Task,
    q: Array,
    residuals: Array,
    known: Mask,
    fields: abc.Sequence[SkinField] = (),
    rates: abc.Callable[[Array], Array] | None = None,
) -> CoordinateSd:
    """Standard deviation of every coordinate in every frame of a solved task.

    ``q`` (n_frames, n_coordinates), rad or m; ``residuals`` (n_frames, n_markers, 3), m, measured minus
    model, NaN where not seen; ``known``: where the markers of a frame determine a coordinate; ``fields``: how
    skin moves over the bone. ``rates``: of coordinates, how fast what else is asked
    for changes with each, (n_frames, n_combined, n_coordinates).
    """
    lower, upper = task.bounds
    at_end = ((q <= lower) | (q >= upper)) & task.free
    held = at_end | ~known
    variance = _list_marker_variances(task, q, residuals, held)
    sd, combined = np.zeros(q.shape), list[Array]()
    for rows in split_frames(len(q)):
        by_marker, curvature = _linearise(task, q[rows], residuals[rows], held[rows])
        follow = np.matmul(np.linalg.inv(curvature), by_marker)
        axes = trees.pose_links(task.tree, np.ascontiguousarray(q[rows].T), task.p).axes
        turns = [axes[task.tree.marker_link[field.markers[0]]] for field in fields]
        sd[rows, task.free] = _spread(follow, variance, fields, turns, task.weights)
        if rates is not None:
            change = rates(q[rows])
            found = _spread(change[:, :, task.free] @ follow, variance, fields, turns, task.weights)
            combined.append(np.where(find_lost(change, held[rows] & task.free), np.nan, found))
    sd[held & task.free] = np.nan
    shown = problem.find_shown(residuals)
    noise = np.where(shown, np.sqrt(variance), np.nan)
    joined = np.concatenate(combined) if combined else None
    return CoordinateSd(sd=sd, noise=noise, at_range_end=at_end, combined=joined)


def count_departures(
    found: CoordinateSd,
    departures: Array,
    q: Array,
    rates: abc.Callable[[Array], Array] | None = None,
) -> CoordinateSd:
    """Deviations of a model of which is known how far its coordinates are off in all.

    ``departures`` (n_coordinates,), rad or m; NaN where not known. They hold what markers leave open in an
    ordinary frame; by how much more a frame leaves open than the median one comes on top.
    """
    square = np.square(found.sd)
    usual = np.nanmedian(np.where(square > 0.0, square, np.nan), axis=0)
    in_all = np.square(departures) + np.maximum(square - usual, 0.0)
    restated = np.where(np.isfinite(in_all), in_all, square)
    combined = found.combined
    if combined is not None and rates is not None:
        more = np.nan_to_num(restated - square)
        changes = (np.square(rates(q[rows])) @ more[rows, :, None] for rows in split_frames(len(q)))
        combined = np.sqrt(np.maximum(np.square(combined) + np.concatenate(list(changes))[:, :, 0], 0.0))
    return replace(found, sd=np.sqrt(restated), combined=combined)


def find_lost(change: Array, unknown: Mask) -> Mask:
    """Which combinations, by their rates (n, k, n_coordinates), depend on an unknown coordinate, (n, k)."""
    return np.asarray(((np.abs(change) > _NO_RATE) & unknown[:, None]).any(axis=2))


def _spread(
    follow: Array,
    variance: Array,
    fields: abc.Sequence[SkinField],
    turns: abc.Sequence[Array],
    weights: Array,
) -> Array:
    """Standard deviations (n, k) of what follows displacements times root weights, (n, k, 3 n_markers).

    ``turns``: of each field's segment, (3, 3, n): rows are its axes.
    """
    square = np.square(follow) @ np.repeat(weights * variance, 3)
    by_marker = follow.reshape(*follow.shape[:2], -1, 3)
    for field, axes in zip(fields, turns, strict=True):
        heavy = by_marker[:, :, field.markers] * np.sqrt(weights[field.markers])[:, None]
        local = np.einsum("jan,nkma->nkmj", axes, heavy, optimize=True).reshape(*follow.shape[:2], -1)
        square += ((local @ field.covariance) * local).sum(axis=2)
    return np.asarray(np.sqrt(square))


def split_frames(count: int) -> abc.Iterator[slice]:
    """All frames, in blocks that are linearised together."""
    return (slice(start, min(start + _BLOCK, count)) for start in range(0, count, _BLOCK))


def _linearise(task: Task, q: Array, residuals: Array, held: Mask) -> tuple[Array, Array]:
    """Rates of the markers times root weights, (n, n_free, 3 n_markers), and their Gauss-Newton matrix.

    Rates are zero for what is held and what is not seen.
    """
    free = np.flatnonzero(task.free)
    heavy = np.repeat(np.where(problem.find_seen(residuals), np.sqrt(task.weights), 0.0), 3, axis=1)
    rates = trees.compute_marker_rates(task.tree, q, task.p, free)
    rates *= heavy[:, None]
    rates *= ~held[:, free, None]
    curvature = np.matmul(rates, rates.transpose(0, 2, 1))
    if task.closure is not None:
        bound = task.closure.linearise(q, task.p, free)[1] * ~held[:, free, None]
        curvature += problem.CLOSING * task.weights.sum() * np.matmul(bound, bound.transpose(0, 2, 1))
    diagonal = np.einsum("nii->ni", curvature)
    diagonal += np.where(held[:, free], 1.0, _RIDGE * diagonal.max(axis=1, initial=0.0, keepdims=True))
    return rates, curvature


def _list_marker_variances(task: Task, q: Array, residuals: Array, held: Mask) -> Array:
    """Variance of one coordinate of each marker, (n_markers,), m2.

    A fit of full freedom ``M = 1 - J^T H^-1 J`` leaves ``E|r_m|^2 = sum_k |M_mk|^2 v_k``: the residual of a
    marker holds the noise of others, too. As M is idempotent, ``u_m = |r_m|^2 / trace M_mm`` is a weighted
    mean of the ``v_k`` (HC2 of MacKinnon & White 1985); that mean is undone as far as it is well posed
    (Rao 1971, MINQUE). Markers with few residuals lean on the mean of all (Smyth 2004).
    """
    rows = np.unique(np.linspace(0, len(q) - 1, min(len(q), _MOST_FRAMES)).round().astype(np.intp))
    count = len(task.weights)
    squares, freedom, shares = np.zeros(count), np.zeros(count), np.zeros((count, count))
    for some in (rows[part] for part in split_frames(len(rows))):
        shown = problem.find_seen(residuals[some])
        rates, curvature = _linearise(task, q[some], residuals[some], held[some])
        hat = np.matmul(rates.transpose(0, 2, 1), np.matmul(np.linalg.inv(curvature), rates))
        left = np.repeat(shown, 3, axis=1)[:, :, None] * np.eye(3 * count) - hat
        blocks = np.square(left).reshape(len(some), count, 3, count, 3).sum(axis=(2, 4))
        squares += np.nansum(task.weights[:, None] * residuals[some] ** 2, axis=(0, 2))
        freedom += np.einsum("nii->i", left.reshape(len(some), 3 * count, 3 * count)).reshape(count, 3).sum(1)
        shares += blocks.sum(axis=0)
    pooled = squares.sum() / max(freedom.sum(), 1.0)
    own = (squares + _PRIOR_FREEDOM * pooled) / (freedom + _PRIOR_FREEDOM)
    shares = (shares + np.diag(_PRIOR_FREEDOM * np.ones(count))) / (freedom + _PRIOR_FREEDOM)[:, None]
    apart, _ = scipy.optimize.nnls(
        np.vstack([shares, _MIXING * np.eye(count)]), np.concatenate([own, _MIXING * own])
    )
    return np.asarray(np.maximum(apart / task.weights, _RESOLUTION_M**2))


def estimate_noise_variance(task: Task, q: Array, noise: float) -> Array:
    """Variance of each free coordinate where nothing but the cameras' ``noise`` (m) errs, (n_frames, n_free).

    ``q`` (n_frames, n_coordinates). In rad2 or m2: a coordinate that nothing tells is unsure by a whole turn.
    """
    heavy = np.repeat(np.where(task.shown, np.sqrt(task.weights), 0.0), 3, axis=1)
    rates = trees.compute_marker_rates(task.tree, q, task.p, np.flatnonzero(task.free)) * heavy[:, None]
    curvature = np.matmul(rates, rates.transpose(0, 2, 1))
    ridge = (noise / _WHOLE_TURN) ** 2 * np.eye(curvature.shape[1])
    return np.asarray(noise**2 * np.einsum("nii->ni", np.linalg.inv(curvature + ridge)))


def find_determined(task: Task, q: Array) -> Mask:
    """Whether each coordinate is determined in each frame, (n_frames, n_coordinates).

    Frames in which the same markers are seen are judged together, at a few of them: it is what is seen,
    hardly the pose, that decides. Where a marker stands as far out as its joint can carry it, its coordinate
    seems free; what one pose determines counts as determined. What every pose obeys determines coordinates as
    markers do; those that are not free are known and count as determined.

    ``q`` (n_frames, n_coordinates).
    """
    first, which = task.patterns
    patterns = task.shown[first] & (task.weights > 0.0)
    order, counts = np.argsort(which, kind="stable"), np.bincount(which)
    verdict = np.tile(~task.free, (len(first), 1))
    # What no marker follows stays open in every pose
    within_reach = task.closure is not None or patterns @ task.tree.followed
    for share in _JUDGED:
        doubted = np.flatnonzero((~verdict & within_reach).any(axis=1))
        if not len(doubted):
            break
        places = np.cumsum(counts) - counts + (share * (counts - 1)).astype(np.intp)
        judged = _judge(task, patterns[doubted], q[order[places[doubted]]])
        verdict[np.ix_(doubted, task.free)] |= judged
    return verdict[which]


def _judge(task: Task, patterns: Mask, q: Array) -> Mask:
    """Whether markers seen so (n, n_markers) determine the free coordinates at these poses, (n, n_free)."""
    variables = np.flatnonzero(task.free)
    poses = trees.pose_links(task.tree, np.ascontiguousarray(q.T), task.p)
    placed = trees.place_tree_markers(task.tree, poses)
    rates = np.moveaxis(trees.compute_jacobian(task.tree, poses, placed, variables), (0, 3), (3, 0))
    rates = (rates * patterns[:, :, None, None]).reshape(len(q), -1, len(variables))
    if task.closure is not None:
        following = task.closure.linearise(q, task.p, variables)[1]
        rates = np.concatenate([rates, following.transpose(0, 2, 1)], axis=1)
    curvature = np.matmul(rates.transpose(0, 2, 1), rates)
    values, vectors = np.linalg.eigh(curvature)
    loose = (vectors**2 * (values < _NULL)[:, None, :]).sum(axis=2)
    return np.asarray(loose <= _SHARE)
