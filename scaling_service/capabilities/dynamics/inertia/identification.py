"""Inertial parameters of a person's segments from the forces of the ground (Futamure et al., eq. 8).

Tables are the prior; the recordings move only what they say more about than the tables do. Every result is
the inertia of a possible body: a quadratic minimum under linear matrix inequalities. Clarabel (Goulart &
Chen 2024, arXiv:2405.12762) solves the cone programme. It is called directly: a modelling language would be
several times its size, and the problem has one form only.
"""

from __future__ import annotations

import dataclasses
from collections import abc

import clarabel
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from scaling_service.capabilities.dynamics.inertia import evidence as weighing
from scaling_service.capabilities.dynamics.inertia import parameters as inertia_parameters
from scaling_service.core import errors
from scaling_service.core.arrays import Array
from scaling_service.core.names import say_name, say_names
from scaling_service.core.text import list_few
from scaling_service.model import compile as compiling
from scaling_service.model import inertia
from scaling_service.model.anatomy.inertia import find_possible_tensor
from scaling_service.model.body import BodyModel
from scaling_service.numerics.multibody import motion
from scaling_service.numerics.multibody.tree import pose_links

KEPT = 0.1
"""Share of the prior's mass, and of its second moment along any direction, that a segment keeps at least
(chosen: a third of a radius of gyration; a limit against degenerate bodies, far from all tables)."""

_SIDE = 4
_COLUMNS, _ROWS = np.tril_indices(_SIDE)  # of upper triangles column by column, the solver's order
_ROOTS = np.where(_ROWS == _COLUMNS, 1.0, np.sqrt(2.0))  # what the solver wants off-diagonals times
_SOLVED = frozenset({"Solved", "AlmostSolved"})

DECIDES = 1.0
"""Information of the recordings over that of the prior above which a combination may move (chosen: the
recordings then say more about it than the tables; the same rule as for a parameter's ``identifiable``)."""

ARM_M = 1.17
"""Error of a moment over that of a force where neither is known: residuals of 1.3 % of body weight times
height beside 2 % of body weight, at 1.80 m (Muller et al. 2017, sec. 3)."""

SURPRISING = 3.0
"""Prior standard deviations beyond which a change counts as a surprise (chosen: one in 400 by chance)."""

WORSE = 1.01
"""Growth of the held-out error that is reported (chosen: less is beyond what such figures can tell)."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Body:
    """What one segment's parameters must obey."""

    row: int  # the segment
    # low, high (3,), m: box of the centre of mass, in the segment's frame; the prior's lies inside
    low: Array
    high: Array


def form_pseudo_inertia(parameters: Array) -> Array:
    """The matrix that is positive definite for every body and for nothing else.

    Of ``Inertias.parameters`` (..., 10), or of any change of them, for it is linear: (..., 4, 4), second
    moments of the mass about the origin, bordered by first moments and mass. Wensing P. M., Kim S.,
    Slotine J.-J. E. (2018) Linear matrix inequalities for physically consistent inertial parameter
    identification. IEEE Robot Autom Lett 3:60-67.
    """
    tensor = np.empty((*parameters.shape[:-1], 3, 3))
    for column, (i, j) in enumerate(motion.TENSOR, start=4):
        tensor[..., i, j] = tensor[..., j, i] = parameters[..., column]
    matrix = np.empty((*parameters.shape[:-1], _SIDE, _SIDE))
    half = 0.5 * np.trace(tensor, axis1=-2, axis2=-1)
    matrix[..., :3, :3] = half[..., None, None] * np.eye(3) - tensor
    matrix[..., :3, 3] = matrix[..., 3, :3] = parameters[..., 1:4]
    matrix[..., 3, 3] = parameters[..., 0]
    return matrix


