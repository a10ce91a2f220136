"""From a recording with forces to the problem that dynamically consistent inverse kinematics solves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.consistent.artefact import artefact_m, artefact_shifts
from scaling_service.capabilities.consistent.problem import ConsistentProblem, WrenchTargets
from scaling_service.capabilities.consistent.settings import ConsistentSettings
from scaling_service.capabilities.dynamics.inertia.identification import DECIDES, IdentificationSettings
from scaling_service.capabilities.dynamics.inertia.prior import inertial_prior
from scaling_service.capabilities.dynamics.inverse_dynamics import RatedMotion, rated_motion
from scaling_service.capabilities.dynamics.uncertainty.points import trees_of
from scaling_service.core.errors import TrialUnusable
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import (
    coordinate_bounds,
    default_coordinates,
    free_coordinates,
    parameter_values,
)
from scaling_service.model.forces import SegmentLoads
from scaling_service.model.inertia import inertias_of, mechanism_of, total_mass
from scaling_service.model.results import Motion
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.marker_rates import MarkerTargets
from scaling_service.numerics.multibody.mechanism import N_PARAMETERS, Mechanism
from scaling_service.numerics.signals.splines import ORDER, SplineBasis
from scaling_service.numerics.wrench.ground_wrench import GRAVITY
from scaling_service.numerics.wrench.regressor import regressor_blocks

SPATIAL = (True,) * 6
SAGITTAL = (True, True, False, False, False, True)
"""Components of the ground wrench that a model in space, and a planar one, can follow."""


@dataclass(frozen=True, slots=True, eq=False)
class ConsistentRecording:
    """Markers and forces of one movement."""

    trial: Trial  # labels are the model's marker names; not smoothed
    motion: Motion  # what inverse kinematics made of the markers
    loads: SegmentLoads  # on the feet, at the trial's times, filtered
    supported: NDArray[np.bool_]  # (n,): frames whose forces are all known
    about: Array  # (n, 3), m: the point that moments are taken about
    components: tuple[bool, ...] = SPATIAL  # of the wrench that count: ``SPATIAL`` or ``SAGITTAL``

    @property
    def wrench(self) -> Array:
        """Force on the body (N) and moment about ``about`` (N m), (n, 6); NaN where not known."""
        total = self.loads.total.copy()
        total[:, 3:] -= np.cross(self.about, total[:, :3])
        total[~self.supported] = np.nan
        return total

    @property
    def known(self) -> NDArray[np.bool_]:
        """Frames whose wrench is known, (n,); TrialUnusable where there is none."""
        known = np.asarray(np.isfinite(self.wrench).all(axis=1))
        if not known.any():
            raise TrialUnusable(
                "no frame has all its forces known",
                file=self.name,
                field="forces",
                remedy="Check that every foot on the floor stands on a plate",
            )
        return known

    @property
    def name(self) -> str:
        """The trial's."""
        return self.trial.name

    def part(self, rows: slice, name: str) -> ConsistentRecording:
        """Only these frames, under another name."""
        motion, loads = self.motion, self.loads
        return ConsistentRecording(
            replace(self.trial.frames(rows), name=name),
            replace(
                motion,
                trial=name,
                times=motion.times[rows],
                q=motion.q[rows],
                residuals=motion.residuals[rows],
            ),
            SegmentLoads(loads.times[rows], loads.segments, loads.force[rows], loads.moment[rows]),
            self.supported[rows],
            self.about[rows],
            self.components,
        )


def classical_motion(
    model: BodyModel, recording: ConsistentRecording, settings: ConsistentSettings
) -> RatedMotion:
    """The motion of the classical two steps: inverse kinematics, then filter and derivatives.

    Gaps of a coordinate are bridged by straight lines, one that is never known stands at its default.
    """
    motion = recording.motion
    q = default_coordinates(model, len(motion.times))
    for column, name in enumerate(model.coordinate_names):
        values = motion.q[:, motion.coordinates.index(name)]
        known = np.isfinite(values)
        if known.any():
            q[:, column] = np.interp(motion.times, motion.times[known], values[known])
    return rated_motion(model, motion.times, q, cutoff_hz=settings.cutoff_hz)


