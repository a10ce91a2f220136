"""The overlay: several models of a person in one space over time, with what was measured and bones."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from scaling_service.model.trial import Array, Bone
from scaling_service.report.figures import to_data
from scaling_service.report.methods import BONE, INK

_SCALE = 400.0  # px per m; the whole is scaled to the page anyhow
_GAP = 60.0  # px between the views
_DOTS = 1500  # of each bone; chosen: a shape that is read, in 20 kB

_VIEWS = (("From the right", 0, 1.0), ("From the front", 2, -1.0))
"""Title, component across, its sign: seen from the front, the person's right is at the left."""


Pair = tuple[int, int]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Body:
    """One model as drawn.

    ``points`` ((n_frames, n_points, 3), m): in the laboratory: X forward, Y up, Z right. NaN where a frame
        does not determine a point.
    ``centres``: joint centres.
    ``sticks``, ``axes``: segments, and the axes of joints.
    ``markers``: the model's markers, and the place of each among the measured ones.
    ``bones``: surface to where it is: (n_frames, 12), the rotation by rows, then the origin, m.
    ``shown``: whether it is seen at first.
    """

    name: str
    colour: str
    points: Array
    centres: Sequence[tuple[int, str]] = ()
    sticks: Sequence[Pair] = ()
    axes: Sequence[Pair] = ()
    markers: Sequence[tuple[int, str, int]] = ()
    bones: Mapping[str, Array] = field(default_factory=dict)
    shown: bool = True


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Scene:
    """A block that shows bodies in space; two flat views stand in for it on paper and without WebGL.

    ``times``: (n_frames,), s.
    ``measured``: (n_frames, n_labels, 3), m.
    ``surfaces``: name to a surface in a frame of its own; at most 65,536 corners each.
    ``rate_hz``: frames shown per second when played.
    """

    caption: str
    description: str
    times: Array
    labels: Sequence[str]
    measured: Array
    bodies: Sequence[Body]
    surfaces: Mapping[str, Bone] = field(default_factory=dict)
    rate_hz: float = 12.0

    def html(self) -> str:
        """One ``figure`` with its controls, its data and its flat views."""
        middle = len(self.times) // 2
        return (
            f'<figure class="scene"><figcaption>{escape(self.caption)}</figcaption>{self._controls(middle)}'
            f'<div class="stage" role="img" aria-label="{escape(self.description)}"></div>'
            f'<div class="flat">{draw_flat_views(self, middle)}'
            f'<p class="note">At {self.times[middle]:.2f} s.</p></div>{to_data(self._data())}</figure>'
        )

    def _controls(self, middle: int) -> str:
        methods = "".join(
            f'<label><input type="checkbox" data-method="{escape(body.name)}"{_mark_checked(body.shown)}>'
            f'<i class="chip" style="background:{escape(body.colour)}"></i>{escape(body.name)}</label>'
            for body in self.bodies
        )
        kinds = [("gaps", "lines to measured markers", True), ("axes", "knee axes", True)]
        if self.surfaces:
            kinds.insert(0, ("bones", "bones", True))
        parts = "".join(
            f'<label><input type="checkbox" data-kind="{kind}"{_mark_checked(on)}>{name}</label>'
            for kind, name, on in kinds
        )
        views = "".join(
            f'<button type="button" data-view="{view}">{name}</button>'
            for view, name in (
                ("oblique", "Oblique"),
                ("right", "From the right"),
                ("front", "From the front"),
            )
        )
        return (
            f'<div class="controls"><fieldset><legend>Models</legend>{methods}</fieldset></div>'
            f'<div class="controls"><fieldset><legend>Show</legend>{parts}</fieldset>{views}</div>'
            '<div class="controls"><button type="button" data-play>Play</button>'
            f'<input type="range" min="0" max="{len(self.times) - 1}" value="{middle}" aria-label="Frame">'
            "<output></output></div>"
        )

    def _data(self) -> dict[str, Any]:
        return {
            "times": [round(float(t), 4) for t in self.times],
            "pause_ms": round(1e3 / self.rate_hz),
            "ink": INK,
            "bone": BONE,
            "measured": {"labels": [escape(label) for label in self.labels], "points": pack(self.measured)},
            "methods": [_encode_body(body) for body in self.bodies],
            "bones": {name: _encode_surface(surface) for name, surface in self.surfaces.items()},
            "box": self._box(),
            "floor": self._floor(),
        }

    def _limits(self) -> tuple[Array, Array]:
        """The corners of what is seen over all frames, with some room around, (3,) each, m."""
        points = [self.measured.reshape(-1, 3), *(body.points.reshape(-1, 3) for body in self.bodies)]
        points += [
            _bound_surface(self.surfaces[name], pose) for b in self.bodies for name, pose in b.bones.items()
        ]
        seen = np.concatenate(points)
        return np.nanmin(seen, axis=0) - 0.05, np.nanmax(seen, axis=0) + 0.05

    def _box(self) -> dict[str, list[float]]:
        low, high = self._limits()
        return {
            "x": [float(low[0]), float(high[0])],
            "y": [float(-high[2]), float(-low[2])],
            "z": [float(min(low[1], self._ground())) - 0.01, float(high[1])],
        }

    def _ground(self) -> float:
        """The laboratory's floor, if the lowest point is near it; else that point."""
        lowest = float(self._limits()[0][1])
        return 0.0 if -0.1 < lowest < 0.3 else lowest

    def _floor(self) -> dict[str, list[float | None]]:
        """A grid on the floor, lines 25 cm apart."""
        low, high = self._limits()
        xs, ys = _choose_ticks(low[0], high[0]), _choose_ticks(-high[2], -low[2])
        lines = [((x, ys[0]), (x, ys[-1])) for x in xs] + [((xs[0], y), (xs[-1], y)) for y in ys]
        x: list[float | None] = []
        y: list[float | None] = []
        for start, end in lines:
            x += [start[0], end[0], None]
            y += [start[1], end[1], None]
        ground = self._ground()
        return {"x": x, "y": y, "z": [None if v is None else ground for v in x]}


