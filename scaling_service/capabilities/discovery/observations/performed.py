"""The body of a recording in another, ordinary movement, as its markers and plates would show it.

Any body whose coordinates have their usual names can be asked what each movement would show.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.observations.tracked import MotionFit
from scaling_service.capabilities.discovery.observations.wrench import FEET, ContactAssignment, WrenchFit
from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import repeat_default_pose
from scaling_service.model.forces import GroundForces
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.tree import pose_markers
from scaling_service.numerics.signals.filters import filter_butterworth

N_FRAMES, RATE_HZ = 200, 50.0

_Course = Callable[[Array], Array]
_Feet = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Which markers are on the right and on the left foot."""

_ALSO = {
    "knee": ("knee_angle", "knee_flexion"),
    "ankle": ("ankle_angle", "ankle_flexion"),
    "elbow": ("elbow_flex",),
}

_UP = np.array([0.0, 1.0, 0.0])
_STEP_M, _SAME = 0.1, 1e-6
_SMOOTH_HZ = 3.0  # chosen: which foot is the lowest changes at once, the pelvis does not
_SIDES = ("_r", "_l")


def _make_wave(mean_deg: float, swing_deg: float, lead: float = 0.0) -> _Course:
    """Degrees over a cycle 0 to 1."""
    return lambda phase: np.radians(mean_deg + swing_deg * np.cos(2.0 * np.pi * (phase + lead)))


MOVEMENTS: Mapping[str, Mapping[str, _Course]] = {
    "quiet standing": {"hip_flexion": _make_wave(0, 1), "knee": _make_wave(3, 1), "ankle": _make_wave(2, 1)},
    "a squat": {
        "hip_flexion": _make_wave(45, -45),
        "knee": _make_wave(50, -50),
        "ankle": _make_wave(12, -12),
        "lumbar_extension": _make_wave(-15, 15),
        "arm_flex": _make_wave(40, -40),
    },
    "gait": {
        "hip_flexion": _make_wave(10, 22),
        "hip_adduction": _make_wave(0, 5, 0.25),
        "hip_rotation": _make_wave(0, 5, 0.4),
        "knee": _make_wave(25, 22, 0.35),
        "ankle": _make_wave(0, 12, 0.6),
        "lumbar_extension": _make_wave(-3, 3),
        "arm_flex": _make_wave(5, 20, 0.5),
    },
    "hip circumduction": {
        "hip_flexion": _make_wave(15, 30),
        "hip_adduction": _make_wave(-10, 20, 0.25),
        "knee": _make_wave(5, 4),
    },
    "standing hip rotation with a straight knee": {
        "hip_rotation": _make_wave(0, 30),
        "knee": _make_wave(2, 1),
    },
    "bending the knee with a still hip": {"hip_flexion": _make_wave(10, 3), "knee": _make_wave(55, -50)},
    "a jump": {
        "hip_flexion": _make_wave(35, -35),
        "knee": _make_wave(45, -45),
        "ankle": _make_wave(-5, -25),
        "arm_flex": _make_wave(40, -60),
    },
    "leaning the trunk": {"lumbar_extension": _make_wave(-20, 20), "lumbar_bending": _make_wave(0, 15, 0.25)},
    "swinging the arms": {
        "arm_flex": _make_wave(40, 60),
        "elbow": _make_wave(40, 40),
        "arm_add": _make_wave(-30, 20, 0.25),
    },
}
"""Coordinate (the beginning of its name) to its course over one cycle of two seconds, degrees. Ranges are
those of healthy adults (gait: Winter 2009, appendix; the others chosen round)."""


def simulate_coordinates(model: BodyModel, movement: str) -> Array | None:
    """The model's coordinates through a movement, (N_FRAMES, n_coordinates); None if it has none of them."""
    phase = np.arange(N_FRAMES) / N_FRAMES * (N_FRAMES / RATE_HZ) / 2.0
    q = repeat_default_pose(model, N_FRAMES)
    found = False
    for start, course in MOVEMENTS[movement].items():
        for k, name in enumerate(model.coordinate_names):
            if name.startswith(_ALSO.get(start, (start,))) and not name.endswith("beta"):
                other = 0.5 if name.endswith("_l") and movement in ("gait", "swinging the arms") else 0.0
                q[:, k] = _clip_to_range(model, k, course(phase + other))
                found = True
    return q if found else None


def _clip_to_range(model: BodyModel, k: int, values: Array) -> Array:
    """Values in the range that the model declares; a knee that bends the other way is turned round."""
    c = model.coordinates[k]
    if c.lower < c.upper and np.isfinite([c.lower, c.upper]).all():
        if values.max() > c.upper and -values.min() <= c.upper and -values.max() >= c.lower - 0.1:
            values = -values
        return np.asarray(np.clip(values, c.lower, c.upper))
    return values


