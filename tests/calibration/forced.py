"""Bodies of known inertia in motion, with exactly the external wrench that they need."""

from __future__ import annotations

import numpy as np

from scaling_service.capabilities.dynamics.inertia.evidence import ForceRecording
from scaling_service.capabilities.dynamics.inertia.parameters import PriorSpread, make_inertial_prior
from scaling_service.capabilities.kinetics.inverse_dynamics import RatedMotion, compute_dynamics
from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin
from scaling_service.model.forces import SegmentLoads
from scaling_service.model.inertia import compile_mechanism, with_inertias
from scaling_service.numerics.multibody.motion import N_PARAMETERS, Inertias
from scaling_service.numerics.multibody.motion import Motion as Rates
from scaling_service.numerics.wrench import compute_root_wrench

BODY = load_builtin("full_body_35dof")
TIMES = np.arange(600) / 100


def other_person(
    seed: int = 0, size: float = 0.5, *, mass_known: bool = True, symmetric: bool = True
) -> tuple[BodyModel, Array]:
    """The body with inertia drawn from the prior, and the whitened vector of its difference."""
    prior = make_inertial_prior(BODY, PriorSpread(), mass_known=mass_known, symmetric=symmetric)
    z = prior.basis @ np.random.default_rng(seed).normal(0.0, size, prior.basis.shape[1])
    parameters = prior.mean + (prior.scale @ z).reshape(-1, N_PARAMETERS)
    return with_inertias(BODY, Inertias.of_parameters(parameters)), z


def lively(seed: int) -> RatedMotion:
    """All coordinates to and fro, with exact rates."""
    size, pace, phase = np.random.default_rng(seed).uniform(0.1, 0.6, (3, 35)) * [[1], [10], [9]]
    at = np.outer(TIMES, pace) + phase
    return RatedMotion(TIMES, size * np.sin(at), size * pace * np.cos(at), -size * pace**2 * np.sin(at))


def recorded(truth: BodyModel, seed: int, noise: float = 0.0, *, trial: str = "moves") -> ForceRecording:
    """What a person of that inertia shows, as the generic body sees it; white noise on every component."""
    motion = lively(seed)
    wrench, _ = compute_root_wrench(compile_mechanism(truth), motion.rates, np.zeros(0))
    shown = wrench.T + np.random.default_rng(1000 + seed).normal(0.0, 1.0, (len(TIMES), 6)) * noise
    # On the floating root, which the wrench is needed at: whatever bears it, the sum is the same.
    loads = SegmentLoads(TIMES, ("pelvis",), shown[:, None, :3], shown[:, None, 3:])
    return ForceRecording(compute_dynamics(BODY, motion, loads, trial=trial))


def wrench_error(model: BodyModel, recording: ForceRecording) -> Array:
    """RMS residual of a model over a recording, (6,), by inverse dynamics."""
    found = recording.dynamics
    rates = Rates.of_frames(found.motion.q, found.motion.qdot, found.motion.qddot)
    needed, root = compute_root_wrench(compile_mechanism(model), rates, np.zeros(0))
    missing = needed.T - found.external
    missing[:, 3:] -= np.cross(root.T, missing[:, :3])
    return np.sqrt((missing[recording.used] ** 2).mean(axis=0))
