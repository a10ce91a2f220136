"""Motion of a model of which it is known how well its numbers are known: people as the yardstick.

Markers of one segment err together as far as skin wanders (``reference_models/people.yaml``), and every
deviation holds what the model's own numbers leave open. What a joint's range holds is held here, too.
"""

from __future__ import annotations

from collections import abc
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from scaling_service.capabilities.motion import uncertainty
from scaling_service.capabilities.motion.task import Task
from scaling_service.model import body
from scaling_service.model import people as population
from scaling_service.model.compile import to_piecewise
from scaling_service.model.freed import free_named
from scaling_service.model.places import tell_landmarks
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares import posterior as posteriors
from scaling_service.numerics.least_squares import whitening
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import evaluate_local_positions

_EXPECTED_ANEW = 3  # chosen: times that laws of coordinates are linearised; the third moves 0.01 deg


def pose_problem(
    freed: body.BodyModel,
    trial: Trial,
    people: population.People,
    *,
    prior: whitening.GaussianPrior,
    shares: Array,
    lawful: bool = True,
) -> tuple[whitening.PosteriorProblem, Task]:
    """The markers of some frames; those of one segment err together as far as skin moves.

    ``freed``: a model whose parameters are those of ``prior``. ``shares`` (n_frames,): how much of each frame
    says something of its own. ``lawful``: whether the model or its parameters hold how skin follows the
    joints, so that only what wanders is left.
    """
    task = Task.of(freed, trial)
    places = evaluate_local_positions(task.tree, task.p)[:, :, 0]
    owners = [freed.marker(name).segment for name in task.markers]
    groups, instrument, told = [], people.noise**2, tell_landmarks(freed)
    noise = [freed.marker(name).noise for name in task.markers]
    for segment in dict.fromkeys(owners):
        on = np.array([owner == segment for owner in owners])
        stated = np.array([n is not None for n in noise])
        if (on & stated).any():
            own = np.flatnonzero(on & stated)
            sizes = np.array([noise[k] for k in own], dtype=float)
            groups.append(whitening.ErrorGroup(own, np.diag(np.repeat(np.square(sizes), 3))))
        rows = np.flatnonzero(on & ~stated)
        if not len(rows):
            continue
        names = [task.markers[k] for k in rows]
        share = people.loose_share if lawful else 1.0
        skin = uncertainty.cover_with_skin(freed.bone_of(segment), people, told, names, places[rows], share)
        groups.append(whitening.ErrorGroup(rows, skin + instrument * np.eye(3 * len(rows)), instrument))
    coordinates = np.flatnonzero(task.free)
    ranges = task.ranges
    held = ranges.weight[:, coordinates] > 0.0
    precision = np.where(held, 1.0 / np.square(ranges.spread[coordinates]), 0.0)
    within = (precision[:, :, None] * np.eye(len(coordinates)), precision * ranges.middle[coordinates])
    problem = whitening.PosteriorProblem(
        tree=task.tree,
        measured=task.measured,
        shares=shares,
        coordinates=coordinates,
        groups=tuple(groups),
        prior=prior,
        held=within if held.any() else None,
    )
    return problem, task


def _expect(problem: whitening.PosteriorProblem, task: Task, q: Array) -> whitening.PosteriorProblem:
    """With what the model expects of its coordinates, linear about a motion that is nearly the answer."""
    expectations = task.model.expectations
    if not expectations:
        return problem
    n, names = len(problem.coordinates), list(task.model.coordinate_names)
    column = {names[c]: k for k, c in enumerate(problem.coordinates)}
    precision, pull = problem.held or (np.zeros((len(q), n, n)), np.zeros((len(q), n)))
    for expected in expectations:
        off = q[:, names.index(expected.coordinate)].copy()
        slopes = np.zeros((len(q), n))
        slopes[:, column[expected.coordinate]] = 1.0
        for term in expected.law.terms:
            if term.coordinate is None:
                off -= term.gain
                continue
            x = q[:, names.index(term.coordinate)]
            value, slope = (x, 1.0) if term.shape is None else to_piecewise(term.shape).evaluate(x)
            off -= term.gain * value
            if term.coordinate in column:
                slopes[:, column[term.coordinate]] -= term.gain * slope
        wanted = (slopes * q[:, problem.coordinates]).sum(axis=1) - off
        precision = precision + slopes[:, :, None] * slopes[:, None] / expected.sd**2
        pull = pull + slopes * wanted[:, None] / expected.sd**2
    return replace(problem, held=(precision, pull))


