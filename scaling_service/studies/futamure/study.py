"""The study of Futamure et al. on virtual squatters, whose angles, lengths and inertia are known."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from scaling_service.capabilities.consistent.estimate import TrackedRecording, consistent
from scaling_service.capabilities.consistent.planar import (
    SagittalPlane,
    in_plane,
    loads_in_plane,
    plane_of,
    scale_squat,
)
from scaling_service.capabilities.consistent.problem import ConsistentSettings
from scaling_service.capabilities.consistent.recording import SAGITTAL, ConsistentRecording
from scaling_service.capabilities.dynamics.inverse_dynamics import ORDER
from scaling_service.capabilities.dynamics.settings import CUTOFF_HZ
from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.model.anatomy.inertia_planar import SQUAT, apply_to_squat
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import builtin
from scaling_service.model.forces import SegmentLoads
from scaling_service.model.inertia import inertias_of
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.signals.filters import butterworth
from scaling_service.numerics.wrench.ground_wrench import GRAVITY
from scaling_service.studies.futamure.squatters import (
    COM_SD,
    MASS_SD,
    RADIUS_SD,
    RATE_HZ,
    Squats,
    VirtualSquatter,
    virtual_squatter,
)

SOURCE = (
    "Futamure S., Bonnet V., Dumas R., Kulić D., Venture G.: Dynamically consistent inverse kinematics "
    "framework "
    "using optimizations for human motion analysis"
)

TABLE = "winter2009"
"""What everybody's inertia is taken to be at first."""

PLACED_M = 0.007
"""As the virtual persons' markers are placed."""

SAGITTAL_ROWS = (0, 1, 5)
"""fx, fy, mz of the six components."""

DIFFERENCES = (
    "The persons are virtual: lengths, inertia, markers' places and skin movement are drawn from the "
    "literature's scatter, and the analysis starts from another inertial table than they are drawn about.",
    "The classical two steps: the planar model scaled by its standing, all markers put where the standing "
    "person shows them, Winter's inertia with the mass that the plate bears, inverse kinematics with equal "
    f"weights, a zero-phase Butterworth filter of order {ORDER} at {CUTOFF_HZ:g} Hz on angles and forces, "
    "derivatives of a quintic spline. The paper names no filter.",
    "Beyond the paper: the artefact that follows the joints, and what is uncertain about the inertia, are "
    "found together with the motion, and geometry is held by a prior beside the paper's bounds. The paper's "
    "own loop, which has neither, is not done here.",
    "The paper's text gives 12 N, 12 N and 14 N m for the classical method in one person, its table 7, 8, 8.",
)
"""How this study is not the paper's, in plain English."""


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """One way of explaining one recording."""

    wrench: Array  # (3,), N, N, N m: RMS error of fx, fy, mz
    markers_m: float
    angles: Array  # (4,), rad: RMS error of ankle, knee, hip and shoulder against the truth


@dataclass(frozen=True, slots=True, eq=False)
class SquatterStudied:
    """One person."""

    name: str
    fitted: tuple[Way, Way, Way]
    held_out: tuple[Way, Way, Way]
    """``fitted``, ``held_out``: (classical, consistent, predicted)."""
    inertia: Array
    """(2, 3): RMS distance from the truth of masses, centres of mass and moments of inertia, in standard
    deviations of the tables, before and after; the foot, which does not move, left out."""
    lengths: Array  # (2, 3), m: errors of shank, thigh and trunk, before and after
    marker_rms: dict[str, tuple[float, float]]  # mapping of marker to (classical, consistent), m
    loops: int
    converged: bool
    seconds: float  # of the loop, for 13 s at 100 Hz, with the held-out recording


