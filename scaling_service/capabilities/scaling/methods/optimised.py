"""Optimisation-based scaling: parameters that make the model follow the calibration movements.

Minimises the cumulative kinematic error over frames equally spaced in time (Puchaud 2019, eq. 1
and 2), either as the paper does, alternating inverse kinematics and parameters, or for motion and
parameters together, which reaches a minimum of both.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

from scaling_service.capabilities.scaling.methods.fitting import STRATEGIES, Fit, Progress
from scaling_service.capabilities.scaling.methods.frames import calibration_frames
from scaling_service.capabilities.scaling.methods.freedom import Freedom, tiltable_knees
from scaling_service.capabilities.scaling.methods.per_axis import fitted_factor
from scaling_service.capabilities.subject.settings import CalibrationSettings
from scaling_service.core.text import few
from scaling_service.model.body import BodyModel
from scaling_service.model.parameters import after, fold
from scaling_service.model.results import Calibration, EstimatedParameter
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares.estimator import Outcome, Solution, Uncertainty, uncertainty
from scaling_service.numerics.least_squares.masks import ever, seen
from scaling_service.numerics.multibody.laws import Array

_DETERMINED = 1e-4  # share of a parameter's direction that may lie where the recording says nothing
_HALF = 0.5  # of the prior's variance: below it the recording has said more than the prior
_UNIFORM = math.sqrt(12.0)  # range over standard deviation of a uniform distribution


def optimise(
    method: str,
    start: Calibration,
    trials: Sequence[Trial],
    freedom: Freedom,
    settings: CalibrationSettings,
    progress: Progress | None = None,
) -> Calibration:
    """Free what the method frees on the start's model, and fit it to the calibration trials.

    Parameters
    ----------
    start : Calibration
        The linear (MB) or image-based (EB) model: the first guess.
    progress : callable, optional
        Called with the step's number and the cumulative kinematic error (m2).

    Raises
    ------
    TrialUnusable
        No calibration trial shows a marker of the model.
    """
    clock = time.perf_counter()
    names = [m.name for m in start.model.markers if m.weight > 0.0]
    frames = calibration_frames(trials, names, settings.n_frames)
    shown = frozenset(n for n, once in zip(names, ever(seen(frames.trial.markers)), strict=True) if once)
    weighted = settings.sizes == "weighted"
    sds = {name: size.sd for name, size in start.sizes.items()} if weighted else {}
    freed = freedom.apply(start.model, shown, settings, sds)
    fitted = STRATEGIES[settings.strategy](Fit.of(start.model, freed, frames, settings), settings, progress)
    fit, solution = fitted.fit, fitted.solution
    doubt = uncertainty(fit.problem, solution, fit.p0, fitted.variance)
    estimated = _parameters(freed, solution.p, doubt)
    values = {p.name: p.value for p in estimated}
    return Calibration(
        method,
        fold(freed, values),
        start.generic,
        _factors(start, values),
        _tilts(start, values),
        estimated,
        fit.error(solution),
        solution.steps,
        time.perf_counter() - clock,
        (*start.warnings, *_warnings(method, estimated, solution, doubt)),
        start.image_poses,
        {} if freedom.lengths else start.sizes,
        start.centres,
    )


def _parameters(freed: BodyModel, p: Array, doubt: Uncertainty) -> tuple[EstimatedParameter, ...]:
    found = []
    for k, parameter in enumerate(freed.parameters):
        at_bound = bool(doubt.at_bound[k])
        spread = parameter.prior_sd or (parameter.upper - parameter.lower) / _UNIFORM
        telling = at_bound or doubt.sd[k] ** 2 < _HALF * spread**2
        known = bool(telling and doubt.undetermined[k] <= _DETERMINED)
        found.append(
            EstimatedParameter(
                parameter.name,
                float(p[k]),
                parameter.unit,
                float(doubt.sd[k]),
                at_bound,
                known,
                parameter.group,
                parameter.target,
            )
        )
    return tuple(found)


def _factors(start: Calibration, values: dict[str, float]) -> dict[str, tuple[float, float, float]]:
    factors = {}
    for segment in start.model.segment_names:
        x, y, z = start.scale_factors.get(segment, (1.0, 1.0, 1.0))
        kx, ky, kz = fitted_factor(values, segment)
        factors[segment] = (kx * x, ky * y, kz * z)
    return factors


def _tilts(start: Calibration, values: dict[str, float]) -> dict[str, tuple[float, float]]:
    fitted = {
        joint: (values.get(f"axis.{joint}.x", 0.0), values.get(f"axis.{joint}.y", 0.0))
        for joint in tiltable_knees(start.model)
    }
    turned = {joint: after(start.axis_tilts.get(joint, (0.0, 0.0)), tilt) for joint, tilt in fitted.items()}
    return {**start.axis_tilts, **turned}


def _warnings(
    method: str, estimated: Sequence[EstimatedParameter], solution: Solution, doubt: Uncertainty
) -> tuple[str, ...]:
    found = []
    if solution.outcome is not Outcome.CONVERGED:
        found.append(f"{method}: stopped after {solution.steps} steps before it converged")
    bound = [p.name for p in estimated if p.at_bound]
    loose = [p.name for p in estimated if not p.identifiable]
    if bound:
        found.append(
            f"{method}: {len(bound)} of {len(estimated)} parameters stopped at their bounds: {few(bound)}"
        )
    if doubt.free_directions:
        found.append(
            f"{method}: {doubt.free_directions} combinations of parameters are not determined by these "
            f"recordings; the first guess decides them, so these mean little alone: {few(loose)}"
        )
    return tuple(found)