def minimise_within_cone(
    curvature: Array, slope: Array, mean: Array, directions: Array, bodies: tuple[Body, ...]
) -> Array | None:
    """Minimise ``y' diag(curvature) y / 2 - slope' y`` so that ``mean + directions @ y`` are bodies.

    ``curvature`` and ``slope`` (k,), ``directions`` (10 n, k), and ``mean`` (n, 10), itself possible, to y
    (k,); None where the solver found no minimum.
    """
    # In units of 1 / sqrt(curvature) all unknowns are alike; the solver may fail where gains differ by 1e4.
    unit = 1.0 / np.sqrt(curvature)
    moves = (directions * unit).reshape(len(mean), motion.N_PARAMETERS, -1)
    boxes = []
    for b in bodies:
        # Rows `a y + b >= 0` that keep the centre of mass in its box: linear in mass and first moment.
        own = mean[b.row]
        moving = moves[b.row]
        size = own[0] * np.maximum(b.high - b.low, 1e-6)[:, None]
        lower = (moving[1:4] - b.low[:, None] * moving[0]) / size
        upper = (b.high[:, None] * moving[0] - moving[1:4]) / size
        at = np.concatenate([own[1:4] - b.low * own[0], b.high * own[0] - own[1:4]])
        boxes.append((np.concatenate([lower, upper]), at / np.concatenate([size[:, 0], size[:, 0]])))
    cones = [_bound_cone(mean[b.row], moves[b.row]) for b in bodies]
    parts = [*boxes, *cones]
    free = slope * unit
    if all((a @ free + b >= 0.0).all() for a, b in boxes) and all(
        _is_positive(a @ free + b) for a, b in cones
    ):
        return np.asarray(slope / curvature)  # no constraint binds; the solver fails on some of these
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solution = clarabel.DefaultSolver(
        sparse.identity(len(slope), format="csc"),
        -slope * unit,
        sparse.csc_matrix(-np.concatenate([a for a, _ in parts])),
        np.concatenate([b for _, b in parts]),
        [
            *(clarabel.NonnegativeConeT(len(b)) for _, b in boxes),
            *(clarabel.PSDTriangleConeT(_SIDE) for _ in cones),
        ],
        settings,
    ).solve()
    return np.array(solution.x) * unit if str(solution.status) in _SOLVED else None


def _bound_cone(mean: Array, moves: Array) -> tuple[Array, Array]:
    """Rows of ``pseudo-inertia - KEPT * prior's``, in axes that make the prior's nearly the unit matrix."""
    values, vectors = np.linalg.eigh(form_pseudo_inertia(mean))
    # A flat body (toes in OpenSim's models) has no thickness to lose: it counts as a thin one.
    to_unit = vectors / np.sqrt(np.maximum(values, 1e-9 * values[-1]))
    turned = to_unit.T @ form_pseudo_inertia(moves.T) @ to_unit
    return _take_triangle(turned).T, _take_triangle((1.0 - KEPT) * np.eye(_SIDE))


def _take_triangle(matrices: Array) -> Array:
    """Upper triangles as the solver takes them, (..., 10)."""
    return matrices[..., _ROWS, _COLUMNS] * _ROOTS


def _is_positive(triangle: Array) -> bool:
    """Whether the matrix of a triangle (10,) is positive semidefinite."""
    matrix = np.zeros((_SIDE, _SIDE))
    matrix[_ROWS, _COLUMNS] = matrix[_COLUMNS, _ROWS] = triangle / _ROOTS
    return bool(np.linalg.eigvalsh(matrix)[0] >= 0.0)


def list_bodies(model: BodyModel) -> tuple[Body, ...]:
    """The box of every segment with mass, in its own frame.

    It spans the joint centres (the segment's own and those of the segments that it carries, in the model's
    default posture) and the markers on it. Along each axis it reaches at least one standard deviation of the
    segment's own mass to both sides of the prior's centre, for so far the segment itself reaches.
    """
    tree, q = (
        inertia.compile_whole_tree(model),
        np.ascontiguousarray(compiling.repeat_default_pose(model, 1).T),
    )
    poses = pose_links(tree, q, compiling.list_parameter_values(model))
    origins, axes = poses.origins[..., 0], poses.axes[..., 0].transpose(0, 2, 1)
    bodies = []
    for k, segment in enumerate(model.segments):
        if segment.mass <= 0:
            continue
        carried = [i for i, s in enumerate(model.segments) if s.parent == segment.name]
        joints = (origins[[k, *carried]] - origins[k]) @ axes[k]
        markers = np.array([m.nominal for m in model.markers if m.segment == segment.name]).reshape(-1, 3)
        com, tensor = np.array(segment.com), inertia.to_matrix(segment.inertia)
        moments = 0.5 * np.trace(tensor) - np.diag(tensor)
        reach = np.sqrt(np.clip(moments, 0.0, None) / segment.mass)
        points = np.concatenate([joints, markers, [com - reach, com + reach]])
        bodies.append(Body(k, points.min(axis=0), points.max(axis=0)))
    return tuple(bodies)


