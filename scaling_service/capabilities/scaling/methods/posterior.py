"""The joint posterior (MAP): hips, lengths, axes, marker places, skin and motion in one estimate.

What is ordinary in people (:mod:`.people_prior`) is the prior, the standing trial and the movements are the
evidence, and every deviation that is stated is the posterior's. Skin follows the angles of the joints at its
segment's ends, linearly; what is left of it wanders.
"""

from __future__ import annotations

import time
from collections import abc
from dataclasses import dataclass, replace
from functools import partial
from itertools import permutations

import numpy as np

from scaling_service.capabilities.motion.everyday import pose_problem
from scaling_service.capabilities.motion.inverse_kinematics import solve_task
from scaling_service.capabilities.motion.task import Task
from scaling_service.capabilities.scaling.methods import fitting, people_prior
from scaling_service.capabilities.scaling.methods.image_based import ImageBased
from scaling_service.capabilities.scaling.methods.image_points import shows_sizes
from scaling_service.capabilities.scaling.methods.optimised import find_tiltable_knees
from scaling_service.capabilities.scaling.sizes.sizing import expect_dimensions
from scaling_service.capabilities.shared.settings import CalibrationSettings
from scaling_service.core.errors import TrialUnusable
from scaling_service.core.names import say_parameters
from scaling_service.core.text import list_few
from scaling_service.model import body, parameters, results
from scaling_service.model import people as population
from scaling_service.model.anatomy import lengths
from scaling_service.model.freed import free_named
from scaling_service.model.places import tell_landmarks
from scaling_service.model.subject import Session
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares import posterior
from scaling_service.numerics.least_squares.problem import Outcome, find_seen
from scaling_service.numerics.least_squares.whitening import GaussianPrior
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import pose_markers

_LEVELS = 4  # chosen: looks at how much this person's skin moves against ordinary people's
_FIRST_STEPS = 3  # chosen: of all looks but the last; residuals are what they will be long before the end
_LEVEL_FREEDOM = (
    10.0  # chosen: as many residuals speak for ordinary skin; persons differ by a quarter to a half
)
_TAIL = 4.0  # degrees of freedom of Student's t, by which frames are weighed (Lange 1989, JASA 84:881)
_DIGITS = 4  # of correlations that a model keeps
_TELLING = 0.5  # of the prior's variance: below it the recordings have said more than people do


@dataclass(frozen=True, slots=True, eq=False)
class _Frames:
    """Frames of several trials as one recording, and how much of each says something of its own."""

    trial: Trial
    shares: Array
    unlike: Array  # (n_frames,): 1, less for frames that fit unlike the others


