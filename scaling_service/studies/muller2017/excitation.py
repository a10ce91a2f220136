"""Virtual persons on two force plates who move every joint, with true inertia, motion and forces.

Their true inertia is that of a regression, off by what regressions miss. What is recorded has skin that
glides with the joint angles, marker noise and plate noise; the model that follows it has the lengths and
marker places that a calibration leaves, and the regression's inertia.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from scaling_service.capabilities.dynamics.uncertainty.reference import Recording
from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.core.streams import stream
from scaling_service.model.anatomy.inertia import apply_inertia_table, find_possible_tensor
from scaling_service.model.body import BodyModel, Marker, to_vector
from scaling_service.model.builtin import load_builtin, load_generic_person
from scaling_service.model.compile import compile_model, list_parameter_values
from scaling_service.model.forces import SegmentLoads
from scaling_service.model.inertia import compile_mechanism, gather_inertias, with_inertias
from scaling_service.model.scaling import scale_model
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.mechanism import Inertias
from scaling_service.numerics.multibody.motion import Motion as Rates
from scaling_service.numerics.multibody.tree import pose_markers
from scaling_service.numerics.signals.filters import filter_butterworth
from scaling_service.numerics.signals.splines import differentiate_spline
from scaling_service.numerics.wrench import compute_root_wrench
from scaling_service.virtual.artefact import draw_shared, glide_marker, shift_marker
from scaling_service.virtual.motion import draw_wandering
from scaling_service.virtual.sequence import simulate_sequence

MODEL = "full_body_35dof"

STATURE_M, MASS_KG = (1.80, 0.07), (74.1, 7.3)
"""Mean and SD of the ten men of Muller et al. 2017 (sec. 2.3)."""

PROPORTION_SD = 0.03
"""Of a segment's length against stature (facts: 3 to 6 % for leg segments, Puchaud 2019, table 2)."""

MASS_SD, COM_M, TENSOR_SD = 0.10, 0.010, 0.15
"""How far a regression is from a person: share of a segment's mass, centre of mass per direction (m), share
of its inertia (chosen: as far as published tables are from each other)."""

LENGTH_LEFT, PLACE_LEFT_M = 0.01, 0.004
"""What a kinematic calibration leaves wrong: share of a length, a marker's place per direction (chosen:
Puchaud 2019 finds 5 to 10 mm between models of one person)."""

SKIN_MM_PER_DEG = 0.3
"""SD of a marker's glide per direction with each angle of its segment's joints: the thigh's of
``virtual_artefact``, for all segments (chosen: for most others there is no figure)."""

WANDER_M, WANDER_HZ = 0.002, 2.0
"""What no angle explains (RMS per direction), and its highest frequency (see ``virtual_artefact``)."""

CAMERA_M = 0.0005
"""Marker noise per direction, moving (see ``virtual_subject``)."""

PLATE_SHARE, PLATE_LEAST_N, CENTRE_M = 0.001 / 3, 0.22 / 3, 0.0002 / 3
"""Standard deviations of plates: a third of what AMTI promises (Muller et al. 2017, sec. 2.2)."""

EDGE_S = 0.3
"""Left out at both ends, where the filter has only one side to go by (chosen: one and a half periods of 5
Hz)."""

_CUTOFF_HZ, _ORDER = 5.0, 4  # of the plates' signals, as of the motion


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcitationSettings:
    """What is recorded, and how large its faults are (one: as in the literature, zero: none)."""

    seconds: float = 60.0
    rate_hz: float = 100.0
    skin: float = 1.0
    noise: float = 1.0
    inertia: float = 1.0
    calibration: float = 1.0


