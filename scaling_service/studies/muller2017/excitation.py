"""Virtual persons on two force plates who move every joint in turn, with true inertia, motion and forces.

Their true inertia is that of a regression, off by what regressions miss. What is recorded has skin that
glides with the joint angles, marker noise and plate noise; the model that follows it has the lengths and
marker places that a calibration leaves, and the regression's inertia.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from scaling_service.capabilities.dynamics.uncertainty.reference import LoadedMotion
from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.core.arrays import Array
from scaling_service.core.streams import stream
from scaling_service.model import body, builtin
from scaling_service.model import compile as compiling
from scaling_service.model import inertia as model_inertia
from scaling_service.model.anatomy import inertia as inertias
from scaling_service.model.forces import SegmentLoads
from scaling_service.model.scaling import scale_model
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.motion import Inertias
from scaling_service.numerics.multibody.motion import Motion as Rates
from scaling_service.numerics.multibody.tree import pose_markers
from scaling_service.numerics.signals.filters import filter_butterworth
from scaling_service.numerics.signals.splines import differentiate_spline
from scaling_service.numerics.wrench import compute_root_wrench
from scaling_service.virtual import artefact
from scaling_service.virtual import motion as motions

SLOT_S = (1.2, 1.8)
"""How long one movement takes (chosen: unhurried imitation of a video; 29 joints fit into a minute)."""

SWAY_DEG, SWAY_HZ = 0.5, 0.7
"""Of every angle at all times (chosen: nobody keeps a joint quite still)."""

SHIFT_S = 0.6
"""How long it takes to shift the load from one foot to the other (chosen)."""

PEAK_SPREAD = (0.8, 1.2)
"""How far one performance differs from the video (chosen)."""

_SQUAT = {"hip_flexion": 90.0, "knee_angle": -90.0, "ankle_angle": 30.0}
_LEAN = {"pelvis_tilt": -30.0}  # forward, so that feet stay flat: the sum is zero
_TRUNK = {
    "lumbar_extension": 30.0,
    "lumbar_bending": 25.0,
    "lumbar_rotation": 30.0,
    "thoracic_extension": 10.0,
    "neck_extension": 35.0,
    "neck_bending": 30.0,
    "neck_rotation": 50.0,
}

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


@dataclass(frozen=True, slots=True)
class Movement:
    """One movement of the sequence."""

    peaks_deg: Mapping[str, float] = field(default_factory=dict)  # coordinate to its largest excursion
    both_ways: bool = False  # to and fro past the standing posture; else one way and back
    lifted: str = ""  # r or l where that foot leaves its plate
    slots: float = 1.0  # how many times longer than others it takes


def list_movements() -> tuple[Movement, ...]:
    """All movements; peaks are chosen within the model's ranges, as far as one reaches with ease."""
    squat = {f"{name}_{side}": peak for side in "rl" for name, peak in _SQUAT.items()}
    twist = {"pelvis_rotation": 15.0, "hip_rotation_r": -15.0, "hip_rotation_l": 15.0}
    trunk = [Movement({name: peak}, True) for name, peak in _TRUNK.items()]
    return (Movement(squat | _LEAN, slots=1.8), Movement(twist, True), *trunk, *_of_side("r"), *_of_side("l"))


def _of_side(side: str) -> tuple[Movement, ...]:
    def leg(both_ways: bool = False, **peaks: float) -> Movement:
        return Movement({f"{name}_{side}": peak for name, peak in peaks.items()}, both_ways, side)

    def arm(both_ways: bool = False, **peaks: float) -> Movement:
        return Movement({f"{name}_{side}": peak for name, peak in peaks.items()}, both_ways)

    return (
        leg(hip_flexion=60.0, knee_angle=-70.0),
        leg(hip_adduction=-30.0),
        leg(True, hip_flexion=25.0, hip_rotation=25.0),
        leg(hip_flexion=20.0, knee_angle=-80.0),
        leg(True, ankle_angle=20.0),
        arm(arm_flex=100.0),
        arm(arm_add=-70.0),
        arm(True, arm_rot=50.0, elbow_flex=20.0),
        arm(elbow_flex=110.0),
        arm(True, wrist_flex=50.0),
        arm(True, wrist_dev=20.0),
    )