def unpack_covariance(posterior: body.ParameterPosterior, names: tuple[str, ...]) -> Array:
    """Covariance of some of the parameters, in their order, (n, n)."""
    count = len(posterior.names)
    alike = np.zeros((count, count))
    alike[np.tril_indices(count, -1)] = posterior.correlations
    alike += alike.T + np.eye(count)
    sds = np.array(posterior.sds)
    rows = [posterior.names.index(name) for name in names]
    return np.asarray((alike * np.outer(sds, sds))[np.ix_(rows, rows)])


def pack_posterior(model: body.BodyModel, names: abc.Sequence[str], covariance: Array) -> body.BodyModel:
    """The model with how well these of its parameters are known, beside what was known of others before.

    ``covariance`` (n, n). Those of both are taken as independent.
    """
    known = _take_posterior(model)
    before = unpack_covariance(known, known.names)
    whole = block_diag(before, covariance) if known.names else covariance
    sds = np.sqrt(np.diag(whole))
    alike = whole / np.outer(sds, sds)
    told = replace(
        known,
        names=(*known.names, *names),
        sds=tuple(sds.tolist()),
        correlations=tuple(alike[np.tril_indices(len(sds), -1)].tolist()),
    )
    return replace(model, posterior=told)


def holds_skin(model: body.BodyModel) -> bool:
    """Whether a model was estimated with how skin follows its joints, not only how frames are mounted."""
    mounted = {p.name for p in model.parameters if p.group == "mounting"}
    return model.posterior is not None and not mounted.issuperset(model.posterior.names)


def _take_posterior(model: body.BodyModel) -> body.ParameterPosterior:
    return model.posterior or body.ParameterPosterior(names=(), sds=(), correlations=())


def follow_everyday(model: body.BodyModel, trial: Trial, q: Array) -> Array:
    """The likeliest coordinates where skin wanders as people's does, (n_frames, n_coordinates).

    ``model``: one that knows of people. ``q``: by plain least squares.
    """
    prior, ones, lawful = whitening.GaussianPrior(()), np.ones(trial.n_frames), holds_skin(model)
    people = population.read_people().with_skin(_take_posterior(model).skin)
    problem, task = pose_problem(model, trial, people, prior=prior, shares=ones, lawful=lawful)
    for _ in range(_EXPECTED_ANEW if model.expectations else 1):
        q = posteriors.solve_poses(_expect(problem, task, q), q, task.p)
    return q


def estimate_everyday_sd(
    model: body.BodyModel,
    trial: Trial,
    task: Task,
    q: Array,
    known: uncertainty.Mask,
    rates: abc.Callable[[Array], Array] | None = None,
) -> uncertainty.CoordinateSd:
    """Deviations of coordinates from skin that wanders and from all numbers of a model with a posterior.

    ``task``: of the model and the trial. ``q`` (n_frames, n_coordinates): their mean. ``known``: where the
    markers determine a coordinate. ``rates``: see
    :func:`scaling_service.capabilities.motion.uncertainty.estimate_coordinate_sd`.
    """
    posterior = _take_posterior(model)
    open_model = free_named(model, posterior.names)
    names = tuple(p.name for p in open_model.parameters)
    ones = np.ones(trial.n_frames)
    people = population.read_people().with_skin(posterior.skin)
    prior = whitening.GaussianPrior(names)
    lawful = holds_skin(model)
    problem, freed = pose_problem(open_model, trial, people, prior=prior, shares=ones, lawful=lawful)
    problem = _expect(problem, freed, q)
    free = problem.coordinates
    # Skin is seen anew after twice its time of correlation
    alike = max(2.0 * population.read_people().loose_s * trial.rate_hz, 1.0)
    own = unpack_covariance(_take_posterior(model), names)
    covariance, of_mean = posteriors.propagate(problem, q, freed.p, own, known[:, free], alike)
    sd = np.zeros(q.shape)
    sd[:, free] = np.sqrt(np.einsum("nii->ni", covariance))
    sd[~known & task.free] = np.nan
    noise = np.full(len(task.markers), np.nan)
    for group in problem.groups:
        noise[group.markers] = np.sqrt(np.diag(group.covariance).reshape(-1, 3).mean(axis=1))
    noise = noise[[not task.model.marker(name).is_direction for name in task.markers]]
    combined = None
    if rates is not None:
        change = np.concatenate([rates(q[rows]) for rows in posteriors.split_rows(len(q))])
        moved = change[:, :, free]
        combined = np.sqrt(np.einsum("nkf,nfg,nkg->nk", moved, covariance, moved, optimize=True))
        combined = np.where(uncertainty.find_lost(change, ~known & task.free), np.nan, combined)
    lower, upper = task.bounds
    at_end, mean = ((q <= lower) | (q >= upper)) & task.free, np.zeros(q.shape[1])
    mean[free] = of_mean
    return uncertainty.CoordinateSd(sd=sd, noise=noise, at_range_end=at_end, combined=combined, mean=mean)