@dataclass(frozen=True, slots=True, kw_only=True)
class JointPosterior:
    """Everything is free, with people as the prior."""

    title: str = "hips, lengths, axes, markers, skin and motion in one estimate, people as the yardstick"
    needs: str | None = "MB"
    needs_images: bool = False
    needs_movements: bool = False

    def calibrate(
        self,
        session: Session,
        start: results.Calibration | None,
        settings: CalibrationSettings,
        progress: fitting.Progress | None,
    ) -> results.Calibration:
        """The posterior of the session's person; the start's model is where the iteration begins.

        Raises TrialUnusable: no trial shows a marker of the model.
        """
        assert start is not None
        clock, people = time.perf_counter(), population.read_people()
        images = session.images
        unused: tuple[str, ...] = ()
        if images is not None and shows_sizes(images, start.model):
            start = ImageBased().calibrate(session, start, settings, None)
        elif images is not None:
            unused, images = ("MAP: the images show no length and no part of this model: not used",), None
        imaged = people_prior.find_imaged(start, images)
        names = [m.name for m in start.model.markers if m.weight > 0.0]
        frames = _choose_frames(session, names, settings.n_frames, people)
        q, level, steps = solve_task(Task.of(start.model, frames.trial), frames.trial.times).q, 1.0, 0
        p: Array | None = None
        for left in reversed(range(_LEVELS)):
            own = people.with_skin(level)
            freed, prior = _free(start, frames.trial.shown_labels, session, own, imaged)
            said = frames.shares * frames.unlike
            problem, task = pose_problem(freed, frames.trial, own, prior=prior, shares=said)
            problem = problem.hold_once()
            if p is not None:
                latent = np.flatnonzero([item.group in ("skin", "marker") for item in freed.parameters])
                problem = posterior.integrate_over(problem, q, p, latent)
            begin = task.p if p is None else p
            told = None if progress is None else partial(fitting.count_on, progress, steps)
            found = posterior.solve_posterior(
                problem, q, begin, told, _FIRST_STEPS if left else posterior.MOST_STEPS
            )
            q, p, steps = found.q, found.p, steps + found.steps
            more = np.sqrt((_LEVEL_FREEDOM + found.misfit) / (_LEVEL_FREEDOM + max(found.freedom, 0.0)))
            if left:
                level *= float(more)
                # Weights of frames by Student's t: one that fits unlike the others, as labels exchanged
                # do, says less. `squares` (n_frames,): of residuals by their variances, over their
                # number.
                numbers = 3.0 * find_seen(frames.trial.markers).sum(axis=1)
                usual = float(np.median(found.squares[numbers > 0.0]))
                strange = found.squares / max(usual, np.finfo(float).tiny)
                frames = replace(
                    frames,
                    unlike=np.asarray(np.minimum(1.0, (_TAIL + numbers) / (_TAIL + numbers * strange))),
                )
        values = dict(zip(prior.names, found.p.tolist(), strict=True))
        sds = dict(zip(prior.names, np.sqrt(np.diag(found.covariance)).tolist(), strict=True))
        estimated = tuple(_list_parameters(freed, prior, found, imaged))
        gaps = problem.measured - pose_markers(task.tree, found.q, found.p)
        # The covariance as the model keeps it: sizes as shares of what they became.
        unit = np.array(
            [v if n.startswith("scale.") else 1.0 for n, v in zip(prior.names, found.p, strict=True)]
        )
        spread = np.sqrt(np.diag(found.covariance))
        alike = found.covariance / np.outer(spread, spread)
        # Of segments with one free factor; the shares of evidence are the start's no more.
        return results.Calibration(
            method="MAP",
            model=replace(
                parameters.fold(freed, values),
                posterior=body.ParameterPosterior(
                    names=prior.names,
                    sds=tuple((spread / unit).tolist()),
                    correlations=tuple(alike[np.tril_indices(len(spread), -1)].round(_DIGITS).tolist()),
                    skin=level,
                ),
            ),
            generic=start.generic,
            scale_factors=_list_factors(start, values),
            axis_tilts=_list_tilts(start, values),
            joint_moves=_list_moves(start, values),
            parameters=estimated,
            cost=float(np.nansum(gaps**2)),
            iterations=steps,
            wall_s=time.perf_counter() - clock,
            warnings=(*start.warnings, *unused, *_list_warnings(found, estimated)),
            contradictions=start.contradictions,
            image_poses=start.image_poses,
            sizes=(
                dict(start.sizes)
                | {
                    segment: replace(size, factor=values[name] * size.factor, sd=sds[name] / values[name])
                    for segment, size in start.sizes.items()
                    if (name := f"scale.{segment}") in values
                }
            )
            | _list_pelvis(start, prior, found),
            bone_sized=start.bone_sized,
            centres=_list_centres(freed, sds),
        )


def _choose_frames(
    session: Session, names: abc.Sequence[str], count: int, people: population.People
) -> _Frames:
    """The mean of the standing trial, and frames equally spaced in time over all movements to fit.

    A person who stands shows one posture, however long. Skin that wanders is seen anew after twice its time
    of correlation; frames that are nearer share what they say.
    """
    chosen: list[Array] = []
    shares: list[float] = []
    if session.static is not None:
        standing = session.static.select(names).markers
        shown = find_seen(standing).any(axis=0)
        mean = np.full(standing.shape[1:], np.nan)
        mean[shown] = np.nanmean(standing[:, shown], axis=0)
        chosen.append(mean[None])
        shares.append(1.0)
    total = sum(trial.n_frames for trial in session.calibration)
    for trial in session.calibration:
        measured = trial.select(names).markers
        seen = np.flatnonzero(find_seen(measured).any(axis=1))
        if len(seen):
            most = min(max(1, round(count * trial.n_frames / total)), len(seen))
            rows = seen[np.unique(np.linspace(0, len(seen) - 1, most).round().astype(int))]
            apart = float(np.ptp(trial.times[rows])) / max(len(rows) - 1, 1) or np.inf
            chosen.append(measured[rows])
            shares += [min(1.0, apart / (2.0 * people.loose_s))] * len(rows)
    if not any(find_seen(part).any() for part in chosen):
        raise TrialUnusable(
            "no trial shows a marker of the model",
            field="trials",
            remedy="Give a standing trial or at least one movement with markers of the model",
        )
    together = np.concatenate(chosen)
    clock = np.arange(len(together), dtype=float)  # several trials: their order is all they share
    chosen_trial = Trial(name="MAP", times=clock, labels=tuple(names), markers=together, rate_hz=1.0)
    return _Frames(chosen_trial, np.array(shares), np.ones(len(together)))


