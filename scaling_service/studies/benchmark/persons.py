"""Virtual persons of known body, drawn and moved by code that shares nothing with the product.

Bones, palpated markers, skin that slides with the joints and wanders, and a recording of it all: NumPy and
SciPy's rotations alone. X forward, Y up, Z right; lengths in m. The numbers are draws from what was published
of people (``shared`` sources named beside each), not the product's own tables.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
Places = Mapping[str, tuple[str, Array]]
"""Marker to its segment and its place there, m."""

RATE_HZ = 50.0
SIDES = {"r": 1.0, "l": -1.0}

STATURE = {"M": (1.756, 0.069), "F": (1.629, 0.064)}  # ANSUR II
ASIS_WIDTH = {"M": (0.236, 0.016), "F": (0.234, 0.017)}  # CT: Augustine 2018 (238 mm, SD 20), Richards
PELVIC_DEPTH = (0.150, 0.011)  # mid-ASIS to mid-PSIS on bone
PSIS_WIDTH = (0.090, 0.009)
KNEE_WIDTH = {"M": (0.0827, 0.0040), "F": (0.0725, 0.0035)}  # epicondylar breadth of dry bones
ANKLE_WIDTH = {"M": (0.072, 0.004), "F": (0.065, 0.004)}
FEMUR, SHANK = (0.2454, 0.012), (0.2356, 0.011)  # Puchaud 2019: share of stature, SD m; correlated 0.8
SIDE_SD = 0.003  # chosen: right against left
HIP_SD = np.array([0.0070, 0.0052, 0.0045])  # of hips about a regression on other adults (CT)
HIP_SIDES = 0.85  # correlation of the two sides
AXIS_SD = np.radians(2.0)  # Puchaud 2019: 1.8 and 2.1 deg
PALPATION = {"ASIS": 0.006, "PSIS": 0.006, "LFE": 0.005, "MFE": 0.005, "FH": 0.005, "LM": 0.003, "MM": 0.003}
"""Of each axis; Della Croce 2005, trained examiners."""

SHIFT = {"femur": 0.006, "tibia": 0.004, "pelvis": 0.005}  # of a cluster, SD along each axis over a movement
TURN = {"femur": np.radians(4), "tibia": np.radians(3), "pelvis": np.radians(3)}
SINGLE = {"femur": 0.004, "tibia": 0.003, "pelvis": 0.004}  # of one marker beside its cluster
"""Sizes of skin's movement: D'Isidoro 2020, Barre 2013, Camomilla 2017 (thigh 18 mm and 10 deg at most, shank
17 and 7, deformation 4 to 16); an SD is about a third of the most."""
LOOSE = 0.5  # of these, what wanders instead of following the joints
REACH = {"hip_flexion": 0.45, "hip_adduction": 0.20, "hip_rotation": 0.20, "knee_angle": 0.5}
"""SD of an angle over a movement, rad."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class World:
    """What differs between laboratories and people: factors on the sizes above."""

    skin: float = 1.0  # on all skin movement
    spines_m: tuple[float, float] = (0.0, 0.0)  # skin over ASIS and PSIS
    longer: float = 0.0  # relative, of femur and shank against what stature says
    palpation: float = 1.0
    noise_m: float = 0.0003


@dataclasses.dataclass(frozen=True, kw_only=True)
class Person:
    """The truth, in the frames of the bones, and the recordings.

    ``centres`` and ``joints`` hold for each trial the true joint centres (n, 3) in the room and angles (rad).
    """

    sex: str
    height: float
    bones: Mapping[str, Array]
    lengths: Mapping[str, float]
    places: Mapping[str, tuple[str, Array]]
    trials: Mapping[str, tuple[Array, Mapping[str, Array]]]
    centres: Mapping[str, Mapping[str, Array]]
    angles: Mapping[str, Mapping[str, Array]]
    segments: Mapping[str, str] = dataclasses.field(default_factory=dict)
    skin: Mapping[tuple[str, str], Array] = dataclasses.field(default_factory=dict)