@dataclasses.dataclass(frozen=True, slots=True)
class IdentificationSettings:
    """How inertia is identified."""

    spread: inertia_parameters.PriorSpread = dataclasses.field(default_factory=inertia_parameters.PriorSpread)
    mass_known: bool = True  # whether the total mass stays; else the plates tell it
    symmetric: bool = True  # whether left and right change alike
    # identify even where no component of the wrench supports it; it becomes a warning
    despite_verdict: bool = False


def identify_inertia(
    model: BodyModel,
    fitted: abc.Sequence[weighing.ForceRecording],
    *,
    held_out: abc.Sequence[weighing.ForceRecording] = (),
    supported: ArrayLike | None = None,
    noise: ArrayLike | None = None,
    settings: IdentificationSettings = IdentificationSettings(),
) -> inertia_parameters.InertialIdentification:
    """Identify the inertia of a model's segments (Futamure et al., eq. 8).

    Parameters
    ----------
    model : BodyModel
        Its inertia is the prior: a table's, or the model's own.
    fitted : sequence of ForceRecording
        Motions of this model with all external loads.
    held_out : sequence of ForceRecording
        Never fitted; they say whether it helped.
    supported : array_like, optional
        (6,) bool: components of the ground wrench (fx, fy, fz, mx, my, mz) whose residual exceeds the
        uncertainty of the measurement, so that it may be blamed on the inertia. Only these are used. A
        planar model has fx, fy, mz. All by default.
    noise : array_like, optional
        (6,), N and N m: standard deviation of the error of each component that inertia is not to blame for.
        Unless given, the most likely size, with ``ARM_M`` between forces and moments.
    settings : IdentificationSettings
        How far tables may be left, and whether mass and symmetry are kept.

    Returns
    -------
    InertialIdentification
        The model with its inertia, and ten numbers for each segment: kg, m, kg m2.

    Raises
    ------
    TrialUnusable
        No component is supported (unless ``despite_verdict``), or no frame has motion and forces.
    InputError
        No recording is given to fit.

    Notes
    -----
    Minimises ``sum |(Y phi - w) / noise|^2 / repeats + |z|^2``, where ``phi = phi_0 + S z`` with the prior's
    spread S, over the eigenvectors of the whitened information that exceed ``DECIDES``, so that
    pseudo-inertias stay positive definite and centres of mass in their boxes. ``repeats`` is how many frames
    say the same thing. Y enters by its normal equations only.

    Examples
    --------
    >>> import scaling_service as ss
    >>> from scaling_service.capabilities.dynamics.inertia.evidence import ForceRecording
    >>> checked = ss.dynamics("plates/subject.json", ss.DynamicsSettings(start="none"))
    >>> fitted = [ForceRecording(trial.dynamics, trial.frames) for trial in checked.trials.values()]
    >>> found = ss.identify_inertia(checked.prepared.model, fitted)
    >>> found.relative_error(held_out=False) <= 1.0
    True
    """
    components, of_components = _choose_components(supported, settings)
    # The model with every tensor that no body can have replaced by the nearest possible one
    inertias = inertia.gather_inertias(model)
    nearest = [find_possible_tensor(tensor) for tensor in inertias.tensor]
    wrong = [name for name, (_, changed) in zip(model.segment_names, nearest, strict=True) if changed]
    repaired: list[str] = []
    if wrong:
        tensors = np.array([tensor for tensor, _ in nearest])
        said = f"no body can have the inertia of {say_names(wrong)}: the nearest possible one was taken"
        model, repaired = inertia.with_inertias(model, dataclasses.replace(inertias, tensor=tensors)), [said]
    if not fitted:
        raise errors.InputError(
            "there is no recording to identify inertia from",
            field="trials.calibration",
            remedy="Name recordings with forces",
        )
    prior = inertia_parameters.make_inertial_prior(
        model, settings.spread, mass_known=settings.mass_known, symmetric=settings.symmetric
    )
    evidence = [weighing.gather_evidence(model, recording) for recording in fitted]
    checks = [weighing.gather_evidence(model, recording) for recording in held_out]
    solution = _solve(model, prior, evidence, components, None if noise is None else np.asarray(noise, float))
    changed = inertia.with_inertias(
        model, motion.Inertias.of_parameters(prior.mean + solution.change.reshape(-1, motion.N_PARAMETERS))
    )
    result = inertia_parameters.InertialIdentification(
        model=changed,
        parameters=inertia_parameters.describe_parameters(model, changed, prior, solution),
        combinations=inertia_parameters.describe_combinations(prior, solution),
        fits=tuple(
            inertia_parameters.WrenchError(
                trial=e.trial,
                held_out=out,
                frames=e.frames,
                before=e.rms(np.zeros_like(solution.change)),
                after=e.rms(solution.change),
            )
            for e, out in [*((e, False) for e in evidence), *((e, True) for e in checks)]
        ),
        components=tuple(components.tolist()),
        noise=np.where(components, solution.noise, np.nan),
    )
    # What a person should know of a result
    notes: list[str] = []
    if not result.combinations:
        hint = "; the total mass was held, too" if settings.mass_known else ""
        notes.append(f"the recordings say less than the prior about every combination: nothing moved{hint}")
    surprises = [
        f"{say_name(p.segment)} {p.quantity}" for p in result.parameters if abs(p.moved) > SURPRISING
    ]
    if surprises:
        notes.append(
            f"{list_few(surprises)} moved by more than {SURPRISING:g} standard deviations of the tables: "
            f"doubt the motion or the forces first"
        )
    ratio = result.relative_error(held_out=True)
    if ratio > WORSE:
        notes.append(
            f"the wrench error of held-out recordings grew by {100 * (ratio - 1):.0f} %: "
            "keep the inertia that it started from"
        )
    return dataclasses.replace(result, warnings=(*of_components, *repaired, *notes))


