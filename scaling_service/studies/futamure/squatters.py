"""Squatting persons made of numbers: known lengths, inertia and motion, recorded with the usual faults."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from scaling_service.capabilities.consistent.recording import expect_artefacts
from scaling_service.capabilities.kinetics.inverse_dynamics import RatedMotion
from scaling_service.core.arrays import Array
from scaling_service.core.streams import stream
from scaling_service.model import body, inertia
from scaling_service.model import compile as compiling
from scaling_service.model.anatomy import inertia_planar
from scaling_service.model.builtin import load_builtin
from scaling_service.model.forces import SegmentLoads
from scaling_service.model.scaling import scale_model
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody import tree as trees
from scaling_service.numerics.multibody.motion import Inertias
from scaling_service.numerics.signals.splines import differentiate_spline
from scaling_service.numerics.wrench import compute_root_wrench
from scaling_service.virtual.artefact import draw_shared
from scaling_service.virtual.motion import draw_wandering

SUBJECTS = 8
STATURE_M = (1.68, 0.11)
MASS_KG = (64.0, 11.0)
"""Futamure et al., section III: 8 men, mean and standard deviation."""

BODY_MASS_INDEX = (17.0, 35.0)
"""Chosen: drawn again outside, for stature and mass are given apart."""

LENGTH_SD = {"shank": 0.011, "thigh": 0.012, "torso": 0.020, "arm": 0.015}
"""m, about the mean for a stature. Shank and thigh: Puchaud 2019, table 2. Trunk and arm: chosen, 4 % and
5 %."""

TABLES = ("dumas2007", "dumas_wojtusch2018", "deleva1996")
"""One of them, drawn, is a person's mean inertia. The analysis starts from another table (Winter 2009), so
that it is wrong as tables are."""

MASS_SD, COM_SD, RADIUS_SD = 0.10, 0.10, 0.08
"""A person's scatter about the table: mass and radius of gyration relative, centre of mass over the radius of
gyration. The scatter between published tables: Dumas 2007, Dumas & Wojtusch 2018, de Leva 1996, Winter
2009."""

PLACEMENT_M: Mapping[str, float] = {
    "TOE": 0.003,
    "ANK": 0.003,
    "KNE": 0.005,
    "ASI": 0.007,
    "PSI": 0.007,
    "TIB": 0.02,
    "THI": 0.02,
}
"""SD of a marker's place about the model's, each axis. After Della Croce et al. 1999, 2005 (6-21 mm within
examiners), as for the walkers of Puchaud 2019; tracking markers sit anywhere: chosen, 20 mm."""

PLACEMENT_ELSE_M = 0.007
"""Trunk and arm, likewise."""

RESIDUAL_M = 0.0025
"""RMS of the artefact that no angle explains (facts of the walkers: 2 to 3 mm)."""

CAMERA_M = 0.0005
"""SD of a moving marker's coordinate."""

PLATE_SHARE, PLATE_LEAST_N, PLATE_COP_M = 0.001, 0.22, 0.0002
"""AMTI's data sheet as Muller et al. 2017 cite it: of the load, N, m; each three standard deviations."""

RATE_HZ, LENGTH_S = 100.0, 13.0
"""Futamure et al. record at 100 Hz. Length chosen: four squats."""

DEPTH_DEG, PERIOD_S = (95.0, 8.0), (2.9, 0.25)
"""Knee flexion at the bottom and time of one squat, mean and SD over persons (chosen)."""

LEAN_DEG, REACH_DEG = (38.0, 5.0), (30.0, 20.0)
"""Forward lean of the trunk and forward swing of the arms at the bottom, mean and SD over persons
(chosen)."""

OVER_FOOT_M = 0.04
"""Where the centre of mass stands before the ankle (chosen: a third of the way to the toes)."""

_NEWTON = 10
"""Steps that bring the centre of mass there (chosen: five would do)."""