def _hip(width: float, depth: float, leg: float) -> Array:
    """Mean of Harrington 2007 (several predictors) and Hara 2016, right side, from mid-ASIS."""
    harrington = [
        -0.24 * depth - 0.0099,
        -0.16 * width - 0.04 * leg - 0.0071,
        0.28 * depth + 0.16 * width + 0.0079,
    ]
    hara = [0.011 - 0.063 * leg, -0.009 - 0.078 * leg, 0.008 + 0.086 * leg]
    return np.add(harrington, hara) / 2.0


def draw_person(seed: int, world: World = World()) -> Person:
    """One person and their recordings: standing, hips and knees moved in turn, and walking."""
    rng = np.random.default_rng([2027, seed])
    sex = "MF"[int(rng.integers(2))]
    height = rng.normal(*STATURE[sex])
    both = rng.multivariate_normal([0, 0], [[1, 0.8], [0.8, 1]])
    femur = (FEMUR[0] * height + FEMUR[1] * both[0]) * (1 + world.longer)
    shank = (SHANK[0] * height + SHANK[1] * both[1]) * (1 + world.longer)
    width, depth = rng.normal(*ASIS_WIDTH[sex]), rng.normal(*PELVIC_DEPTH)
    psis = rng.normal(*PSIS_WIDTH)
    knee, ankle = rng.normal(*KNEE_WIDTH[sex]), rng.normal(*ANKLE_WIDTH[sex])
    leg = femur + shank + 0.085
    common, own = np.sqrt(HIP_SIDES), np.sqrt(1 - HIP_SIDES)
    shared = rng.normal(size=3)
    bones: dict[str, Array] = {}
    lengths: dict[str, float] = {}
    bony: dict[str, tuple[str, Array, Array]] = {}  # landmark: segment, place, outward skin
    axis: dict[str, Rotation] = {}
    for s, sign in SIDES.items():
        S = s.upper()
        hip = _hip(width, depth, leg) + HIP_SD * (common * shared + own * rng.normal(size=3))
        bones[f"hip_{s}"] = hip * [1, 1, sign]
        lengths[f"femur_{s}"] = femur + SIDE_SD * rng.normal()
        lengths[f"shank_{s}"] = shank + SIDE_SD * rng.normal()
        axis[s] = Rotation.from_euler("yx", AXIS_SD * rng.normal(size=2))  # of the flexion axis, in the femur
        front, back = world.spines_m
        bony[f"{S}ASIS"] = ("pelvis", np.array([0, 0, sign * width / 2]), np.array([front + 0.010, 0, 0]))
        bony[f"{S}PSIS"] = ("pelvis", np.array([-depth, 0, sign * psis / 2]), np.array([-back - 0.010, 0, 0]))
        low = np.array([0, -lengths[f"femur_{s}"], 0])
        out = np.array([0, 0, sign])
        bony[f"{S}LFE"] = (f"femur_{s}", low + out * knee / 2, 0.012 * out)
        bony[f"{S}MFE"] = (f"femur_{s}", low - out * knee / 2, -0.012 * out)
        torsion = Rotation.from_euler("y", -sign * np.radians(rng.normal(18, 6)))
        end = np.array([0, -lengths[f"shank_{s}"], 0])
        across = torsion.apply([0, -0.005, sign * ankle / 2])
        bony[f"{S}LM"] = (f"tibia_{s}", end + across, 0.010 * torsion.apply(out))
        bony[f"{S}MM"] = (f"tibia_{s}", end - across, -0.010 * torsion.apply(out))
        head = np.array([-0.020, -0.055, sign * (knee / 2 - 0.002)])
        bony[f"{S}FH"] = (f"tibia_{s}", head, 0.012 * out)
    lengths["inter_hip"] = float(np.linalg.norm(bones["hip_r"] - bones["hip_l"]))
    places: dict[str, tuple[str, Array]] = {}
    for name, (segment, at, skin) in bony.items():
        off = world.palpation * PALPATION[name[1:]] * rng.normal(size=3)
        places[name] = (segment, at + skin + off)
    for s, sign in SIDES.items():
        for k in range(4):
            height_share, turn = rng.uniform(0.35, 0.75), np.radians(rng.uniform(-50, 70))
            radius = 0.085 - 0.025 * height_share
            at = np.array([radius * np.sin(turn), -height_share * femur, sign * radius * np.cos(turn)])
            places[f"{s.upper()}TH{k + 1}"] = (f"femur_{s}", at)
            height_share, turn = rng.uniform(0.25, 0.75), np.radians(rng.uniform(-30, 60))
            at = np.array([0.055 * np.sin(turn), -height_share * shank, sign * 0.055 * np.cos(turn)])
            places[f"{s.upper()}SH{k + 1}"] = (f"tibia_{s}", at)
    laws = _draw_skin(places, world.skin, rng)
    trials, centres, angles = {}, {}, {}
    for trial, q in _moves(rng).items():
        poses = _pose(q, bones, lengths, axis)
        markers = {}
        slide = _slide(places, laws, q, len(q["time"]), world.skin, rng)
        for name, (segment, at) in places.items():
            R, origin = poses[segment]
            local = at + slide[name]
            markers[name] = (
                origin + np.einsum("nij,nj->ni", R, local) + world.noise_m * rng.normal(size=local.shape)
            )
        trials[trial] = (q["time"], markers)
        centres[trial] = {f"hip_{s}": poses[f"femur_{s}"][1] for s in SIDES}
        centres[trial] |= {f"knee_{s}": poses[f"tibia_{s}"][1] for s in SIDES}
        angles[trial] = {k: v for k, v in q.items() if k != "time"}
    return Person(
        sex=sex,
        height=height,
        bones=bones,
        lengths=lengths,
        places=places,
        trials=trials,
        centres=centres,
        angles=angles,
        segments={n: segment for n, (segment, _) in places.items()},
        skin=laws,
    )