def simulate_sequence(
    model: body.BodyModel, times: Array, rng: np.random.Generator, stature_m: float, *, in_order: bool = True
) -> tuple[Array, Array]:
    """Coordinates of one performance.

    ``model``: the built-in whole body, of any size. ``times``: (n,), s. ``in_order``: as the video shows
    them, or shuffled. Returns ``q`` ((n, n_coordinates), rad and m): the pelvis is carried so that the feet
    that bear the person stay where they are; ``share`` (n,): of the load on the right foot.
    """
    q = compiling.repeat_default_pose(model, len(times))
    bearing = np.empty(len(times))
    column = {name: k for k, name in enumerate(model.coordinate_names)}
    for coordinate in model.coordinates:
        if coordinate.kind == "rotation":
            q[:, column[coordinate.name]] = np.radians(motions.draw_wandering(rng, times, SWAY_DEG, SWAY_HZ))
    found, start, turn = list_movements(), 0.0, 0
    order = np.arange(len(found)) if in_order else rng.permutation(len(found))
    while start < times[-1]:
        movement = found[order[turn % len(order)]]
        lasting = movement.slots * rng.uniform(*SLOT_S)
        share = np.clip((times - start) / lasting, 0.0, 1.0)
        rise = np.asarray(np.sin(np.pi * share) ** 3)
        bearing[times >= start] = {"r": 0.0, "l": 1.0, "": 0.5}[movement.lifted]
        for name, peak in movement.peaks_deg.items():
            shape = np.sin(2 * np.pi * share) * rise if movement.both_ways else rise
            q[:, column[name]] += np.radians(peak * rng.uniform(*PEAK_SPREAD)) * shape
        start, turn = start + lasting, turn + 1
    # The load goes over gradually, before and after a movement begins.
    window = np.hanning(2 * round(0.5 * SHIFT_S / float(np.median(np.diff(times)))) + 3)
    half = len(window) // 2
    padded = np.pad(bearing, half, mode="edge")
    right = np.convolve(padded, window / window.sum(), mode="valid")
    return _simulate_standing(model, q, right, stature_m), right


def _simulate_standing(model: body.BodyModel, q: Array, right: Array, stature_m: float) -> Array:
    ankles = [body.Marker.at(f"own {s}", f"calcn_{s}", (0.0, 0.0, 0.0)) for s in "rl"]
    marked = model.with_markers(tuple(ankles))
    tree, p = compiling.compile_model(marked), compiling.list_parameter_values(marked)
    place = [model.coordinate_names.index(f"pelvis_t{axis}") for axis in "xyz"]
    q = q.copy()
    q[:, place] = 0.0
    placed = pose_markers(tree, q, p)
    still = pose_markers(tree, 0.0 * q[:1], p)[0]
    home = still - [still.mean(axis=0)[0], still[0, 1] - motions.ANKLE_HEIGHT * stature_m, 0.0]
    share = np.column_stack([right, 1.0 - right])
    q[:, place] = np.einsum("nk,nka->na", share, home[None] - placed)
    return q


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcitationSettings:
    """What is recorded, and how large its faults are (one: as in the literature, zero: none).

    The study takes the minute with all faults.
    """

    seconds: float = 60.0
    rate_hz: float = 100.0
    skin: float = 1.0
    noise: float = 1.0
    inertia: float = 1.0
    calibration: float = 1.0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Performance:
    """One recording of a virtual person with its truth."""

    name: str
    times: Array  # (n,), s
    q: Array  # (n, n_coordinates), rad and m: true
    loads: SegmentLoads  # true, not filtered
    recording: LoadedMotion  # as a laboratory has it: fitted motion, measured loads


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ExcitedPerson:
    """A person of whom everything is known."""

    seed: int
    height_m: float
    mass_kg: float
    truth: body.BodyModel  # true lengths, marker places at rest, inertia
    model: body.BodyModel  # what a calibration and a regression make of it
    performances: Mapping[str, Performance]  # in_order, and shuffled, which is never fitted


def make_excited_person(
    seed: int,
    settings: ExcitationSettings = ExcitationSettings(),
    names: tuple[str, ...] = ("in_order", "shuffled"),
) -> ExcitedPerson:
    """Draw a person and record them.

    ``seed``: not negative. ``names``: which performances.
    """
    rng = stream(seed, "excited", "person")
    height, mass = float(rng.normal(*STATURE_M)), float(rng.normal(*MASS_KG))
    generic = builtin.load_builtin(MODEL)
    stature = height / builtin.load_generic_person(MODEL).height_m
    factors = {}
    for name in generic.segment_names:
        both_sides = name.removesuffix("_r").removesuffix("_l")
        own = stature * (1.0 + PROPORTION_SD * stream(seed, "excited", "length", both_sides).normal())
        factors[name] = (own, own, own)
    scaled = scale_model(generic, factors, mass_kg=mass)
    table = inertias.apply_inertia_table(scaled, "dumas2007", sex="M", height_m=height, mass_kg=mass).model
    # The inertia of a person for whom a table says something else
    tabled = model_inertia.gather_inertias(table)
    draws = stream(seed, "excited", "inertia")
    n = len(tabled.mass)
    masses = tabled.mass * np.exp(MASS_SD * settings.inertia * draws.normal(size=n))
    masses *= mass / masses.sum()
    com = tabled.com + COM_M * settings.inertia * draws.normal(size=(n, 3))
    spread = np.exp(TENSOR_SD * settings.inertia * draws.normal(size=n)) * masses / tabled.mass
    tensors = np.array([inertias.find_possible_tensor(t)[0] for t in tabled.tensor * spread[:, None, None]])
    truth = model_inertia.with_inertias(table, Inertias(masses, com, tensors))
    model = _calibrate_model(seed, truth, height, mass, settings.calibration)
    performances = {name: _perform(seed, name, truth, model, height, settings) for name in names}
    return ExcitedPerson(
        seed=seed, height_m=height, mass_kg=mass, truth=truth, model=model, performances=performances
    )