WHOLE = ExcitationSettings()
"""The minute that the study takes, with all faults."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Performance:
    """One recording of a virtual person with its truth."""

    name: str
    times: Array  # (n,), s
    q: Array  # (n, n_coordinates), rad and m: true
    loads: SegmentLoads  # true, not filtered
    recording: Recording  # as a laboratory has it: fitted motion, measured loads


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ExcitedPerson:
    """A person of whom everything is known."""

    seed: int
    height_m: float
    mass_kg: float
    truth: BodyModel  # true lengths, marker places at rest, inertia
    model: BodyModel  # what a calibration and a regression make of it
    performances: Mapping[str, Performance]  # in_order, and shuffled, which is never fitted


def make_excited_person(
    seed: int, settings: ExcitationSettings = WHOLE, names: tuple[str, ...] = ("in_order", "shuffled")
) -> ExcitedPerson:
    """Draw a person and record them.

    ``seed``: not negative. ``names``: which performances.
    """
    rng = stream(seed, "excited", "person")
    height, mass = float(rng.normal(*STATURE_M)), float(rng.normal(*MASS_KG))
    truth = _draw_truth(seed, height, mass, settings.inertia)
    model = _calibrate_model(seed, truth, height, mass, settings.calibration)
    performances = {name: _perform(seed, name, truth, model, height, settings) for name in names}
    return ExcitedPerson(
        seed=seed, height_m=height, mass_kg=mass, truth=truth, model=model, performances=performances
    )


def _draw_truth(seed: int, height: float, mass: float, size: float) -> BodyModel:
    generic = load_builtin(MODEL)
    stature = height / load_generic_person(MODEL).height_m
    factors = {}
    for name in generic.segment_names:
        both_sides = name.removesuffix("_r").removesuffix("_l")
        own = stature * (1.0 + PROPORTION_SD * stream(seed, "excited", "length", both_sides).normal())
        factors[name] = (own, own, own)
    model = scale_model(generic, factors, mass_kg=mass)
    table = apply_inertia_table(model, "dumas2007", sex="M", height_m=height, mass_kg=mass).model
    return with_inertias(table, _miss_inertia(seed, gather_inertias(table), mass, size))


def _miss_inertia(seed: int, table: Inertias, mass: float, size: float) -> Inertias:
    """The inertia of a person for whom a table says something else."""
    rng = stream(seed, "excited", "inertia")
    n = len(table.mass)
    own = table.mass * np.exp(MASS_SD * size * rng.normal(size=n))
    own *= mass / own.sum()
    com = table.com + COM_M * size * rng.normal(size=(n, 3))
    spread = np.exp(TENSOR_SD * size * rng.normal(size=n)) * own / table.mass
    tensors = np.array([find_possible_tensor(t)[0] for t in table.tensor * spread[:, None, None]])
    return Inertias(own, com, tensors)


def _calibrate_model(seed: int, truth: BodyModel, height: float, mass: float, size: float) -> BodyModel:
    rng = stream(seed, "excited", "calibration")
    factors = {}
    for name in truth.segment_names:
        own = float(1.0 + LENGTH_LEFT * size * rng.normal())
        factors[name] = (own, own, own)
    model = scale_model(truth, factors)
    markers = tuple(shift_marker(m, PLACE_LEFT_M * size * rng.normal(size=3)) for m in model.markers)
    model = model.with_markers(markers)
    return apply_inertia_table(model, "dumas2007", sex="M", height_m=height, mass_kg=mass).model


def _perform(
    seed: int, name: str, truth: BodyModel, model: BodyModel, height: float, settings: ExcitationSettings
) -> Performance:
    times = np.arange(round(settings.seconds * settings.rate_hz)) / settings.rate_hz
    rng = stream(seed, "excited", "motion", name)
    q, right = simulate_sequence(truth, times, rng, height, in_order=name == "in_order")
    loads = _compute_true_loads(truth, times, q, right)
    labels = tuple(m.name for m in truth.markers if m.weight > 0.0)
    trial = Trial(
        name=name,
        times=times,
        labels=labels,
        markers=_record_markers(seed, name, truth, labels, times, q, settings),
        rate_hz=settings.rate_hz,
    )
    motion = inverse_kinematics(model, trial)
    inner = (times >= EDGE_S) & (times <= times[-1] - EDGE_S)
    measured = _measure_loads(seed, name, loads, settings)
    return Performance(
        name=name,
        times=times,
        q=q,
        loads=loads,
        recording=Recording(model=model, motion=motion, loads=measured, height_m=height, frames=inner),
    )


def _compute_true_loads(truth: BodyModel, times: Array, q: Array, right: Array) -> SegmentLoads:
    """What both plates give: the force shared as the load is, centres of pressure as far apart as the feet.

    Both forces are parallel and the common centre of pressure lies between, so that their sum is the net
    wrench.
    """
    first, second = differentiate_spline(times, q)
    p = list_parameter_values(truth)
    wrench, _ = compute_root_wrench(compile_mechanism(truth), Rates.of_frames(q, first, second), p)
    force, moment = wrench[:3].T, wrench[3:].T
    vertical = force[:, 1]
    centre = np.column_stack([moment[:, 2] / vertical, np.zeros_like(vertical), -moment[:, 0] / vertical])
    free = moment - np.cross(centre, force)  # about the vertical
    feet = truth.with_markers(tuple(Marker.at(f"own {s}", f"calcn_{s}", (0.0, 0.0, 0.0)) for s in "rl"))
    ankles = pose_markers(compile_model(feet), q, p)
    apart = (ankles[:, 0] - ankles[:, 1]) * [1.0, 0.0, 1.0]
    share = np.column_stack([right, 1.0 - right])[..., None]
    centres = np.stack([centre + (1.0 - right)[:, None] * apart, centre - right[:, None] * apart], axis=1)
    forces = share * force[:, None]
    moments = np.cross(centres, forces) + share * free[:, None]
    return SegmentLoads(times, ("calcn_r", "calcn_l"), forces, moments)


def _measure_loads(seed: int, name: str, loads: SegmentLoads, settings: ExcitationSettings) -> SegmentLoads:
    """Loads with the plates' noise, through the filter of inverse dynamics."""
    rng = stream(seed, "excited", "plates", name)
    load = np.linalg.norm(loads.force, axis=2, keepdims=True)
    sigma = settings.noise * np.maximum(PLATE_SHARE * load, PLATE_LEAST_N)
    pushed = sigma * rng.normal(size=(*load.shape[:2], 3))
    vertical = np.maximum(loads.force[..., 1:2], 1.0)
    centre = np.cross([0.0, 1.0, 0.0], loads.moment) / vertical
    shifted = settings.noise * CENTRE_M * rng.normal(size=pushed.shape) * [1.0, 0.0, 1.0]
    force = loads.force + pushed
    moment = loads.moment + np.cross(centre + shifted, pushed) + np.cross(shifted, loads.force)
    both = np.stack([force, moment])
    slow = filter_butterworth(
        np.moveaxis(both, 1, 0), rate_hz=settings.rate_hz, cutoff_hz=_CUTOFF_HZ, order=_ORDER
    ).values
    return replace(loads, force=slow[:, 0], moment=slow[:, 1])