def _drivers(segment: str) -> list[str]:
    s = segment[-1]
    if segment == "pelvis":
        return [f"hip_flexion_{s}" for s in SIDES]
    own = (
        [f"{n}_{s}" for n in ("hip_flexion", "hip_adduction", "hip_rotation")]
        if segment[:5] == "femur"
        else []
    )
    return [*own, f"knee_angle_{s}"]


def _draw_skin(places: Places, size: float, rng: np.random.Generator) -> dict[tuple[str, str], Array]:
    """Marker and driver to mm per rad along the segment's axes."""
    found = {}
    for segment in dict.fromkeys(s for s, _ in places.values()):
        kind, names = segment.split("_")[0], [n for n, (s, _) in places.items() if s == segment]
        middle = np.mean([places[n][1] for n in names], axis=0)
        drivers = _drivers(segment)
        for driver in drivers:
            share = size / np.sqrt(len(drivers)) / REACH[driver[:-2]]
            shift, turn = SHIFT[kind] * rng.normal(size=3), TURN[kind] * rng.normal(size=3)
            for n in names:
                alone = SINGLE[kind] * rng.normal(size=3)
                found[n, driver] = share * (shift + np.cross(turn, places[n][1] - middle) + alone)
    return found


def _slide(
    places: Places,
    skin: Mapping[tuple[str, str], Array],
    q: Mapping[str, Array],
    n: int,
    size: float,
    rng: np.random.Generator,
) -> dict[str, Array]:
    """What each marker is off its place in its bone, (n, 3), m."""
    out: dict[str, Array] = {}
    for segment in dict.fromkeys(s for s, _ in places.values()):
        kind, names = segment.split("_")[0], [m for m, (s, _) in places.items() if s == segment]
        middle = np.mean([places[m][1] for m in names], axis=0)

        def wander(sd: float) -> Array:
            raw: Array = gaussian_filter1d(rng.normal(size=(n + 200, 3)), 0.15 * RATE_HZ, axis=0)[
                100 : n + 100
            ]
            return np.asarray(LOOSE * size * sd * raw / np.sqrt(1 / (2 * np.sqrt(np.pi) * 0.15 * RATE_HZ)))

        shift, turn = wander(SHIFT[kind]), wander(TURN[kind])
        for m in names:
            lawful = np.sum([np.outer(q[d], skin[m, d]) for d in _drivers(segment)], axis=0)
            out[m] = lawful + shift + np.cross(turn, places[m][1] - middle) + wander(SINGLE[kind])
    return out