def _free(
    start: results.Calibration,
    seen: frozenset[str] | set[str] | abc.Sequence[str],
    session: Session,
    people: population.People,
    imaged: people_prior.Imaged,
) -> tuple[body.BodyModel, GaussianPrior]:
    """The start's model with everything freed, and what is known of each number."""
    model = start.model
    shown = [m for m in model.markers if m.name in seen and m.weight > 0.0]
    bearing = list(dict.fromkeys(m.segment for m in shown))
    # A thigh without a marker still says how far the foot is from the pelvis.
    chains = (lengths.list_chain(model, *ends) for ends in permutations(bearing, 2))
    carrying = list(dict.fromkeys([*bearing, *(segment.name for chain in chains for segment in chain)]))
    pelvis, knees = lengths.find_segment(model, "pelvis", ""), find_tiltable_knees(model)
    femurs = {side: lengths.find_segment(model, "femur", side) for side in "rl"}
    hips = {s: f for s, f in femurs.items() if f in carrying and model.segment(f).parent == pelvis}
    drivers = {segment: _list_drivers(model, segment, people) for segment in bearing}
    freed = free_named(model, list(_list_names(shown, carrying, pelvis, knees, tuple(hips), drivers)))

    prior = GaussianPrior([p.name for p in freed.parameters])
    expected = expect_dimensions(session.subject).condition(people_prior.measure_imaged(imaged, people))
    told = tell_landmarks(model)
    people_prior.expect_sizes(prior, start, carrying, pelvis, expected, imaged, told)
    if pelvis in carrying and hips:
        people_prior.expect_hips(prior, model, pelvis, tuple(hips), people, expected, imaged, told)
    for joint in knees:
        turns = [f"axis.{joint}.x", f"axis.{joint}.y"]
        sd = imaged.deviate_axis(joint, people) if joint in imaged.knees else people.knee_axis_sd
        prior.add_values(turns, np.zeros(2), sd**2 * np.eye(2))
    people_prior.expect_places(prior, shown, people, expected, imaged, told)
    for segment, own in drivers.items():
        markers = [m for m in shown if m.segment == segment]
        places = np.array([m.nominal for m in markers])
        landmarks = [told.get(m.name) for m in markers]
        for driver, reach in own.items():
            slides = [f"skin.{m.name}.{letter}.{driver}" for m in markers for letter in parameters.LETTERS]
            share = 1.0 / (reach * np.sqrt(len(own)))
            covariance = people.skin_covariance(model.bone_of(segment), landmarks, places, share)
            prior.add_values(slides, np.zeros(len(slides)), covariance)
    return freed, prior


def _list_names(
    shown: abc.Sequence[body.Marker],
    carrying: abc.Sequence[str],
    pelvis: str | None,
    knees: abc.Sequence[str],
    hips: abc.Sequence[str],
    drivers: abc.Mapping[str, abc.Mapping[str, float]],
) -> abc.Iterator[str]:
    """The parameters; ``hips``: sides. ``drivers``: segment to the coordinates with which its skin slides."""
    for segment in carrying:
        yield from (f"scale.{segment}.{a}" for a in "xz") if segment == pelvis else (f"scale.{segment}",)
    yield from (f"axis.{joint}.{letter}" for joint in knees for letter in "xy")
    yield from (f"centre.hip_{side}.{letter}" for side in hips for letter in parameters.LETTERS)
    for marker in shown:
        yield from (f"marker.{marker.name}.{letter}" for letter in parameters.LETTERS)
        own = drivers[marker.segment]
        yield from (
            f"skin.{marker.name}.{letter}.{driver}" for letter in parameters.LETTERS for driver in own
        )


def _list_drivers(model: body.BodyModel, segment: str, people: population.People) -> dict[str, float]:
    """The angles that a segment's skin follows, and how far each goes in an ordinary movement, rad.

    They are those of the joints at its ends. Nothing slides because the whole body turns, so the joint to the
    ground is none of them.
    """
    joints = [
        joint
        for item in model.segments
        if item.parent in model.segment_names and segment in (item.name, item.parent)
        for joint in item.joints
        if joint.kind == "rotation"
    ]
    found: dict[str, float] = {}
    for joint in joints:
        x, y, z = map(abs, joint.axis)
        reach = people.reach_mediolateral if z > max(x, y) else people.reach_other
        for coordinate in sorted(joint.law.coordinates):
            found.setdefault(coordinate, reach)
    flexion = {name: reach for name, reach in found.items() if reach == people.reach_mediolateral}
    return flexion if flexion and people.skin(model.bone_of(segment)).flexion_alone else found


