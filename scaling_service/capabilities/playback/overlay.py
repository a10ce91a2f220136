"""Building blocks of pictures of moving models: what is drawn of a model, and where it stands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from scaling_service.model.anatomy.lengths import joint_centres, segment_of
from scaling_service.model.body import BodyModel, Marker, Segment, Vector, vector
from scaling_service.model.compile import compile_model, parameter_values
from scaling_service.model.poses import follow, model_values
from scaling_service.model.results import Array
from scaling_service.numerics.multibody.tree import marker_positions
from scaling_service.report.methods import words
from scaling_service.report.scene import Body, Pair, Scene

_AXIS_HALF_M = 0.07
"""Chosen: a knee axis is drawn a little wider than a knee."""


class Drawing:
    """Points of a model that are drawn, and how they hang together."""

    def __init__(self, model: BodyModel) -> None:
        self._model = model
        self._points: list[Marker] = []
        self.markers: dict[str, int] = {}
        centres = joint_centres(model)
        self.centres = {name: self._add(segment, at) for name, (segment, at) in centres.items()}
        origins = {s.name: self._add(s.name, (0.0, 0.0, 0.0)) for s in model.segments}
        carried = {segment for segment, _ in centres.values()} | {m.segment for m in model.markers}
        drawn = _drawn(model, carried)
        self.sticks: list[Pair] = [
            (origins[s.parent], origins[s.name])
            for s in model.segments
            if s.parent in drawn and s.name in drawn
        ]
        self.sticks += [
            (origins[segment], self.centres[name])
            for name, (segment, _) in centres.items()
            if not any(child.name in drawn for child in model.children(segment))
        ]
        if {"hip_r", "hip_l"} <= set(centres):
            self.sticks.append((self.centres["hip_r"], self.centres["hip_l"]))
        self.axes: list[Pair] = [
            (self._add(segment, ends[0]), self._add(segment, ends[1]))
            for segment, ends in knee_axes(model).items()
        ]

    def _add(self, segment: str, at: Vector) -> int:
        self._points.append(Marker.at(f"point {len(self._points)}", segment, at))
        return len(self._points) - 1

    def add_marker(self, name: str) -> None:
        """One of the model's own markers."""
        self.markers[name] = len(self._points)
        self._points.append(replace(self._model.marker(name), name=f"point {len(self._points)}"))

    def positions(self, q: Array) -> Array:
        """(n_frames, n_points, 3), m."""
        return place_points(self._model, tuple(self._points), q)


def draw_body(
    name: str,
    colour: str,
    model: BodyModel,
    q: Array,
    markers: Sequence[str],
    labels: Sequence[str],
    bones: Mapping[str, Array] = MappingProxyType({}),
    *,
    shown: bool = True,
) -> Body:
    """A model as drawn over frames q, (n_frames, n_coordinates).

    ``markers``, ``labels``: the model's markers to draw, and those that were measured.
    ``bones``: surface to where it is, (n_frames, 12); see :class:`Body`.
    """
    drawing = Drawing(model)
    for marker in markers:
        drawing.add_marker(marker)
    return Body(
        name,
        colour,
        drawing.positions(q),
        centres=[(k, words(centre)) for centre, k in drawing.centres.items()],
        sticks=drawing.sticks,
        axes=drawing.axes,
        markers=[(k, marker, labels.index(marker)) for marker, k in drawing.markers.items()],
        bones=bones,
        shown=shown,
    )


def _drawn(model: BodyModel, carried: set[str]) -> set[str]:
    """Segments that carry a marker or a joint centre, or lead to one that does."""
    found: set[str] = set()
    for segment in reversed(model.segments):
        if segment.name in carried or any(child.name in found for child in model.children(segment.name)):
            found.add(segment.name)
    return found


def knee_axes(model: BodyModel) -> dict[str, tuple[Vector, Vector]]:
    """Thigh to both ends of its knee's axis in its frame, m, with the knee straight; hinges only."""
    found = {}
    for side in ("r", "l", ""):
        thigh, shank = (segment_of(model, role, side) for role in ("femur", "tibia"))
        if thigh is not None and shank is not None and model.segment(shank).parent == thigh:
            axis = _first_axis(model, model.segment(shank))
            if axis is not None:
                centre, direction = axis
                ends = (centre - _AXIS_HALF_M * direction, centre + _AXIS_HALF_M * direction)
                found[thigh] = (vector(ends[0]), vector(ends[1]))
    return found


def _first_axis(model: BodyModel, segment: Segment) -> tuple[Array, Array] | None:
    """Where, and along which direction, the first driven turn of a joint acts in the parent's frame."""
    values = model_values(model)
    for k, joint in enumerate(segment.joints):
        if joint.kind == "rotation" and any(term.coordinate is not None for term in joint.law.terms):
            rotation, origin = follow(segment.joints[:k], values)
            return origin, rotation @ np.asarray(joint.axis)
    return None


def place_points(model: BodyModel, points: tuple[Marker, ...], q: Array) -> Array:
    """Points of segments in ground, (n_frames, n_points, 3), m."""
    carrier = model.with_markers(points)
    placed: Array = marker_positions(compile_model(carrier), q, parameter_values(carrier))
    return placed


def follow_person(scene: Scene) -> Scene:
    """Seen from a point that goes along: the measured markers' centre stays above one place of the floor."""
    centre = _filled(
        np.array(
            [
                np.nanmean(frame, axis=0) if np.isfinite(frame).any() else [np.nan] * 3
                for frame in scene.measured
            ]
        )
    )
    shift = centre * [1.0, 0.0, 1.0]

    def moved(bones: Mapping[str, Array]) -> dict[str, Array]:
        still = np.zeros((len(shift), 9))
        return {name: pose - np.concatenate([still, shift], axis=1) for name, pose in bones.items()}

    return replace(
        scene,
        measured=scene.measured - shift[:, None],
        bodies=[replace(b, points=b.points - shift[:, None], bones=moved(b.bones)) for b in scene.bodies],
    )


def _filled(path: Array) -> Array:
    """Frames that show nothing take the nearest known values, linearly between."""
    known = np.isfinite(path).all(axis=1)
    rows = np.arange(len(path))
    return np.stack([np.interp(rows, rows[known], path[known, k]) for k in range(3)], axis=1)
