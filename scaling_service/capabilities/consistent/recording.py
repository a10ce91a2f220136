"""From a recording with forces to the problem that dynamically consistent inverse kinematics solves.

A marker's displacement in its segment follows the angles of the joints at the segment's ends (Camomilla et
al. 2013, Bonci et al. 2014). It says the same in every repetition, so it does not average out: it is
estimated with the motion, with the artefact that literature expects as its prior.
"""

from __future__ import annotations

import dataclasses
from collections import abc

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.consistent import problem as problems
from scaling_service.capabilities.dynamics.inertia import identification as identifications
from scaling_service.capabilities.dynamics.inertia.parameters import make_inertial_prior
from scaling_service.capabilities.dynamics.uncertainty.reference import make_trees
from scaling_service.capabilities.kinetics import inverse_dynamics
from scaling_service.core.arrays import Array
from scaling_service.core.errors import TrialUnusable
from scaling_service.model import body, inertia
from scaling_service.model import compile as compiling
from scaling_service.model.anatomy.markers import find_canonical
from scaling_service.model.forces import SegmentLoads
from scaling_service.model.results import Motion
from scaling_service.model.trial import Trial
from scaling_service.numerics import wrench as wrenches
from scaling_service.numerics.multibody import marker_rates
from scaling_service.numerics.multibody import motion as motions
from scaling_service.numerics.signals.splines import ORDER, SplineBasis

ARTEFACT_M: abc.Mapping[str, float] = {
    "toe": 0.001,
    "ankle": 0.010,
    "shank": 0.015,
    "knee": 0.030,
    "pelvis": 0.017,
    "T10": 0.0107,
    "sternum": 0.015,
    "acromion": 0.010,
}
"""Futamure et al., table 1, m."""

_OF_MARKERS: abc.Mapping[str, str] = {
    name: row
    for row, names in {
        "toe": "TOE",
        "ankle": "ANK RLM RMM",
        "knee": "KNE RLFE RMFE",
        "T10": "C7 T10",
        "sternum": "CLAV STRN RSC",
        "acromion": "SHO RSHO",
    }.items()
    for name in names.split()
}
"""Rows for markers by name. C7 and CLAV are not in the table: chosen as the nearest site."""

_OF_SEGMENTS: abc.Mapping[str, tuple[str, ...]] = {
    "pelvis": ("pelvis",),
    "knee": ("femur", "thigh"),
    "shank": ("tibia", "shank"),
    "ankle": ("talus", "calcn", "foot", "toes"),
    "acromion": ("head", "humerus", "ulna", "radius", "hand", "arm"),
}
"""Rows for all other markers, by how their segment's name begins. Chosen: thighs as the knee, the largest;
feet as the ankle (the table's toe is that of a foot that cannot move), head and arms as the acromion."""

_ELSE = "sternum"
"""Any other segment is a part of the trunk."""

FULL_RAD = np.radians(45.0)
"""Range of the angles from which on the whole artefact is expected (chosen: that of table 1 is of large
movements; below, it grows with the angle)."""

SPATIAL = (True,) * 6
SAGITTAL = (True, True, False, False, False, True)
"""Components of the ground wrench that a model in space, and a planar one, can follow."""


def expect_artefacts(model: body.BodyModel) -> dict[str, float]:
    """The expected error of every marker of a model, m."""
    rooted = [segment for segment in model.segments if segment.parent == body.GROUND]
    still = {segment.name for segment in rooted if not any(j.law.coordinates for j in segment.joints)}
    found = {}
    for marker in model.markers:
        # The landmark's name on the right-hand side.
        known = find_canonical(marker.name) or marker.name
        mirrored = f"R{known[1:]}"
        row = _OF_MARKERS.get(mirrored if known.startswith("L") and mirrored in _OF_MARKERS else known)
        if row is None or (row == "toe" and marker.segment not in still):
            row = next((r for r, starts in _OF_SEGMENTS.items() if marker.segment.startswith(starts)), _ELSE)
        found[marker.name] = ARTEFACT_M[row]
    return found


