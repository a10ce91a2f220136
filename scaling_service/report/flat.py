"""Two flat views of a scene as plain SVG: from the person's right and from the front."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from scaling_service.model.trial import Array
from scaling_service.report.palette import BONE, INK

if TYPE_CHECKING:
    from scaling_service.report.scene import Body, Scene

_SCALE = 400.0  # px per m; the whole is scaled to the page anyhow
_GAP = 60.0  # px between the views
_DOTS = 1500  # of each bone; chosen: a shape that is read, in 20 kB

_VIEWS = (("From the right", 0, 1.0), ("From the front", 2, -1.0))
"""Title, component across, its sign: seen from the front, the person's right is at the left."""


def flat_views(scene: Scene, frame: int) -> str:
    """Both views of the bodies shown at one frame."""
    shown = [body for body in scene.bodies if body.shown]
    bones = [_bone(scene, body, name, frame) for body in shown for name in body.bones]
    points = np.concatenate([scene.measured[frame], *(body.points[frame] for body in shown), *bones])
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    height = _SCALE * float(high[1] - low[1]) + 40.0
    offset, drawn = 20.0, []
    for title, across, sign in _VIEWS:
        first = float(low[across] if sign > 0 else -high[across])
        view = _View(across, sign, first, float(high[1]), offset)
        drawn.append(f'<text x="{offset:.0f}" y="14" font-size="13">{title}</text>')
        drawn += list(_measured(scene, frame, view))
        for body in shown:
            drawn += list(_body(scene, body, frame, view))
        offset += _SCALE * float(high[across] - low[across]) + _GAP
    return (
        f'<svg viewBox="0 0 {offset:.0f} {height:.0f}" role="img">'
        f"<title>{escape(scene.description)}</title>{''.join(drawn)}</svg>"
    )


class _View:
    """From points in space to places in the drawing."""

    def __init__(self, across: int, sign: float, first: float, top: float, offset: float) -> None:
        self.across, self.sign, self.first, self.top, self.offset = across, sign, first, top, offset

    def __call__(self, points: Array) -> Array:
        """Places (n, 2), px."""
        x = self.offset + _SCALE * (self.sign * points[:, self.across] - self.first)
        return np.stack([x, 24.0 + _SCALE * (self.top - points[:, 1])], axis=1)


def _measured(scene: Scene, frame: int, view: _View) -> Iterator[str]:
    yield _dots(view(scene.measured[frame]), INK, 5.0)


def _body(scene: Scene, body: Body, frame: int, view: _View) -> Iterator[str]:
    for name in body.bones:
        corners = _bone(scene, body, name, frame)
        yield _dots(view(corners[:: max(1, len(corners) // _DOTS)]), BONE, 2.0)
    places = view(body.points[frame])
    yield _lines(places, body.sticks, body.colour, 2.5)
    yield _lines(places, body.axes, body.colour, 1.5, dashed=True)
    yield _dots(places[[k for k, _ in body.centres]], body.colour, 7.0)
    theirs = view(scene.measured[frame])
    for point, _, measured in body.markers:
        ends = np.stack([places[point], theirs[measured]])
        yield _lines(ends, ((0, 1),), body.colour, 1.0)
        if np.isfinite(places[point]).all():
            x, y = places[point]
            yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.5" fill="none" stroke="{body.colour}"/>'


def _bone(scene: Scene, body: Body, name: str, frame: int) -> Array:
    """A bone's corners where they are in one frame, (n, 3), m."""
    pose = body.bones[name][frame]
    corners: Array = scene.surfaces[name].vertices @ pose[:9].reshape(3, 3).T + pose[9:]
    return corners


def _dots(places: Array, colour: str, size: float) -> str:
    path = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in places if np.isfinite(x + y))
    return f'<path d="{path}" stroke="{colour}" stroke-width="{size}" stroke-linecap="round"/>'


def _lines(
    places: Array, pairs: Iterable[tuple[int, int]], colour: str, width: float, *, dashed: bool = False
) -> str:
    path = "".join(
        f"M{places[a][0]:.1f} {places[a][1]:.1f}L{places[b][0]:.1f} {places[b][1]:.1f}"
        for a, b in pairs
        if np.isfinite(places[[a, b]]).all()
    )
    dashes = ' stroke-dasharray="5 3"' if dashed else ""
    return f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="{width}"{dashes}/>'
