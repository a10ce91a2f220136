"""OpenSim in the place of Pinocchio: the same steps of a recording, with a model from an ``.osim`` file."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

from tests.blind.body import Array, Body, Marker, Move, Segment, Vector
from tests.blind.engine import Poses
from tests.blind.motions.motion import RATE_HZ, rates
from tests.peers.worker import ask

_WORKER = "tests.blind.osim.worker"
_TIME_LIMIT_S = 300.0
COMPUTED = "HJC"
"""In the names of points that nobody stuck on: hip joint centres by regression."""


@dataclass(frozen=True)
class OsimBody(Body):
    """A body whose joints are those of a file; only what differs from the file is changed in it.

    Each segment has one move that stands for all of its joint in the file and names its coordinates;
    moves before and after it are new. ``scales`` are factors of whole segments.
    """

    file: Path = Path()
    scales: tuple[tuple[str, float], ...] = ()


@cache
def read_body(file: Path) -> OsimBody:
    """The body of an ``.osim`` file, as OpenSim reads it."""
    held = ask(_WORKER, {"task": "read", "model": str(file)})
    segments = tuple(
        Segment(
            body["name"], body["parent"], body["joint"], _vector(body["centre"]),
            (Move("turn", (0.0, 0.0, 0.0), tuple((c, 1.0) for c in body["coordinates"])),),
            body["mass"], _vector(body["com"]), _matrix(body["inertia"]),
        )
        for body in held["bodies"]
    )  # fmt: skip
    real = ((name, *place) for name, place in held["markers"].items() if COMPUTED not in name)
    markers = tuple(Marker(name, segment, _vector(at)) for name, segment, at in real)
    return OsimBody(file.stem, segments, markers, _vector(held["gravity"]), file)


def write_person(model: Path, factor: float, mass_kg: float, out: Path) -> None:
    """Write the model of a person of the same shape, ``factor`` times as tall and of this mass."""
    ask(
        _WORKER,
        {"task": "person", "model": str(model), "factor": factor, "mass_kg": mass_kg, "out": str(out)},
    )


class OsimEngine:
    """A body moved by OpenSim in a process of its own; frames are ``1 / RATE_HZ`` apart.

    Parameters
    ----------
    body : OsimBody
    """

    def __init__(self, body: Body) -> None:
        assert isinstance(body, OsimBody)
        self.body = body
        self.coordinates = body.coordinates

    def poses(self, q: Array) -> Poses:
        """Poses of all segments at coordinates ``q``, shape (n, k), rad and m."""
        found = self._moved(q)
        return Poses(
            tuple(s.name for s in self.body.segments), np.array(found["R"]), np.array(found["origin"])
        )

    def markers(self, poses: Poses) -> Array:
        """Marker positions in ground, shape (n, m, 3), m, at poses that this engine has given."""
        placed = [poses.point(m.segment, np.array(m.at)) for m in self.body.markers]
        return np.stack(placed, axis=1)

    def ground_wrench(self, q: Array, _qd: Array, _qdd: Array) -> Array:
        """What all contacts together must give, (n, 6): force, and moment about the ground origin; N, N m.

        The rate of the momentum, less the weight.
        """
        found = self._moved(q)
        centre, momentum = np.array(found["centre"]), np.array(found["momentum"])
        rate: Array = make_interp_spline(_times(q), momentum, k=5).derivative(1)(_times(q))
        weight = found["mass"] * np.array(self.body.gravity)
        rate[:, :3] -= weight
        rate[:, 3:] -= np.cross(centre, weight)
        return rate

    def _moved(self, q: Array) -> dict[str, Any]:
        added, changes = _changes(self.body)
        gains = np.array([[dict(m.gains).get(c, 0.0) for c in self.coordinates] for m in added])
        gains = gains.reshape(len(added), len(self.coordinates))
        own = [k for k, c in enumerate(self.coordinates) if c in read_body(self.body.file).coordinates]
        values = np.hstack([q[:, own], q @ gains.T + np.array([m.constant for m in added])])
        request = {
            "task": "move", "model": str(self.body.file), "changes": changes,
            "bodies": [s.name for s in self.body.segments],
            "coordinates": [*(self.coordinates[k] for k in own), *(f"added_{k}" for k in range(len(added)))],
            "q": values.tolist(), "qd": rates(_times(q), values)[1].tolist(),
        }  # fmt: skip
        return _asked(json.dumps(request))


@lru_cache(maxsize=1)
def _asked(request: str) -> dict[str, Any]:
    found: dict[str, Any] = ask(_WORKER, json.loads(request), time_limit_s=_TIME_LIMIT_S)
    return found


def _times(q: Array) -> Array:
    return np.arange(len(q)) / RATE_HZ


def _changes(body: OsimBody) -> tuple[list[Move], dict[str, Any]]:
    """The moves that the file does not have, and all that has to be changed in it."""
    added: list[Move] = []
    given = read_body(body.file)
    changes: dict[str, Any] = {"scales": dict(body.scales), "gravity": body.gravity}
    changes |= {"bodies": {}, "centres": {}, "moves": {}}
    for old, new in zip(given.segments, body.segments, strict=True):
        if (old.mass, old.com, old.inertia) != (new.mass, new.com, new.inertia):
            (xx, xy, xz), (_, yy, yz), (_, _, zz) = new.inertia
            changes["bodies"][new.name] = new.mass, new.com, (xx, yy, zz, xy, xz, yz)
        if old.centre != new.centre:
            changes["centres"][new.joint] = new.centre
        if old.moves != new.moves:
            at = new.moves.index(old.moves[0])
            sides = [_named(new.moves[:at], added), _named(new.moves[at + 1 :], added)]
            changes["moves"][new.joint] = sides
    return added, changes


def _named(moves: tuple[Move, ...], added: list[Move]) -> list[tuple[str, str, Vector]]:
    """Name, kind and axis of each; they are added to the list."""
    first = len(added)
    added += moves
    return [(f"added_{first + k}", move.kind, move.axis) for k, move in enumerate(moves)]


def _vector(values: list[float]) -> Vector:
    x, y, z = values
    return (x, y, z)


def _matrix(inertia: list[float]) -> tuple[Vector, Vector, Vector]:
    xx, yy, zz, xy, xz, yz = inertia
    return ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