def _find_driver(model: body.BodyModel, segment: body.Segment, q: Array) -> Array | None:
    """First principal component of the angles at a segment's ends, of range one or less, (n,)."""
    joints = [
        *(segment.joints if segment.parent != body.GROUND else ()),
        *(j for c in model.children(segment.name) for j in c.joints),
    ]
    names = {c for joint in joints if joint.kind == "rotation" for c in joint.law.coordinates}
    rows = [k for k, c in enumerate(model.coordinates) if c.name in names and c.kind == "rotation"]
    angles = q[:, rows] - q[:, rows].mean(axis=0)
    if not rows or not np.ptp(angles, axis=0).max() > 0:
        return None
    score = angles @ np.linalg.svd(angles, full_matrices=False)[2][0]
    return np.asarray(score / max(float(np.ptp(score)), FULL_RAD))


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
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
        return dataclasses.replace(
            self,
            trial=dataclasses.replace(self.trial.frames(rows), name=name),
            motion=dataclasses.replace(
                motion,
                trial=name,
                times=motion.times[rows],
                q=motion.q[rows],
                residuals=motion.residuals[rows],
            ),
            loads=SegmentLoads(loads.times[rows], loads.segments, loads.force[rows], loads.moment[rows]),
            supported=self.supported[rows],
            about=self.about[rows],
        )


def estimate_classical_motion(
    model: body.BodyModel, recording: ConsistentRecording, settings: problems.ConsistentSettings
) -> inverse_dynamics.RatedMotion:
    """The motion of the classical two steps: inverse kinematics, then filter and derivatives.

    Gaps of a coordinate are bridged by straight lines, one that is never known stands at its default.
    """
    motion = recording.motion
    q = compiling.repeat_default_pose(model, len(motion.times))
    for column, name in enumerate(model.coordinate_names):
        values = motion.q[:, motion.coordinates.index(name)]
        known = np.isfinite(values)
        if known.any():
            q[:, column] = np.interp(motion.times, motion.times[known], values[known])
    return inverse_dynamics.differentiate_motion(model, motion.times, q, cutoff_hz=settings.cutoff_hz)


def pose_problem(
    model: body.BodyModel,
    recording: ConsistentRecording,
    rated: inverse_dynamics.RatedMotion,
    settings: problems.ConsistentSettings,
    freedom: Array | None = None,
) -> problems.ConsistentProblem:
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
    whole, alone = make_trees(model, names, model.segments)
    shown = set(recording.motion.estimated)
    open_ = compiling.free_coordinates(model) & np.array([c in shown for c in model.coordinate_names])
    axes = (0, 1, 2) if recording.components == SPATIAL else (0, 1)
    # Positions as measured, rates of splines through them, and how many errors are new. Velocities and
    # accelerations count by the largest of all markers (Futamure et al.: between 0 and 1).
    measured = recording.trial.select(names).markers
    seen = np.asarray(np.isfinite(measured).all(axis=2))
    n = len(measured)
    splines = basis.evaluate(basis.fit(measured.reshape(n, -1)))
    values = np.stack([part.reshape(measured.shape) for part in splines])
    values[0] = measured
    values = np.where(seen[None, :, :, None], values, 0.0)
    scales = np.array([settings.residual_m, *np.abs(values[1:]).max(axis=(1, 2, 3))])
    total = len(axes) * max(float(seen.sum()), 1.0)
    weights = seen[None] / (np.maximum(scales, np.finfo(float).tiny)[:, None, None] ** 2 * total)
    targets, count = marker_rates.MarkerTargets(values, weights), total / count_repeats(recording, settings)
    # Shared shifts of all markers: one that follows the joints at the segment's ends, and a constant one.
    expected_m = expect_artefacts(model)
    driven = {s.name: _find_driver(model, s, rated.q) for s in model.segments}
    moving = {name: k for k, name in enumerate(n for n, way in driven.items() if way is not None)}
    rows: list[tuple[int, int, int, float]] = []
    for k, name in enumerate(names):
        signal, expected = moving.get(model.marker(name).segment), expected_m[name]
        if signal is not None:
            rows += [(k, axis, 1 + signal, expected) for axis in axes]
            rows += [
                (k, axis, 0, min(settings.placed_m, expected)) for axis in axes if settings.placed_m > 0.0
            ]
    columns = np.stack([np.ones(len(rated.q)), *(way for way in driven.values() if way is not None)], axis=1)
    signals = np.stack(basis.evaluate(basis.fit(columns)))
    table = np.array(rows, dtype=float).reshape(-1, 4)
    marker, axis, which = (table[:, i].astype(np.intp) for i in range(3))
    return problems.ConsistentProblem(
        mechanism=motions.Mechanism(whole, inertia.gather_inertias(model)),
        tree=alone,
        p=compiling.list_parameter_values(model),
        basis=basis,
        free=np.flatnonzero(open_),
        constant=rated.q[0],
        markers=targets,
        wrench=_make_wrench_targets(model, recording, settings),
        shifts=marker_rates.MarkerShifts(
            marker=marker, axis=axis, signal=which, sd=table[:, 3], signals=signals
        ),
        inertia=np.zeros((motions.N_PARAMETERS * len(model.segments), 0)) if freedom is None else freedom,
        prior=1.0 / count,
    )