def perform_movement(like: MotionFit, movement: str) -> MotionFit | None:
    """The same markers on the same body in another movement; None if it has none of its coordinates."""
    q = simulate_coordinates(like.task.model, movement)
    return None if q is None else _move_trial(like, q, movement)


def perform_on_plates(like: WrenchFit, movement: str) -> WrenchFit | None:
    """The same body with its feet on plates, which measure what the movement needs.

    Each plate lies under the foot that it was under in the recording; the feet share the load as the centre
    of pressure lies between them. None where the body has no two feet, or the plates no foot.
    """
    item = perform_movement(like.tracked, movement)
    segments = [like.tracked.task.model.marker(m).segment for m in like.tracked.markers]
    right, left = (
        np.flatnonzero([name.startswith(FEET) and name.endswith(side) for name in segments])
        for side in _SIDES
    )
    if item is None or not len(right) or not len(left):
        return None
    feet = right, left
    sides = _assign_sides(like, feet)
    if not sides:
        return None
    # The coordinates with the lower foot kept on the floor; as they are where the root does not travel
    task, q = item.task, item.q.copy()
    height = _locate_feet(item, feet)[:, :, 1].min(axis=1)
    smooth = filter_butterworth(height, rate_hz=RATE_HZ, cutoff_hz=_SMOOTH_HZ, order=4).values
    for k, coordinate in enumerate(task.model.coordinates):
        if coordinate.kind == "translation":
            moved = q[:1].copy()
            moved[0, k] += _STEP_M
            lifted = pose_markers(task.tree, moved, task.p) - task.measured[:1]
            if np.abs(lifted - _STEP_M * _UP).max() < _SAME:
                q[:, k] -= smooth - smooth[0]
                break
    item = _move_trial(item, q, movement)
    made = replace(
        like,
        tracked=item,
        contacts=replace(like.contacts, usable=np.ones(len(item.q), dtype=bool)),
        oscillating=(),
        touched=None,
    )
    ground = _share_wrench(made, feet, sides)
    return replace(made, contacts=ContactAssignment(ground, made.contacts.usable, like.cutoff_hz))


def _move_trial(like: MotionFit, q: Array, movement: str) -> MotionFit:
    times: Array = np.arange(len(q)) / RATE_HZ
    places = pose_markers(like.task.tree, q, like.task.p)
    trial = Trial(name=movement, times=times, labels=like.markers, markers=places, rate_hz=RATE_HZ)
    return replace(like, trial=trial, role="fit", task=replace(like.task, measured=places), q=q)


def _locate_feet(item: MotionFit, feet: _Feet) -> Array:
    """Where the feet are, (n, 2, 3), m; NaN where not seen."""
    return np.stack([item.task.measured[:, on].mean(axis=1) for on in feet], axis=1)


def _assign_sides(like: WrenchFit, feet: _Feet) -> dict[str, int]:
    """Loaded plates, and which foot (0: right, 1: left) was on each for most of the time."""
    ground = like.contacts.ground
    apart = ground.centre_of_pressure()[:, :, None] - _locate_feet(like.tracked, feet)[:, None]
    distance = np.linalg.norm(apart[..., [0, 2]], axis=3)
    found = {}
    for k, plate in enumerate(ground.plates):
        known = np.isfinite(distance[:, k]).all(axis=1)
        if known.any():
            found[plate] = int(np.median(np.argmin(distance[known, k], axis=1)))
    return found


def _share_wrench(made: WrenchFit, feet: _Feet, sides: dict[str, int]) -> GroundForces:
    """What the movement needs, given by the plates under both feet, which read all the time."""
    need = made.needed
    force, moment = need[:, :3], need[:, 3:]
    centres = _locate_feet(made.tracked, feet)
    floor = np.array([0.0, float(centres[..., 1].min()), 0.0])
    about = moment - np.cross(floor, force)
    pressed = floor + np.cross(_UP, about) / force[:, 1:2]
    line = centres[:, 0] - centres[:, 1]
    right = np.einsum("na,na->n", pressed - centres[:, 1], line) / np.einsum("na,na->n", line, line)
    shares = np.stack([np.clip(right, 0.0, 1.0), 1.0 - np.clip(right, 0.0, 1.0)], axis=1)
    between = np.einsum("ns,nsa->na", shares, centres)
    free = moment - np.cross(pressed, force)
    on_side = [list(sides.values()).count(side) for side in range(len(_SIDES))]
    loads, moments, places = [], [], []
    for side in sides.values():
        share = shares[:, side, None] / on_side[side]
        place = centres[:, side] + pressed - between
        loads.append(share * force)
        moments.append(np.cross(place, share * force) + share * free)
        places.append(place.mean(axis=0))
    return GroundForces(
        name=made.name,
        times=made.times,
        plates=tuple(sides),
        force=np.stack(loads, axis=1),
        moment=np.stack(moments, axis=1),
        surfaces=np.array(places),
        normals=np.tile(_UP, (len(sides), 1)),
        read=np.ones((len(need), len(sides))),
    )