def pack(values: Array) -> str:
    """Numbers as base64 of 32 bit floats: 0.1 µm at 1 m."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()


def _encode_indices(values: NDArray[np.integer[Any]]) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype="<u2").tobytes()).decode()


def _encode_surface(surface: Bone) -> dict[str, str]:
    if len(surface.vertices) > 2**16:
        raise ValueError("a surface within a page has at most 65,536 corners: coarsen it first")
    return {"vertices": pack(surface.vertices), "faces": _encode_indices(surface.faces)}


def _encode_body(body: Body) -> dict[str, Any]:
    return {
        "name": body.name,
        "colour": body.colour,
        "count": body.points.shape[1],
        "points": pack(body.points),
        "centres": [[k, escape(label)] for k, label in body.centres],
        "sticks": [list(pair) for pair in body.sticks],
        "axes": [list(pair) for pair in body.axes],
        "markers": [[k, escape(label), measured] for k, label, measured in body.markers],
        "bones": [{"name": name, "pose": pack(pose)} for name, pose in body.bones.items()],
    }


def _bound_surface(surface: Bone, poses: Array) -> Array:
    """The corners of the box around a surface in every frame, (8 n_frames, 3), m."""
    ends = np.stack([surface.vertices.min(axis=0), surface.vertices.max(axis=0)])
    corners = np.stack(np.meshgrid(*ends.T, indexing="ij"), axis=-1).reshape(-1, 3)
    rotations, origins = poses[:, :9].reshape(-1, 3, 3), poses[:, 9:]
    return (corners @ np.transpose(rotations, (0, 2, 1)) + origins[:, None]).reshape(-1, 3)


def _choose_ticks(low: float, high: float) -> list[float]:
    step = 0.25
    first, last = int(np.floor(low / step)), int(np.ceil(high / step))
    return [step * k for k in range(first, last + 1)]


def _mark_checked(on: bool) -> str:
    return " checked" if on else ""


def draw_flat_views(scene: Scene, frame: int) -> str:
    """Both views of the bodies shown at one frame."""
    shown = [body for body in scene.bodies if body.shown]
    bones = [_place_bone(scene, body, name, frame) for body in shown for name in body.bones]
    points = np.concatenate([scene.measured[frame], *(body.points[frame] for body in shown), *bones])
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    height = _SCALE * float(high[1] - low[1]) + 40.0
    offset, drawn = 20.0, []
    for title, across, sign in _VIEWS:
        first = float(low[across] if sign > 0 else -high[across])
        view = _view(across, sign, first, float(high[1]), offset)
        drawn.append(f'<text x="{offset:.0f}" y="14" font-size="13">{title}</text>')
        drawn.append(_encode_dots(view(scene.measured[frame]), INK, 5.0))
        for body in shown:
            drawn += list(_draw_body(scene, body, frame, view))
        offset += _SCALE * float(high[across] - low[across]) + _GAP
    return (
        f'<svg viewBox="0 0 {offset:.0f} {height:.0f}" role="img">'
        f"<title>{escape(scene.description)}</title>{''.join(drawn)}</svg>"
    )


def _view(across: int, sign: float, first: float, top: float, offset: float) -> Callable[[Array], Array]:
    """From points in space, (n, 3), m, to places in the drawing, (n, 2), px."""
    return lambda points: np.stack(
        [offset + _SCALE * (sign * points[:, across] - first), 24.0 + _SCALE * (top - points[:, 1])], axis=1
    )


def _draw_body(scene: Scene, body: Body, frame: int, view: Callable[[Array], Array]) -> Iterator[str]:
    for name in body.bones:
        corners = _place_bone(scene, body, name, frame)
        yield _encode_dots(view(corners[:: max(1, len(corners) // _DOTS)]), BONE, 2.0)
    places = view(body.points[frame])
    yield _encode_lines(places, body.sticks, body.colour, 2.5)
    yield _encode_lines(places, body.axes, body.colour, 1.5, dashed=True)
    yield _encode_dots(places[[k for k, _ in body.centres]], body.colour, 7.0)
    theirs = view(scene.measured[frame])
    for point, _, measured in body.markers:
        ends = np.stack([places[point], theirs[measured]])
        yield _encode_lines(ends, ((0, 1),), body.colour, 1.0)
        if np.isfinite(places[point]).all():
            x, y = places[point]
            yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.5" fill="none" stroke="{body.colour}"/>'


def _place_bone(scene: Scene, body: Body, name: str, frame: int) -> Array:
    """A bone's corners where they are in one frame, (n, 3), m."""
    pose = body.bones[name][frame]
    corners: Array = scene.surfaces[name].vertices @ pose[:9].reshape(3, 3).T + pose[9:]
    return corners