def _record_markers(
    seed: int,
    name: str,
    truth: BodyModel,
    labels: tuple[str, ...],
    times: Array,
    q: Array,
    settings: ExcitationSettings,
) -> Array:
    """What the cameras see, shape (n, n_markers, 3), m."""
    skin = truth.with_markers(tuple(_make_gliding(seed, m, truth, settings.skin) for m in truth.markers))
    seen = pose_markers(compile_model(skin, labels), q, list_parameter_values(skin))
    for k, label in enumerate(labels):
        rng = stream(seed, "excited", "markers", name, label)
        for axis in range(3):
            seen[:, k, axis] += draw_wandering(rng, times, settings.skin * WANDER_M, WANDER_HZ)
        seen[:, k] += settings.noise * CAMERA_M * rng.normal(size=(len(times), 3))
    return seen


def _make_gliding(seed: int, marker: Marker, model: BodyModel, size: float) -> Marker:
    """A marker that moves over its segment with the angles of the segment's joints."""
    per_rad = {}
    for coordinate in _list_joints_about(model, marker.segment):
        drawn = draw_shared(seed, "excited", "skin", marker.segment, coordinate, marker=marker.name)
        per_rad[coordinate] = to_vector(1e-3 * np.degrees(size * SKIN_MM_PER_DEG * drawn))
    return glide_marker(marker, per_rad)


def _list_joints_about(model: BodyModel, segment: str) -> list[str]:
    """Angles of the joint that carries a segment and of those that it carries, the root's own apart."""
    near = [s for s in model.segments if s.name == segment or s.parent == segment]
    joints = [joint for s in near if s.parent != "ground" for joint in s.joints]
    return sorted({c for joint in joints for c in joint.law.coordinates})