def _moves(rng: np.random.Generator) -> dict[str, dict[str, Array]]:
    """Time and angles (rad) of every trial."""

    def smooth(n: int, sd: float, seconds: float) -> Array:
        raw: Array = gaussian_filter1d(rng.normal(size=n + 400), seconds * RATE_HZ)[200 : n + 200]
        return np.asarray(sd * raw / max(raw.std(), 1e-9))

    def still(n: int) -> dict[str, Array]:
        q: dict[str, Array] = {"time": np.arange(n) / RATE_HZ}
        for c in ("pelvis_tilt", "pelvis_list", "pelvis_rotation"):
            q[c] = np.full(n, np.radians(rng.normal(0, 2)))
        for s in SIDES:
            q[f"hip_flexion_{s}"] = np.full(n, np.radians(rng.normal(8, 4)))
            q[f"hip_adduction_{s}"] = np.full(n, np.radians(rng.normal(-2, 2)))
            q[f"hip_rotation_{s}"] = np.full(n, np.radians(rng.normal(0, 4)))
            q[f"knee_angle_{s}"] = np.full(n, np.radians(abs(rng.normal(4, 3))))
        return {k: v + (0 if k == "time" else smooth(n, np.radians(0.3), 0.5)) for k, v in q.items()}

    trials = {"static": still(50)}
    for s in SIDES:
        q = still(400)
        t = q["time"] / q["time"][-1]
        q[f"hip_flexion_{s}"] += np.radians(25) * (1 + np.sin(2 * np.pi * 3 * t)) * (t < 0.55)
        q[f"hip_adduction_{s}"] += np.radians(15) * np.sin(2 * np.pi * 4 * t) * (t > 0.3) * (t < 0.8)
        q[f"hip_rotation_{s}"] += np.radians(12) * np.sin(2 * np.pi * 5 * t) * (t > 0.5)
        q[f"knee_angle_{s}"] += np.radians(40) * (1 - np.cos(2 * np.pi * 3 * t))
        trials[f"functional_{s}"] = q
    q = still(120)
    phase = 2 * np.pi * q["time"] / 1.1
    q["pelvis_list"] += np.radians(3) * np.sin(phase)
    q["pelvis_rotation"] += np.radians(4) * np.cos(phase)
    for s, sign in SIDES.items():
        p = phase + (0 if sign > 0 else np.pi)
        q[f"hip_flexion_{s}"] += np.radians(20) * np.cos(p) + np.radians(8)
        q[f"hip_adduction_{s}"] += np.radians(5) * np.sin(p)
        q[f"hip_rotation_{s}"] += np.radians(4) * np.cos(p + 1)
        q[f"knee_angle_{s}"] += np.radians(25) * (1 - np.cos(p - 1.2)) + np.radians(8) * (1 - np.cos(2 * p))
    trials["walk"] = q
    return trials


def _pose(
    q: Mapping[str, Array],
    bones: Mapping[str, Array],
    lengths: Mapping[str, float],
    axis: Mapping[str, Rotation],
) -> dict[str, tuple[Array, Array]]:
    """Rotation (n, 3, 3) and origin (n, 3) of every bone in the room."""
    n = len(q["time"])
    R = Rotation.from_euler(
        "YXZ", np.column_stack([q["pelvis_rotation"], q["pelvis_list"], q["pelvis_tilt"]])
    )
    origin = np.column_stack([0.5 * q["time"], np.full(n, 1.0), np.zeros(n)])
    poses = {"pelvis": (R.as_matrix(), origin)}
    for s, sign in SIDES.items():
        hip = origin + R.apply(bones[f"hip_{s}"])
        turns = np.column_stack(
            [q[f"hip_flexion_{s}"], sign * q[f"hip_adduction_{s}"], sign * q[f"hip_rotation_{s}"]]
        )
        femur = R * Rotation.from_euler("ZXY", turns)
        knee = hip + femur.apply([0, -lengths[f"femur_{s}"], 0])
        bend = Rotation.from_rotvec(-np.outer(q[f"knee_angle_{s}"], axis[s].apply([0, 0, 1])))
        tibia = femur * bend
        poses[f"femur_{s}"] = (femur.as_matrix(), hip)
        poses[f"tibia_{s}"] = (tibia.as_matrix(), knee)
    return poses
