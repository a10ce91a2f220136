"""Segments that are heavier, balanced elsewhere, or carry something."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from scaling_service.capabilities.discovery.effects._columns import MM
from scaling_service.capabilities.discovery.effects.catalogue import Effect
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column, Estimate
from scaling_service.capabilities.discovery.laws.loads import (
    Inertial,
    differentiate_centre,
    differentiate_load,
    scale_segment,
)
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.laws.spots import LETTERS
from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel
from scaling_service.model.poses import pose_neutral_frames

_MOMENT_KGMM = 1e4  # chosen: some 10 kg at the reach of an arm
_REACH_M = 1.0  # chosen: an arm holds a load 0.7 m from the middle of the trunk


def propose_segment_masses(scene: Scene) -> Iterator[Candidate]:
    """Every segment with mass, its inertia in proportion."""
    for segment in scene.heavy:
        column = Column(name="kg", unit=1.0, load=scale_segment(segment))
        yield Candidate("segment_mass", (segment.name,), (column,))


def propose_centres_of_mass(scene: Scene) -> Iterator[Candidate]:
    """Every segment with mass."""
    for segment in scene.heavy:
        columns = tuple(
            Column(
                name=f"{letter}_mm", unit=MM, load=Inertial(segment.name, differentiate_centre(segment, k))
            )
            for k, letter in enumerate(LETTERS)
        )
        yield Candidate("segment_com", (segment.name,), columns)


def propose_carried_loads(scene: Scene) -> Iterator[Candidate]:
    """Every segment: a mass, and first moments about its origin that say where it is."""
    near = make_nearest_bone_test(scene.model)
    names = (("kg", 1.0, 0.0), *((f"{axis}_kgmm", 1e3, _MOMENT_KGMM) for axis in LETTERS))
    for segment in scene.heavy:
        columns = tuple(
            Column(name=name, unit=scale, load=Inertial(segment.name, change), low=-most, high=most)
            for (name, scale, most), change in zip(names, differentiate_load(segment), strict=True)
        )
        yield Candidate("carried_load", (segment.name,), columns, together=near(segment.name))


def is_within_reach(size: Array) -> bool:
    """Whether a load (mass, first moments) hangs within reach of its segment."""
    return bool(np.linalg.norm(size[1:]) <= _REACH_M * abs(size[0]))


def make_nearest_bone_test(model: BodyModel) -> Callable[[str], Callable[[Array], bool]]:
    """By segment, whether a load (mass, first moments) is in reach and no nearer to the neighbours' bones.

    A bone runs from its joint to those that it carries, or twice as far as its centre of mass. The model
    stands in its neutral pose.
    """
    frames, bones = pose_neutral_frames(model), {}
    for s in model.segments:
        R, origin = frames[s.name]
        ends = [frames[child.name][1] for child in model.children(s.name)] or [
            origin + R @ np.multiply(2.0, s.com)
        ]
        bones[s.name] = np.array([(origin, end) for end in ends])

    def of(name: str) -> Callable[[Array], bool]:
        segment, (R, origin) = model.segment(name), frames[name]
        beside = [bones[s] for s in (segment.parent, *(c.name for c in model.children(name))) if s in bones]

        def is_near(size: Array) -> bool:
            if not is_within_reach(size) or not size[0]:
                return False
            place = origin + R @ (size[1:] / size[0])
            return _measure_distance(place, bones[name]) <= min(
                (_measure_distance(place, b) for b in beside), default=np.inf
            )

        return is_near

    return of


def _measure_distance(place: Array, lines: Array) -> float:
    """From the nearest of some lines from point to point, (n, 2, 3), m."""
    start, way = lines[:, 0], lines[:, 1] - lines[:, 0]
    share = np.einsum("ni,ni->n", place - start, way) / np.maximum(np.square(way).sum(axis=1), 1e-12)
    return float(np.linalg.norm(start + np.clip(share, 0.0, 1.0)[:, None] * way - place, axis=1).min())


def _place_of_load(effect: Estimate, _after: Fit) -> Mapping[str, float]:
    mass = float(effect.size[0])
    place = effect.size[1:] / mass * 1e3 if mass else np.zeros(3)
    return dict(zip(("x_mm", "y_mm", "z_mm"), place.tolist(), strict=True))


EFFECTS = (
    Effect("segment_mass", "the segment is heavier or lighter, of the same shape", propose_segment_masses),
    Effect("segment_com", "the segment's centre of mass lies elsewhere", propose_centres_of_mass),
    Effect(
        "carried_load", "the segment carries a load at a point", propose_carried_loads, details=_place_of_load
    ),
)