def study_squatter(seed: int, *, faults: float = 1.0) -> SquatterStudied:
    """Record one person, explain the recordings, and compare with the truth.

    ``faults``: see :func:`virtual_squatter`.
    """
    person = virtual_squatter(seed, faults=faults)
    plane = plane_of(person.fitted.trial)
    model = start_model(person, plane)
    fitted, held_out = (recording_of(model, squats, plane) for squats in (person.fitted, person.held_out))
    clock = time.perf_counter()
    found = consistent(model, [fitted], [held_out], ConsistentSettings(placed_m=PLACED_M))
    seconds = time.perf_counter() - clock
    ways = [
        tuple(_way(followed[k], squats) for followed in (found.classical, found.consistent, found.predicted))
        for k, squats in enumerate((person.fitted, person.held_out))
    ]
    rms = [
        np.sqrt((f.gaps.marker_gaps**2).sum(axis=2).mean(axis=0))
        for f in (found.classical[0], found.consistent[0])
    ]
    return SquatterStudied(
        person.name,
        (ways[0][0], ways[0][1], ways[0][2]),
        (ways[1][0], ways[1][1], ways[1][2]),
        np.stack([inertia_distance(m, person.model) for m in (model, found.model)]),
        np.stack([lengths_of(m) - lengths_of(person.model) for m in (model, found.model)]),
        {n: (float(a), float(b)) for n, a, b in zip(fitted.motion.markers, *rms, strict=True)},
        found.outer_iterations,
        found.converged,
        seconds,
    )


def start_model(person: VirtualSquatter, plane: SagittalPlane) -> BodyModel:
    """What a laboratory would start from: it knows the recording, the stature and what the plate bears."""
    sized = scale_squat(builtin(SQUAT), in_plane(person.fitted.trial, plane))
    borne = float(person.fitted.loads.total[:, 1].mean() / -GRAVITY[1])
    return apply_to_squat(sized, TABLE, sex="M", height_m=person.height_m, mass_kg=borne).model


def recording_of(model: BodyModel, squats: Squats, plane: SagittalPlane) -> ConsistentRecording:
    """Markers and filtered forces in the plane, and what inverse kinematics makes of the markers."""
    trial = in_plane(squats.trial, plane)
    count = len(trial.times)
    return ConsistentRecording(
        trial,
        inverse_kinematics(model, trial),
        _filtered(loads_in_plane(squats.loads, plane)),
        np.ones(count, dtype=bool),
        np.zeros((count, 3)),
        SAGITTAL,
    )


def _filtered(loads: SegmentLoads) -> SegmentLoads:
    def smooth(values: Array) -> Array:
        flat = values.reshape(len(values), -1)
        return butterworth(flat, rate_hz=RATE_HZ, cutoff_hz=CUTOFF_HZ, order=ORDER).values.reshape(
            values.shape
        )

    return replace(loads, force=smooth(loads.force), moment=smooth(loads.moment))


def _way(tracked: TrackedRecording, squats: Squats) -> Way:
    angles = np.sqrt(((tracked.rated.q - squats.truth.q) ** 2).mean(axis=0))
    return Way(tracked.wrench_rmse[list(SAGITTAL_ROWS)], tracked.marker_rms_m, angles)


def inertia_distance(model: BodyModel, truth: BodyModel) -> Array:
    """RMS distance of masses, centres of mass and moments of inertia from the truth, (3,), in tables' SDs."""
    ours, true = inertias_of(model), inertias_of(truth)
    moving = slice(1, None)
    gyration = np.sqrt(true.tensor[:, 2, 2] / true.mass)
    parts = (
        (ours.mass / true.mass - 1.0) / MASS_SD,
        (ours.com - true.com)[:, :2] / (COM_SD * gyration[:, None]),
        (ours.tensor[:, 2, 2] / true.tensor[:, 2, 2] - 1.0) / (2.0 * RADIUS_SD),
    )
    return np.array([np.sqrt(np.mean(part[moving] ** 2)) for part in parts])


def lengths_of(model: BodyModel) -> Array:
    """Shank, thigh, trunk, (3,), m: how far each joint lies from the one before."""
    return np.array(
        [
            sum(j.law.constant_part for j in model.segment(child).joints if j.kind == "translation")
            for child in ("thigh", "torso", "arm")
        ]
    )
