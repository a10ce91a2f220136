"""Motion, geometry and inertia that markers and ground forces agree on (Futamure et al., fig. 2)."""

from __future__ import annotations

import dataclasses
from collections import abc

import numpy as np

from scaling_service.capabilities.consistent import geometric, motion
from scaling_service.capabilities.consistent import problem as problems
from scaling_service.capabilities.consistent import recording as consistent_recording
from scaling_service.capabilities.dynamics.inertia import identification as identifications
from scaling_service.capabilities.dynamics.inertia.evidence import ForceRecording
from scaling_service.capabilities.dynamics.inertia.parameters import InertialIdentification
from scaling_service.capabilities.kinetics import inverse_dynamics
from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.core.arrays import Array
from scaling_service.core.progress import show_nothing
from scaling_service.model import inertia
from scaling_service.model.body import BodyModel
from scaling_service.numerics.signals import splines

Progress = abc.Callable[[str], None]

FREE_MASS = identifications.IdentificationSettings(mass_known=False)
"""The plates tell the mass."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrackedRecording:
    """One recording tracked by one model."""

    rated: inverse_dynamics.RatedMotion
    marker_rms_m: float  # root mean square distance of measured and model markers
    wrench_rmse: Array  # (6,), N and N m: of measured minus model, over frames with known forces
    gaps: problems.Objectives
    weight: float = float("nan")  # of the wrench in the balance; NaN where markers alone were tracked


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ConsistentResult:
    """What the loop found."""

    # start, model: before and after
    start: BodyModel
    model: BodyModel
    # classical, consistent: every recording, in the order given: fitted ones, then held-out ones.
    # ``classical``: inverse kinematics, filter and derivatives with the start's model.
    classical: tuple[TrackedRecording, ...]
    consistent: tuple[TrackedRecording, ...]
    # the classical two steps with the model found: forces played no part in these motions
    predicted: tuple[TrackedRecording, ...]
    inertial: InertialIdentification  # the last one
    factors: abc.Mapping[str, float]  # segment to its length over that of the start
    outer_iterations: int
    converged: bool
    # marker RMS (m) and wrench RMSE (6,) over the fitted recordings after every loop
    history: tuple[tuple[float, Array], ...]

    @property
    def ways(self) -> dict[str, tuple[TrackedRecording, ...]]:
        """The three ways in which every recording is explained."""
        return {"classical": self.classical, "consistent": self.consistent, "predicted": self.predicted}


def estimate_consistent(
    model: BodyModel,
    fitted: abc.Sequence[consistent_recording.ConsistentRecording],
    held_out: abc.Sequence[consistent_recording.ConsistentRecording] = (),
    settings: problems.ConsistentSettings = problems.ConsistentSettings(),
    *,
    progress: Progress | None = None,
) -> ConsistentResult:
    """Find motion, geometry and inertia in turn, until errors change by less than instruments resolve.

    The model is scaled and has a table's inertia; recordings hold the motions that inverse kinematics finds
    with it. Progress is called with what is being done.

    Beyond the paper, the motion is found together with what is uncertain about the inertia and with the
    artefact that follows the joints. Found for the table's inertia, as in the paper, the motion bends until
    it explains the forces, and hides what is wrong with that inertia.
    """
    say = progress or show_nothing
    recordings = (*fitted, *held_out)
    rated = [consistent_recording.estimate_classical_motion(model, r, settings) for r in recordings]
    classical = tuple(
        _measure_unchanged(model, r, m, settings) for r, m in zip(recordings, rated, strict=True)
    )
    now, factors = model, dict[str, float]()
    history: list[tuple[float, Array]] = []
    moved: list[motion.ConsistentMotion] = []
    converged = False
    while not converged and len(history) < settings.most_loops:
        loop = f"loop {len(history) + 1}"
        say(f"{loop}: motion")
        table = inertia.with_inertias(now, inertia.gather_inertias(model))
        freedom = consistent_recording.find_inertial_freedom(
            table, fitted, rated[: len(fitted)], settings, FREE_MASS
        )
        earlier: list[motion.ConsistentMotion | None] = [*moved] or [None] * len(fitted)
        moved = [
            _balance(table, r, m, settings, freedom, b)
            for r, m, b in zip(fitted, rated, earlier, strict=False)
        ]
        rated[: len(fitted)] = [m.rated for m in moved]
        say(f"{loop}: geometry")
        # From the start each time, so that bounds and prior stay about it; the artefact found is taken
        # off.
        names = fitted[0].motion.markers
        recorded = [
            geometric.KnownMotion(r.name, r.trial.select(names).markers - m.glide, m.rated.q)
            for r, m in zip(fitted, moved, strict=True)
        ]
        placed, factors = geometric.identify_geometry(
            model,
            names,
            recorded,
            consistent_recording.expect_artefacts(model),
            bound=settings.geometry_bound,
            axes="xyz" if fitted[0].components == consistent_recording.SPATIAL else "xy",
            prior=settings.geometry_prior,
            independent=sum(
                len(r.trial.times) / consistent_recording.count_repeats(r, settings) for r in fitted
            ),
        )
        say(f"{loop}: inertia")
        prior = inertia.with_inertias(placed, inertia.gather_inertias(model))
        forces = [
            ForceRecording(inverse_dynamics.compute_dynamics(prior, m, r.loads, trial=r.name), r.supported)
            for r, m in zip(fitted, rated, strict=False)
        ]
        inertial = identifications.identify_inertia(
            prior, forces, supported=fitted[0].components, settings=FREE_MASS
        )
        now = inertial.model
        tracked = [_measure_errors(r, m.rated, m.objectives) for r, m in zip(fitted, moved, strict=True)]
        # RMS errors of markers and wrench over recordings, each counting alike
        markers = np.sqrt(np.mean([t.marker_rms_m**2 for t in tracked]))
        history.append((float(markers), np.sqrt(np.mean([t.wrench_rmse**2 for t in tracked], axis=0))))
        if len(history) > 1:
            resolution = np.array([settings.force_resolution_n] * 3 + [settings.moment_resolution_nm] * 3)
            (markers_before, wrench_before), (markers_now, wrench_now) = history[-2:]
            settled = abs(markers_now - markers_before) < settings.marker_resolution_m
            converged = bool(settled and (np.abs(wrench_now - wrench_before) < resolution).all())
    say("following the recordings with the model found")
    known: list[motion.ConsistentMotion | None] = [*moved, *[None] * len(held_out)]
    final = [_balance(now, r, m, settings, None, b) for r, m, b in zip(recordings, rated, known, strict=True)]
    # The classical two steps once more: markers alone are followed, then differentiated
    followed = [dataclasses.replace(r, motion=inverse_kinematics(now, r.trial)) for r in recordings]
    anew = [consistent_recording.estimate_classical_motion(now, r, settings) for r in followed]
    return ConsistentResult(
        start=model,
        model=now,
        classical=classical,
        consistent=tuple(
            _measure_errors(r, m.rated, m.objectives, m.weight)
            for r, m in zip(recordings, final, strict=True)
        ),
        predicted=tuple(_measure_unchanged(now, r, m, settings) for r, m in zip(followed, anew, strict=True)),
        inertial=inertial,
        factors=factors,
        outer_iterations=len(history),
        converged=converged,
        history=tuple(history),
    )


def _balance(
    model: BodyModel,
    recording: consistent_recording.ConsistentRecording,
    rated: inverse_dynamics.RatedMotion,
    settings: problems.ConsistentSettings,
    freedom: Array | None,
    before: motion.ConsistentMotion | None,
) -> motion.ConsistentMotion:
    """The motion balanced anew; the artefact found before is where its search begins."""
    problem = consistent_recording.pose_problem(model, recording, rated, settings, freedom)
    shared, count = np.zeros(problem.n_shared), problem.shifts.count
    if before is not None:
        shared[:count] = before.state.shared[:count]
    start = splines.Unknowns(problem.basis.fit(rated.q[:, problem.free]), shared)
    return motion.solve_consistent_motion(
        problem,
        start,
        consistent_recording.gather_limits(model, problem),
        1.0 if before is None else before.weight,
    )


def _measure_unchanged(
    model: BodyModel,
    recording: consistent_recording.ConsistentRecording,
    rated: inverse_dynamics.RatedMotion,
    settings: problems.ConsistentSettings,
) -> TrackedRecording:
    """How far a motion is from what was measured, without changing it."""
    problem = consistent_recording.pose_problem(model, recording, rated, settings)
    return _measure_errors(recording, rated, problem.objectives_of(rated.rates))


def _measure_errors(
    recording: consistent_recording.ConsistentRecording,
    rated: inverse_dynamics.RatedMotion,
    gaps: problems.Objectives,
    weight: float = float("nan"),
) -> TrackedRecording:
    seen = np.isfinite(recording.trial.select(recording.motion.markers).markers).all(axis=2)
    marker = float(np.sqrt((gaps.marker_gaps[seen] ** 2).sum(axis=1).mean()))
    wrench = np.sqrt((gaps.wrench_gaps[recording.known] ** 2).mean(axis=0))
    return TrackedRecording(rated=rated, marker_rms_m=marker, wrench_rmse=wrench, gaps=gaps, weight=weight)