_DRIVERS = {"shank": (0, 1), "thigh": (1, 2), "torso": (2,), "arm": (3,), "foot": ()}
"""Coordinates that move the skin of each segment, by number: the joints at its ends."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Squats:
    """One recording of a person."""

    name: str
    truth: RatedMotion
    trial: Trial  # markers with artefact and noise
    loads: SegmentLoads  # with the plate's noise, on the foot
    wrench: Array  # (n, 6): the true one, about the ankle


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class VirtualSquatter:
    """A person and the recordings."""

    name: str
    height_m: float
    mass_kg: float
    model: body.BodyModel  # the truth: lengths, inertia, places of markers standing
    fitted: Squats
    held_out: Squats


def make_virtual_squatter(seed: int, *, faults: float = 1.0) -> VirtualSquatter:
    """A person by seed.

    ``faults``: multiplies placement errors, artefact and noise: one as in the literature, zero for none.
    """
    rng, (low, high) = stream(seed, "squatter"), BODY_MASS_INDEX
    height = mass = 0.0
    while not (height > 0 and low < mass / height**2 < high):
        height, mass = float(rng.normal(*STATURE_M)), float(rng.normal(*MASS_KG))
    # Lengths and inertia
    generic = load_builtin(inertia_planar.SQUAT)
    rng = stream(seed, "squatter", "lengths")
    factors = {}
    for name, sd in LENGTH_SD.items():
        usual = height / STATURE_M[0]
        # The generic length of a segment, m
        child = generic.children(name)
        if not child:
            reach = float(np.linalg.norm(generic.marker("ELB").nominal))
        else:
            reach = sum(j.law.constant_part for j in child[0].joints if j.kind == "translation")
        factors[name] = usual + sd * float(rng.normal()) / reach
    factors["foot"] = height / STATURE_M[0]
    scaled = scale_model(generic, {name: (k, k, k) for name, k in factors.items()})
    table = TABLES[int(stream(seed, "squatter", "table").integers(len(TABLES)))]
    mean = inertia_planar.apply_to_squat(scaled, table, sex="M", height_m=height, mass_kg=mass).model
    model = _with_placement(seed, _scatter_model(seed, mean, mass), faults)
    fitted, held_out = (_perform_squats(seed, name, model, faults) for name in ("squats_1", "squats_2"))
    return VirtualSquatter(
        name=f"squatter_{seed}", height_m=height, mass_kg=mass, model=model, fitted=fitted, held_out=held_out
    )


def _scatter_model(seed: int, model: body.BodyModel, mass: float) -> body.BodyModel:
    rng, mean = stream(seed, "squatter", "inertia"), inertia.gather_inertias(model)
    count = len(mean.mass)
    heavy = mean.mass * (1.0 + MASS_SD * rng.normal(size=count))
    heavy *= mass / heavy.sum()
    gyration = np.sqrt(mean.tensor[:, 2, 2] / mean.mass)
    com = mean.com + COM_SD * gyration[:, None] * rng.normal(size=(count, 3)) * np.array([1.0, 1.0, 0.0])
    growth = (heavy / mean.mass) * (1.0 + RADIUS_SD * rng.normal(size=count)) ** 2
    return inertia.with_inertias(model, Inertias(heavy, com, mean.tensor * growth[:, None, None]))


def _with_placement(seed: int, model: body.BodyModel, faults: float) -> body.BodyModel:
    def move(marker: body.Marker) -> body.Marker:
        sd = faults * PLACEMENT_M.get(marker.name, PLACEMENT_ELSE_M)
        x, y = np.array(marker.nominal)[:2] + sd * stream(seed, "placement", marker.name).normal(size=2)
        return dataclasses.replace(
            body.Marker.at(marker.name, marker.segment, (float(x), float(y), 0.0)),
            anatomical=marker.anatomical,
        )

    return model.with_markers(tuple(map(move, model.markers)))


def _perform_squats(seed: int, name: str, model: body.BodyModel, faults: float) -> Squats:
    times = np.arange(round(RATE_HZ * LENGTH_S)) / RATE_HZ
    # Angles (n, 4) of repeated squats; the ankle keeps the centre of mass over the foot.
    rng, own = stream(seed, "motion", name), stream(seed, "motion")
    depth, period = float(own.normal(*DEPTH_DEG)), float(own.normal(*PERIOD_S))
    lean, reach = float(own.normal(*LEAN_DEG)), float(own.normal(*REACH_DEG))
    # How deep, 0 standing to 1: squats one after the other, each a little different.
    down, begin = np.zeros(len(times)), 0.7
    while begin + period < times[-1] - 0.2:
        length = period * (1.0 + 0.06 * rng.normal())
        phase = np.clip((times - begin) / length, 0.0, 1.0)
        down += (1.0 + 0.05 * rng.normal()) * np.sin(np.pi * phase) ** 4
        begin += length + 0.1
    degrees = np.zeros((len(times), 4))
    degrees[:, 0] = -3.0 - 0.3 * depth * down
    degrees[:, 1] = 6.0 + depth * down + draw_wandering(rng, times, 0.7, 1.0)
    degrees[:, 2] = -2.0 - lean * down + draw_wandering(rng, times, 0.7, 1.0) - degrees[:, 0] - degrees[:, 1]
    degrees[:, 3] = 5.0 + (reach + lean) * down + draw_wandering(rng, times, 2.0, 1.0)
    over = OVER_FOOT_M + 0.004 * own.normal() + draw_wandering(rng, times, 0.004, 0.8)
    q = _in_balance(model, np.radians(degrees), over)
    qdot, qddot = differentiate_spline(times, q)
    truth = RatedMotion(times, q, qdot, qddot)
    wrench = compute_root_wrench(
        inertia.compile_mechanism(model), truth.rates, compiling.list_parameter_values(model)
    )[0].T
    # Measured markers (n, n_markers, 3): skin glides with the joints, cameras add noise.
    tree, p = compiling.compile_model(model), compiling.list_parameter_values(model)
    poses = trees.pose_links(tree, np.ascontiguousarray(truth.q.T), p)
    placed = np.moveaxis(trees.place_tree_markers(tree, poses), -1, 0)
    n, count = placed.shape[:2]
    local = np.zeros((n, count, 3))
    expected = expect_artefacts(model)
    bend = truth.q - truth.q[:50].mean(axis=0)
    bend = bend / np.abs(bend).max(axis=0)
    for k, marker in enumerate(model.markers):
        drivers = _DRIVERS[marker.segment]
        for driver in drivers:
            mixed = draw_shared(seed, "artefact", marker.segment, driver, marker=marker.name, count=2)
            size = expected[marker.name] / np.sqrt(len(drivers))
            local[:, k, :2] += size * mixed * bend[:, [driver]]
        skin = stream(seed, "artefact", name, marker.name)
        if drivers:
            local[:, k, :2] += np.column_stack(
                [draw_wandering(skin, truth.times, RESIDUAL_M, 2.0) for _ in range(2)]
            )
    axes = poses.axes[tree.marker_link]
    noise = CAMERA_M * stream(seed, "camera", name).normal(size=(n, count, 3)) * np.array([1.0, 1.0, 0.0])
    moved: Array = placed + faults * (np.einsum("mjan,nmj->nma", axes, local) + noise)
    return Squats(
        name=name,
        truth=truth,
        trial=Trial(
            name=name,
            times=times,
            labels=model.marker_names,
            markers=moved,
            rate_hz=RATE_HZ,
        ),
        loads=_record_plate(seed, name, times, wrench, faults),
        wrench=wrench,
    )


def _in_balance(model: body.BodyModel, q: Array, over: Array) -> Array:
    """The ankle turned, the trunk as it was, until the centre of mass is ``over`` (n,) m before it."""
    tree, p = inertia.compile_mechanism(model).tree, compiling.list_parameter_values(model)
    masses = inertia.gather_inertias(model).mass / inertia.gather_inertias(model).mass.sum()

    def ahead(turn: Array) -> Array:
        at = q + turn[:, None] * np.array([1.0, 0.0, -1.0, 0.0])
        centres = trees.place_tree_markers(tree, trees.pose_links(tree, np.ascontiguousarray(at.T), p))
        return np.asarray(masses @ centres[:, 0])

    turn, step = np.zeros(len(q)), 1e-5
    for _ in range(_NEWTON):
        here = ahead(turn)
        turn += (over - here) * step / (ahead(turn + step) - here)
    return np.asarray(q + turn[:, None] * np.array([1.0, 0.0, -1.0, 0.0]))


def _record_plate(seed: int, name: str, times: Array, wrench: Array, faults: float) -> SegmentLoads:
    rng = stream(seed, "plate", name)
    force = wrench[:, :3].copy()
    sd = np.maximum(PLATE_SHARE * np.abs(force), PLATE_LEAST_N) / 3.0
    force += faults * sd * rng.normal(size=force.shape)
    pressure = wrench[:, 5] / wrench[:, 1] + faults * PLATE_COP_M / 3.0 * rng.normal(size=len(times))
    moment = np.zeros_like(force)
    moment[:, 2] = pressure * force[:, 1]
    force[:, 2] = 0.0
    return SegmentLoads(times, ("foot",), force[:, None], moment[:, None])