def find_inertial_freedom(
    model: body.BodyModel,
    recordings: abc.Sequence[ConsistentRecording],
    rated: abc.Sequence[inverse_dynamics.RatedMotion],
    settings: problems.ConsistentSettings,
    identification: identifications.IdentificationSettings,
) -> Array:
    """The combinations of inertial parameters that the forces say more about than the model's own, the prior.

    Directions (10 n_links, k), each of one standard deviation of the prior.
    """
    prior = make_inertial_prior(
        model, identification.spread, mass_known=identification.mass_known, symmetric=identification.symmetric
    )
    free = prior.scale @ prior.basis
    information = np.zeros((free.shape[1],) * 2)
    for recording, motion in zip(recordings, rated, strict=True):
        targets = _make_wrench_targets(model, recording, settings)
        counted = (targets.weights > 0).sum() / count_repeats(recording, settings)
        for rows, regressor in wrenches.compute_regressor_blocks(
            inertia.compile_mechanism(model), motion.rates, compiling.list_parameter_values(model)
        ):
            by = regressor @ free
            heavy = counted * targets.weights[rows]
            information += np.einsum("nck,nc,ncl->kl", by, heavy, by, optimize=True)
    gains, vectors = np.linalg.eigh(information)
    return np.asarray(free @ vectors[:, gains > identifications.DECIDES])


def gather_limits(model: body.BodyModel, problem: problems.ConsistentProblem) -> tuple[Array, Array]:
    """Joint limits of the free coordinates, each (m,).

    A spline lies between its smallest and largest coefficient, so limits on coefficients are limits on
    angles.
    """
    lower, upper = compiling.list_coordinate_bounds(model)
    return lower[problem.free], upper[problem.free]


def count_repeats(recording: ConsistentRecording, settings: problems.ConsistentSettings) -> float:
    """How many frames say the same thing."""
    step = float(np.median(np.diff(recording.trial.times)))
    return max(1.0, settings.independent_s / step)


def _make_wrench_targets(
    model: body.BodyModel, recording: ConsistentRecording, settings: problems.ConsistentSettings
) -> problems.WrenchTargets:
    measured, known = recording.wrench, recording.known
    force = settings.force_share * inertia.sum_mass(model) * -wrenches.GRAVITY[1]
    scale = np.array([force] * 3 + [force * settings.arm_m] * 3)
    counted = known[:, None] * np.array(recording.components, dtype=float)
    return problems.WrenchTargets(
        np.where(known[:, None], measured, 0.0), counted / (scale**2 * counted.sum()), recording.about
    )
