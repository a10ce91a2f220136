"""A standing sequence that moves every joint, one after the other, as the video of Muller et al. 2017 did."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from scaling_service.model.body import BodyModel, Marker
from scaling_service.model.compile import compile_model, list_parameter_values, repeat_default_pose
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import pose_markers
from scaling_service.virtual.motion import ANKLE_HEIGHT, draw_wandering

SLOT_S = (1.2, 1.8)
"""How long one movement takes (chosen: unhurried imitation of a video; 29 joints fit into a minute)."""

SWAY_DEG, SWAY_HZ = 0.5, 0.7
"""Of every angle at all times (chosen: nobody keeps a joint quite still)."""

SHIFT_S = 0.6
"""How long it takes to shift the load from one foot to the other (chosen)."""

PEAK_SPREAD = (0.8, 1.2)
"""How far one performance differs from the video (chosen)."""


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
    model: BodyModel, times: Array, rng: np.random.Generator, stature_m: float, *, in_order: bool = True
) -> tuple[Array, Array]:
    """Coordinates of one performance.

    ``model``: the built-in whole body, of any size. ``times``: (n,), s. ``in_order``: as the video shows
    them, or shuffled. Returns ``q`` ((n, n_coordinates), rad and m): the pelvis is carried so that the feet
    that bear the person stay where they are; ``share`` (n,): of the load on the right foot.
    """
    q = repeat_default_pose(model, len(times))
    bearing = np.empty(len(times))
    column = {name: k for k, name in enumerate(model.coordinate_names)}
    for coordinate in model.coordinates:
        if coordinate.kind == "rotation":
            q[:, column[coordinate.name]] = np.radians(draw_wandering(rng, times, SWAY_DEG, SWAY_HZ))
    found, start, turn = list_movements(), 0.0, 0
    order = np.arange(len(found)) if in_order else rng.permutation(len(found))
    while start < times[-1]:
        movement = found[order[turn % len(order)]]
        lasting = movement.slots * rng.uniform(*SLOT_S)
        share = np.clip((times - start) / lasting, 0.0, 1.0)
        rise = _smooth(share)
        bearing[times >= start] = {"r": 0.0, "l": 1.0, "": 0.5}[movement.lifted]
        for name, peak in movement.peaks_deg.items():
            shape = np.sin(2 * np.pi * share) * rise if movement.both_ways else rise
            q[:, column[name]] += np.radians(peak * rng.uniform(*PEAK_SPREAD)) * shape
        start, turn = start + lasting, turn + 1
    right = _shift_load(bearing, float(np.median(np.diff(times))))
    return _simulate_standing(model, q, right, stature_m), right


def _smooth(share: Array) -> Array:
    """A bump whose acceleration is continuous, as a living body's is."""
    return np.asarray(np.sin(np.pi * share) ** 3)


def _shift_load(bearing: Array, step_s: float) -> Array:
    """The load goes over gradually, before and after a movement begins."""
    window = np.hanning(2 * round(0.5 * SHIFT_S / step_s) + 3)
    half = len(window) // 2
    padded = np.pad(bearing, half, mode="edge")
    return np.convolve(padded, window / window.sum(), mode="valid")


def _simulate_standing(model: BodyModel, q: Array, right: Array, stature_m: float) -> Array:
    ankles = [Marker.at(f"own {s}", f"calcn_{s}", (0.0, 0.0, 0.0)) for s in "rl"]
    marked = model.with_markers(tuple(ankles))
    tree, p = compile_model(marked), list_parameter_values(marked)
    place = [model.coordinate_names.index(f"pelvis_t{axis}") for axis in "xyz"]
    q = q.copy()
    q[:, place] = 0.0
    placed = pose_markers(tree, q, p)
    still = pose_markers(tree, 0.0 * q[:1], p)[0]
    home = still - [still.mean(axis=0)[0], still[0, 1] - ANKLE_HEIGHT * stature_m, 0.0]
    share = np.column_stack([right, 1.0 - right])
    q[:, place] = np.einsum("nk,nka->na", share, home[None] - placed)
    return q