def _choose_components(
    supported: ArrayLike | None, settings: IdentificationSettings
) -> tuple[NDArray[np.bool_], list[str]]:
    """The components that count, and what is to be said about them."""
    if supported is None:
        return np.ones(weighing.N_COMPONENTS, dtype=bool), []
    components = np.asarray(supported, dtype=bool)
    if components.any():
        return components, []
    said = "the residual is within the uncertainty of the measurement: it says nothing about the inertia"
    if not settings.despite_verdict:
        raise errors.TrialUnusable(
            said,
            field="inertia",
            remedy="Keep the table's inertia, or record a livelier movement with smaller marker errors",
        )
    return np.ones(weighing.N_COMPONENTS, dtype=bool), [f"{said}; it was identified all the same"]


def _solve(
    model: BodyModel,
    prior: inertia_parameters.InertialPrior,
    evidence: abc.Sequence[weighing.WrenchEquations],
    components: NDArray[np.bool_],
    noise_known: Array | None,
) -> inertia_parameters.Solution:
    """The parameters, with the noise that is known or most likely."""
    assumed = noise_known if noise_known is not None else np.repeat([1.0, ARM_M], 3)
    information, slope = weighing.gather(evidence, assumed, components)
    free = prior.scale @ prior.basis
    gains, vectors = np.linalg.eigh(free.T @ information @ free)
    slopes = vectors.T @ (free.T @ slope)
    size = 1.0
    if noise_known is None:
        # Squared errors over their noise, and how many of them are independent
        squares = sum(float((e.squares / (assumed**2 * e.repeats))[components].sum()) for e in evidence)
        count = sum(float((e.frames / e.repeats)[components].sum()) for e in evidence)
        size = weighing.estimate_noise(gains, slopes, squares, count)
    gains, slopes = gains / size**2, slopes / size**2
    kept = np.flatnonzero(gains > DECIDES)[::-1]
    directions = prior.basis @ vectors[:, kept]
    bodies = list_bodies(model)
    moves = minimise_within_cone(
        1.0 + gains[kept], slopes[kept], prior.mean, prior.scale @ directions, bodies
    )
    if moves is None:
        raise errors.TrialUnusable(
            "no possible inertia was found that fits the forces",
            file=evidence[0].trial,
            field="forces",
            remedy="Check the units of the forces and that markers and forces are of one recording",
        )
    return inertia_parameters.Solution(
        change=prior.scale @ directions @ moves,
        directions=directions,
        gains=gains[kept],
        moves=moves,
        noise=size * assumed,
    )