def _list_parameters(
    freed: body.BodyModel, prior: GaussianPrior, found: posterior.Posterior, imaged: people_prior.Imaged
) -> abc.Iterator[results.EstimatedParameter]:
    """All but skin, of which there are hundreds. What images tell is determined as what movements do."""
    before = np.sqrt(np.diag(np.linalg.inv(prior.precision)))
    after = np.sqrt(np.diag(found.covariance))
    for k, parameter in enumerate(freed.parameters):
        if parameter.group != "skin":
            yield results.EstimatedParameter(
                name=parameter.name,
                value=float(found.p[k]),
                unit=parameter.unit,
                sd=float(after[k]),
                at_bound=False,
                identifiable=imaged.tells(freed, parameter.name)
                or bool(after[k] ** 2 < _TELLING * before[k] ** 2),
                group=parameter.group,
                target=parameter.target,
            )


def _list_factors(
    start: results.Calibration, values: abc.Mapping[str, float]
) -> dict[str, tuple[float, float, float]]:
    factors = {}
    for segment in start.model.segment_names:
        x, y, z = start.scale_factors.get(segment, (1.0, 1.0, 1.0))
        whole = values.get(f"scale.{segment}", 1.0)
        deep, wide = values.get(f"scale.{segment}.x", whole), values.get(f"scale.{segment}.z", whole)
        factors[segment] = (deep * x, (deep + wide) / 2.0 * y, wide * z)
    return factors


def _list_tilts(
    start: results.Calibration, values: abc.Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    turned = {
        joint: parameters.compose_tilts(
            start.axis_tilts.get(joint, (0.0, 0.0)), (values[f"axis.{joint}.x"], values[f"axis.{joint}.y"])
        )
        for joint in find_tiltable_knees(start.model)
    }
    return {**start.axis_tilts, **turned}


def _list_moves(start: results.Calibration, values: abc.Mapping[str, float]) -> dict[str, results.JointMove]:
    """Hips as far as they moved beyond what sizes do."""
    moved = dict(start.joint_moves)
    for side in "rl":
        femur, hip = lengths.find_segment(start.model, "femur", side), f"centre.hip_{side}"
        if femur is not None and f"{hip}.x" in values:
            shift = body.to_vector(values[f"{hip}.{letter}"] for letter in parameters.LETTERS)
            joint = start.model.segment(femur).joint_name
            before = moved.get(joint, results.JointMove())
            grown = [values.get(f"scale.{start.model.segment(femur).parent}.{a}", 1.0) for a in "xz"]
            along = np.array([grown[0], (grown[0] + grown[1]) / 2.0, grown[1]])
            moved[joint] = replace(before, shift=body.to_vector(along * before.shift + shift))
    return moved


def _list_pelvis(
    start: results.Calibration, prior: GaussianPrior, found: posterior.Posterior
) -> dict[str, results.SegmentSize]:
    """The pelvis as far as the distance of its hips goes: its width and both hips decide it."""
    pelvis, apart = (
        lengths.find_segment(start.model, "pelvis", ""),
        lengths.measure_segment_lengths(start.model),
    )
    weights = {
        f"scale.{pelvis}.z": apart.get("inter_hip", 0.0),
        "centre.hip_r.z": 1.0,
        "centre.hip_l.z": -1.0,
    }
    if pelvis is None or pelvis not in start.sizes or not weights.keys() <= set(prior.names):
        return {}
    row = np.array([weights.get(name, 0.0) for name in prior.names])
    length = apart["inter_hip"] + float(row @ (found.p - [name.startswith("scale.") for name in prior.names]))
    sd, size = float(np.sqrt(row @ found.covariance @ row)), start.sizes[pelvis]
    factor = size.factor * length / apart["inter_hip"]
    return {pelvis: replace(size, factor=factor, sd=sd / length)}


def _list_centres(freed: body.BodyModel, sds: abc.Mapping[str, float]) -> dict[str, results.EstimatedCentre]:
    joints = dict.fromkeys(p.target for p in freed.parameters if p.group == "centre")
    return {
        joint: results.EstimatedCentre(
            "joint posterior", body.to_vector(sds[f"centre.{joint}.{a}"] for a in parameters.LETTERS)
        )
        for joint in joints
    }


def _list_warnings(
    found: posterior.Posterior, estimated: abc.Sequence[results.EstimatedParameter]
) -> abc.Iterator[str]:
    if found.outcome is not Outcome.CONVERGED:
        yield f"MAP: stopped after {found.steps} steps before it converged"
    loose = [p.name for p in estimated if p.group in ("length", "centre", "axis") and not p.identifiable]
    if loose:
        known = list_few(say_parameters(loose))
        yield (
            f"MAP: people's ordinary sizes say more about {known} than these recordings; "
            "the deviations stated count that"
        )