def problem_of(
    model: BodyModel,
    recording: ConsistentRecording,
    rated: RatedMotion,
    settings: ConsistentSettings,
    freedom: Array | None = None,
) -> ConsistentProblem:
    """Pose the two objectives for a recording.

    Coordinates that no marker shows stay as the ``rated`` motion has them, and it drives the skin.
    ``freedom`` says how the inertia may differ from the model's; unless given, not at all.
    """
    if len(rated.times) < ORDER * 2:
        raise TrialUnusable(
            f"{len(rated.times)} frames are too few for splines of joint angles",
            file=recording.name,
            remedy="Use a longer recording",
        )
    basis = SplineBasis(rated.times, settings.spacing_s)
    names = recording.motion.markers
    whole, alone = trees_of(model, names, model.segments)
    shown = set(recording.motion.estimated)
    open_ = free_coordinates(model) & np.array([c in shown for c in model.coordinate_names])
    axes = (0, 1, 2) if recording.components == SPATIAL else (0, 1)
    targets, count = _marker_targets(recording, basis, settings)
    return ConsistentProblem(
        Mechanism(whole, inertias_of(model)),
        alone,
        parameter_values(model),
        basis,
        np.flatnonzero(open_),
        rated.q[0],
        targets,
        _wrench_targets(model, recording, settings),
        artefact_shifts(
            model, names, rated.q, basis, artefact_m(model), axes=axes, placed_m=settings.placed_m
        ),
        np.zeros((N_PARAMETERS * len(model.segments), 0)) if freedom is None else freedom,
        1.0 / count,
    )


def inertial_freedom(
    model: BodyModel,
    recordings: Sequence[ConsistentRecording],
    rated: Sequence[RatedMotion],
    settings: ConsistentSettings,
    identification: IdentificationSettings,
) -> Array:
    """The combinations of inertial parameters that the forces say more about than the model's own, the prior.

    Directions (10 n_links, k), each of one standard deviation of the prior.
    """
    prior = inertial_prior(
        model, identification.spread, mass_known=identification.mass_known, symmetric=identification.symmetric
    )
    free = prior.scale @ prior.basis
    information = np.zeros((free.shape[1],) * 2)
    for recording, motion in zip(recordings, rated, strict=True):
        targets = _wrench_targets(model, recording, settings)
        counted = (targets.weights > 0).sum() / repeats(recording, settings)
        for block in regressor_blocks(mechanism_of(model), motion.rates, parameter_values(model)):
            rows = block.ground @ free
            heavy = counted * targets.weights[block.rows]
            information += np.einsum("nck,nc,ncl->kl", rows, heavy, rows, optimize=True)
    gains, vectors = np.linalg.eigh(information)
    return np.asarray(free @ vectors[:, gains > DECIDES])


def limits(model: BodyModel, problem: ConsistentProblem) -> tuple[Array, Array]:
    """Joint limits of the free coordinates, each (m,).

    A spline lies between its smallest and largest coefficient, so limits on coefficients are limits on
    angles.
    """
    lower, upper = coordinate_bounds(model)
    return lower[problem.free], upper[problem.free]


def _marker_targets(
    recording: ConsistentRecording, basis: SplineBasis, settings: ConsistentSettings
) -> tuple[MarkerTargets, float]:
    """Positions as measured, rates of splines through them, and how many errors are new.

    Velocities and accelerations count by the largest of all markers (Futamure et al.: between 0 and 1).
    """
    names = recording.motion.markers
    measured = recording.trial.selected(names).markers
    seen = np.asarray(np.isfinite(measured).all(axis=2))
    n = len(measured)
    splines = basis.evaluate(basis.fit(measured.reshape(n, -1)))
    values = np.stack([part.reshape(measured.shape) for part in splines])
    values[0] = measured
    values = np.where(seen[None, :, :, None], values, 0.0)
    scales = np.array([settings.residual_m, *np.abs(values[1:]).max(axis=(1, 2, 3))])
    dimensions = 3 if recording.components == SPATIAL else 2
    total = dimensions * max(float(seen.sum()), 1.0)
    weights = seen[None] / (np.maximum(scales, np.finfo(float).tiny)[:, None, None] ** 2 * total)
    return MarkerTargets(values, weights), total / repeats(recording, settings)


def repeats(recording: ConsistentRecording, settings: ConsistentSettings) -> float:
    """How many frames say the same thing."""
    step = float(np.median(np.diff(recording.trial.times)))
    return max(1.0, settings.independent_s / step)


def _wrench_targets(
    model: BodyModel, recording: ConsistentRecording, settings: ConsistentSettings
) -> WrenchTargets:
    measured, known = recording.wrench, recording.known
    force = settings.force_share * total_mass(model) * -GRAVITY[1]
    scale = np.array([force] * 3 + [force * settings.arm_m] * 3)
    counted = known[:, None] * np.array(recording.components, dtype=float)
    return WrenchTargets(
        np.where(known[:, None], measured, 0.0), counted / (scale**2 * counted.sum()), recording.about
    )
