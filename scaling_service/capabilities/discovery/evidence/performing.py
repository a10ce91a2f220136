"""The body of a recording in another movement, as its markers and plates would show it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.evidence.movements import RATE_HZ, coordinates_of
from scaling_service.capabilities.discovery.evidence.watched import Watched
from scaling_service.capabilities.discovery.evidence.weighed import Footing, Weighed
from scaling_service.capabilities.discovery.laws.contact_points import FEET
from scaling_service.model.forces import GroundForces
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import marker_positions
from scaling_service.numerics.signals.filters import butterworth

_UP = np.array([0.0, 1.0, 0.0])
_STEP_M, _SAME = 0.1, 1e-6
_SMOOTH_HZ = 3.0  # chosen: which foot is the lowest changes at once, the pelvis does not
_SIDES = ("_r", "_l")


def performed(like: Watched, movement: str) -> Watched | None:
    """The same markers on the same body in another movement; None if it has none of its coordinates."""
    q = coordinates_of(like.task.model, movement)
    return None if q is None else _moving(like, q, movement)


def performed_on_plates(like: Weighed, movement: str) -> Weighed | None:
    """The same body with its feet on plates, which measure what the movement needs.

    Each plate lies under the foot that it was under in the recording; the feet share the load as the centre
    of pressure lies between them. None where the body has no two feet, or the plates no foot.
    """
    item = performed(like.item, movement)
    feet = _feet(like.item)
    if item is None or feet is None:
        return None
    sides = _sides(like, feet)
    if not sides:
        return None
    item = _moving(item, _grounded(item, feet), movement)
    made = replace(
        like,
        item=item,
        footing=replace(like.footing, usable=np.ones(len(item.q), dtype=bool)),
        swinging=(),
        touched=None,
        known_covariance=like.covariance,
    )
    ground = _shared(made, feet, sides)
    return replace(made, footing=Footing(ground, made.footing.usable, like.cutoff_hz))


def _moving(like: Watched, q: Array, movement: str) -> Watched:
    times: Array = np.arange(len(q)) / RATE_HZ
    places = marker_positions(like.task.tree, q, like.task.p)
    trial = Trial(movement, times, like.markers, places, RATE_HZ)
    return replace(like, trial=trial, role="fit", task=replace(like.task, measured=places), q=q)


def _feet(item: Watched) -> tuple[NDArray[np.intp], NDArray[np.intp]] | None:
    """Columns of the markers of the right and of the left foot."""
    found = []
    for side in _SIDES:
        segments = [item.task.model.marker(m).segment for m in item.markers]
        on = [k for k, name in enumerate(segments) if name.startswith(FEET) and name.endswith(side)]
        found.append(np.array(on, dtype=np.intp))
    return (found[0], found[1]) if len(found[0]) and len(found[1]) else None


def _centres(item: Watched, feet: tuple[NDArray[np.intp], NDArray[np.intp]]) -> Array:
    """Where the feet are, (n, 2, 3), m; NaN where not seen."""
    return np.stack([item.task.measured[:, on].mean(axis=1) for on in feet], axis=1)


def _sides(like: Weighed, feet: tuple[NDArray[np.intp], NDArray[np.intp]]) -> dict[str, int]:
    """Loaded plates, and which foot (0: right, 1: left) was on each for most of the time."""
    ground = like.footing.ground
    apart = ground.centre_of_pressure()[:, :, None] - _centres(like.item, feet)[:, None]
    distance = np.linalg.norm(apart[..., [0, 2]], axis=3)
    found = {}
    for k, plate in enumerate(ground.plates):
        known = np.isfinite(distance[:, k]).all(axis=1)
        if known.any():
            found[plate] = int(np.median(np.argmin(distance[known, k], axis=1)))
    return found


def _grounded(item: Watched, feet: tuple[NDArray[np.intp], NDArray[np.intp]]) -> Array:
    """The coordinates with the lower foot kept on the floor; as they are where the root does not travel."""
    task, q = item.task, item.q.copy()
    height = _centres(item, feet)[:, :, 1].min(axis=1)
    smooth = butterworth(height, rate_hz=RATE_HZ, cutoff_hz=_SMOOTH_HZ, order=4).values
    for k, coordinate in enumerate(task.model.coordinates):
        if coordinate.kind == "translation":
            moved = q[:1].copy()
            moved[0, k] += _STEP_M
            lifted = marker_positions(task.tree, moved, task.p) - task.measured[:1]
            if np.abs(lifted - _STEP_M * _UP).max() < _SAME:
                q[:, k] -= smooth - smooth[0]
                break
    return q


def _shared(
    made: Weighed, feet: tuple[NDArray[np.intp], NDArray[np.intp]], sides: dict[str, int]
) -> GroundForces:
    """What the movement needs, given by the plates under both feet, which read all the time."""
    need = made.needed[0]
    force, moment = need[:, :3], need[:, 3:]
    centres = _centres(made.item, feet)
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
        made.name,
        made.times,
        tuple(sides),
        np.stack(loads, axis=1),
        np.stack(moments, axis=1),
        np.array(places),
        np.tile(_UP, (len(sides), 1)),
        read=np.ones((len(need), len(sides))),
    )