def _encode_dots(places: Array, colour: str, size: float) -> str:
    path = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in places if np.isfinite(x + y))
    return f'<path d="{path}" stroke="{colour}" stroke-width="{size}" stroke-linecap="round"/>'


def _encode_lines(
    places: Array, pairs: Iterable[tuple[int, int]], colour: str, width: float, *, dashed: bool = False
) -> str:
    path = "".join(
        f"M{places[a][0]:.1f} {places[a][1]:.1f}L{places[b][0]:.1f} {places[b][1]:.1f}"
        for a, b in pairs
        if np.isfinite(places[[a, b]]).all()
    )
    dashes = ' stroke-dasharray="5 3"' if dashed else ""
    return f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="{width}"{dashes}/>'


MOST_FACES = 4000
"""Chosen: a bone keeps its shape at the size of a screen, and takes 0.1 MB of the page."""


def coarsen(bone: Bone, most_faces: int = MOST_FACES) -> Bone:
    """A surface of fewer triangles, by collapsing edges where it hardly changes (VTK's quadric decimation).

    Thin plates such as the wing of a pelvis keep both of their sides. For pictures, not for measuring.

    ``most_faces``: about the number left; a surface that has no more stays as it is.

    Examples
    --------
    >>> import numpy as np
    >>> flat = Bone(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    >>> coarsen(flat).faces.shape
    (1, 3)
    """
    count = len(bone.faces)
    if count <= most_faces:
        return bone
    import pyvista  # only here: it takes half a second and 80 MB, which who shows no bones should not pay

    # STL files repeat each corner in every triangle; only shared edges can be collapsed.
    merged = trimesh.Trimesh(bone.vertices, bone.faces)
    merged.update_faces(merged.nondegenerate_faces())
    surface = pyvista.PolyData.from_regular_faces(merged.vertices, np.asarray(merged.faces, dtype=int))
    reduced = surface.decimate(1.0 - most_faces / count)
    return Bone(np.asarray(reduced.points, dtype=np.float64), np.asarray(reduced.regular_faces))
