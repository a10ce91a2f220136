"""Pinocchio moves a body: where segments are, and which wrench the ground must give.

Pinocchio answers for one instant at a time, hence the loops over frames here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from tests.blind.body import GROUND, Array, Body, Move


@dataclass(frozen=True)
class Poses:
    """Where each segment is: ``R`` maps a segment's frame to ground, ``origin`` in ground.

    Parameters
    ----------
    segments : names, length k
    R : ndarray, shape (n, k, 3, 3)
    origin : ndarray, shape (n, k, 3), m
    """

    segments: tuple[str, ...]
    R: Array
    origin: Array

    def point(self, segment: str, at: Array) -> Array:
        """A point of a segment in ground, (n, 3), m; ``at`` is (3,) or (n, 3) in the segment's frame."""
        k = self.segments.index(segment)
        local = np.broadcast_to(np.asarray(at, dtype=float), (len(self.R), 3))
        return self.origin[:, k] + np.einsum("nij,nj->ni", self.R[:, k], local)

    def turned(self, segment: str, vectors: Array) -> Array:
        """Vectors (n, 3) of a segment's frame in ground."""
        turned: Array = np.einsum("nij,nj->ni", self.R[:, self.segments.index(segment)], vectors)
        return turned


class Engine:
    """A body compiled for Pinocchio.

    Parameters
    ----------
    body : Body
    """

    def __init__(self, body: Body) -> None:
        self.body = body
        self.coordinates = body.coordinates
        self.model = pin.Model()
        self.model.gravity = pin.Motion(np.array(body.gravity), np.zeros(3))
        self._rows: list[Array] = []
        self._offsets: list[float] = []
        self._places: dict[str, tuple[int, pin.SE3]] = {GROUND: (0, pin.SE3.Identity())}
        for segment in body.segments:
            joint, place = self._places[segment.parent]
            place = place * pin.SE3(np.eye(3), np.array(segment.centre))
            for k, move in enumerate(segment.moves):
                joint, place = self._add(f"{segment.joint}/{k}", joint, place, move)
            inertia = pin.Inertia(segment.mass, np.array(segment.com), np.array(segment.inertia))
            self.model.appendBodyToJoint(joint, inertia, place)
            self._places[segment.name] = (joint, place)
        self.data = self.model.createData()
        self._from_coordinates = np.array(self._rows)

    def _add(self, name: str, joint: int, place: pin.SE3, move: Move) -> tuple[int, pin.SE3]:
        axis = np.array(move.axis) / np.linalg.norm(move.axis)
        if not move.gains:
            return joint, place * _constant(move.kind, axis * move.constant)
        kinds = {"turn": pin.JointModelRevoluteUnaligned, "slide": pin.JointModelPrismaticUnaligned}
        row = np.zeros(len(self.coordinates))
        for coordinate, gain in move.gains:
            row[self.coordinates.index(coordinate)] += gain
        self._rows.append(row)
        self._offsets.append(move.constant)
        return self.model.addJoint(joint, kinds[move.kind](axis), place, name), pin.SE3.Identity()

    def values(self, q: Array) -> Array:
        """Values of the engine's own joints, (n, m), from coordinates (n, k)."""
        values: Array = q @ self._from_coordinates.T + np.array(self._offsets)
        return values

    def poses(self, q: Array) -> Poses:
        """Poses of all segments at coordinates ``q``, shape (n, k), rad and m."""
        names = tuple(s.name for s in self.body.segments)
        R = np.empty((len(q), len(names), 3, 3))
        origin = np.empty((len(q), len(names), 3))
        places = [self._places[name] for name in names]
        for n, values in enumerate(self.values(q)):
            pin.forwardKinematics(self.model, self.data, values)
            for k, (joint, place) in enumerate(places):
                here = self.data.oMi[joint] * place
                R[n, k], origin[n, k] = here.rotation, here.translation
        return Poses(names, R, origin)

    def markers(self, poses: Poses) -> Array:
        """Marker positions in ground, shape (n, m, 3), m."""
        placed = [poses.point(m.segment, np.array(m.at)) for m in self.body.markers]
        return np.stack(placed, axis=1)

    def ground_wrench(self, q: Array, qd: Array, qdd: Array) -> Array:
        """What all contacts together must give, (n, 6): force, and moment about the ground origin; N, N m."""
        values = self.values(q)
        rates, accelerations = qd @ self._from_coordinates.T, qdd @ self._from_coordinates.T
        result = np.empty((len(q), 6))
        for n in range(len(q)):
            pin.rnea(self.model, self.data, values[n], rates[n], accelerations[n])
            result[n] = self._first_place(values[n]).act(self.data.f[1]).vector
        return result

    def _first_place(self, values: Array) -> pin.SE3:
        """Where the first joint is: the root starts with a slide from the ground."""
        return pin.SE3(np.eye(3), self.model.jointPlacements[1].translation + self._root_axis * values[0])

    @property
    def _root_axis(self) -> Array:
        first = self.body.segments[0].moves[0]
        if first.kind != "slide":
            raise ValueError("the root's first move must be a slide")
        return np.array(first.axis)


def _constant(kind: str, vector: Array) -> pin.SE3:
    if kind == "turn":
        return pin.SE3(pin.exp3(vector), np.zeros(3))
    return pin.SE3(np.eye(3), vector)