def _calibrate_model(
    seed: int, truth: body.BodyModel, height: float, mass: float, size: float
) -> body.BodyModel:
    rng = stream(seed, "excited", "calibration")
    factors = {}
    for name in truth.segment_names:
        own = float(1.0 + LENGTH_LEFT * size * rng.normal())
        factors[name] = (own, own, own)
    model = scale_model(truth, factors)
    markers = tuple(artefact.shift_marker(m, PLACE_LEFT_M * size * rng.normal(size=3)) for m in model.markers)
    model = model.with_markers(markers)
    return inertias.apply_inertia_table(model, "dumas2007", sex="M", height_m=height, mass_kg=mass).model


def _perform(
    seed: int,
    name: str,
    truth: body.BodyModel,
    model: body.BodyModel,
    height: float,
    settings: ExcitationSettings,
) -> Performance:
    times = np.arange(round(settings.seconds * settings.rate_hz)) / settings.rate_hz
    rng = stream(seed, "excited", "motion", name)
    q, right = simulate_sequence(truth, times, rng, height, in_order=name == "in_order")
    # What both plates give: the force shared as the load is, centres of pressure as far apart as the feet.
    # Both forces are parallel and the common centre of pressure lies between, so that their sum is the net
    # wrench.
    first, second = differentiate_spline(times, q)
    p = compiling.list_parameter_values(truth)
    wrench, _ = compute_root_wrench(
        model_inertia.compile_mechanism(truth), Rates.of_frames(q, first, second), p
    )
    force, moment = wrench[:3].T, wrench[3:].T
    vertical = force[:, 1]
    centre = np.column_stack([moment[:, 2] / vertical, np.zeros_like(vertical), -moment[:, 0] / vertical])
    free = moment - np.cross(centre, force)  # about the vertical
    feet = truth.with_markers(tuple(body.Marker.at(f"own {s}", f"calcn_{s}", (0.0, 0.0, 0.0)) for s in "rl"))
    ankles = pose_markers(compiling.compile_model(feet), q, p)
    apart = (ankles[:, 0] - ankles[:, 1]) * [1.0, 0.0, 1.0]
    share = np.column_stack([right, 1.0 - right])[..., None]
    centres = np.stack([centre + (1.0 - right)[:, None] * apart, centre - right[:, None] * apart], axis=1)
    forces = share * force[:, None]
    moments = np.cross(centres, forces) + share * free[:, None]
    loads = SegmentLoads(times, ("calcn_r", "calcn_l"), forces, moments)
    labels = tuple(m.name for m in truth.markers if m.weight > 0.0)
    # What the cameras see, shape (n, n_markers, 3), m
    gliding = []
    for m in truth.markers:
        # A marker that moves over its segment with the angles of the segment's joints
        per_rad = {}
        # Angles of the joint that carries a segment and of those that it carries, the root's own apart
        near = [s for s in truth.segments if s.name == m.segment or s.parent == m.segment]
        joints = [joint for s in near if s.parent != "ground" for joint in s.joints]
        for coordinate in sorted({c for joint in joints for c in joint.law.coordinates}):
            drawn = artefact.draw_shared(seed, "excited", "skin", m.segment, coordinate, marker=m.name)
            per_rad[coordinate] = body.to_vector(1e-3 * np.degrees(settings.skin * SKIN_MM_PER_DEG * drawn))
        gliding.append(artefact.glide_marker(m, per_rad))
    skin = truth.with_markers(tuple(gliding))
    seen = pose_markers(compiling.compile_model(skin, labels), q, compiling.list_parameter_values(skin))
    for k, label in enumerate(labels):
        glide = stream(seed, "excited", "markers", name, label)
        for axis in range(3):
            seen[:, k, axis] += motions.draw_wandering(glide, times, settings.skin * WANDER_M, WANDER_HZ)
        seen[:, k] += settings.noise * CAMERA_M * glide.normal(size=(len(times), 3))
    trial = Trial(
        name=name,
        times=times,
        labels=labels,
        markers=seen,
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
        recording=LoadedMotion(model=model, motion=motion, loads=measured, height_m=height, frames=inner),
    )


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
