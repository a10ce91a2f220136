"""The pelvis: acetabula, ASIS, PSIS, pubis, with or without the sacrum."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from scaling_service.bones.fits import SphereOnBone, find_spheres, find_tip, place_sphere
from scaling_service.bones.results import BoneLandmarks, MeshRefused
from scaling_service.bones.surface import Surface, prepare

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SOCKET_RADII_M = (0.017, 0.036)  # a socket is 1-3 mm wider than the head in it

SOCKET_COVERED = 0.15  # least covered share of a socket's sphere: chosen, half of the usual 0.31-0.36

SOCKETS_APART_M = (0.11, 0.24)
"""Hip centres lie 174 (10) mm apart in adults (Puchaud 2019); a child's to a giant's."""

ALIKE = 1.2  # largest ratio of both sockets' radii: chosen, sides differ by 1-3 %

_SPINE_OUT, _PUBIS_IN = 0.85, 0.5
"""Where both ends of the anterior plane lie, as shares of half the distance between the sockets:
spines at 1.2-1.5, pubic tubercles at 0.2-0.4. Chosen between them."""

_TURNS = 4  # chosen: the frame turns by 5 degrees the first time, by less than 0.1 the third
_SIDES = (("r", 1.0), ("l", -1.0))

_SPINE_M = 0.025
"""How far an ASIS lies from where the anterior pelvic plane touches it at most: chosen, so that the inferior
spine, which lies further down and can reach as far forward, stays out."""

MOST_LEAN_DEG = 40.0
"""Largest angle between the line from PSIS to ASIS and the anterior plane's normal: chosen, five times the
3-8 degrees of three pelves."""

_SIZE_M = (0.15, 0.42)  # largest extent of both hip bones, a child's to a giant's


@dataclass(frozen=True, slots=True, kw_only=True)
class _Frame:
    """Anterior, up and right unit vectors of the anterior pelvic plane, the middle of the sockets, half."""

    x: Array
    y: Array
    z: Array
    middle: Array
    half: float


def find_pelvis_landmarks(vertices: Array, faces: NDArray[np.integer]) -> BoneLandmarks:
    """Landmarks of both hip bones of unknown orientation.

    ``vertices``: (n, 3), m. ``faces`` (m, 3): one piece or several; a sacrum may be among them. Returns
    points ``acetabulum_r/l``, ``asis_r/l``, ``psis_r/l``, ``pubic_tubercle_r/l`` and ``mid_asis``; spheres
    ``acetabulum_r/l``; axis ``asis`` from left to right. Raises MeshRefused: no two sockets, or no anterior
    plane.

    The sockets give the transverse axis. The anterior pelvic plane then is the one long edge of the
    outline, seen along that axis, that joins something lateral (the spines) to something central
    (the pubis); it says where forward and up are. ASIS and PSIS are
    the foremost and rearmost points of the ilia once they stand level with each other.
    """
    surface = prepare(vertices, faces)
    size = float(np.ptp(surface.points, axis=0).max())
    if not _SIZE_M[0] <= size <= _SIZE_M[1]:
        raise MeshRefused(
            f"it is {1e3 * size:.4g} mm wide; both hip bones have "
            f"{1e3 * _SIZE_M[0]:.0f}-{1e3 * _SIZE_M[1]:.0f} mm",
            remedy="Check the unit (mm or m), and that both hip bones are in the surface",
        )
    low, high = _find_sockets(surface)
    frame = _touch_plane(surface, _find_anterior_frame(surface, low, high))
    if float((high.centre - low.centre) @ frame.z) < 0:
        low, high = high, low
    points = {"acetabulum_r": high.centre, "acetabulum_l": low.centre}
    points |= _level_spines(surface, frame)
    points["mid_asis"] = 0.5 * (points["asis_r"] + points["asis_l"])
    _check(points, frame)
    across = points["asis_r"] - points["asis_l"]
    return BoneLandmarks(
        bone="pelvis",
        side=None,
        side_from="shape",
        points={name: surface.to_image(point) for name, point in points.items()},
        spheres={
            name: place_sphere(surface, ball, poor_cover=SOCKET_COVERED, good_cover=0.28)
            for name, ball in (("acetabulum_r", high), ("acetabulum_l", low))
        },
        axes={"asis": surface.turn_to_image(across / np.linalg.norm(across))},
        definitions=_DEFINITIONS,
        warnings=surface.notes,
    )


_DEFINITIONS = {
    "acetabulum_r": "centre of the least-squares sphere in the socket",
    "acetabulum_l": "centre of the least-squares sphere in the socket",
    "asis_r": "foremost point of the ilium, ASIS and PSIS level (Wu et al. 2002)",
    "asis_l": "foremost point of the ilium, ASIS and PSIS level (Wu et al. 2002)",
    "psis_r": "rearmost point of the ilium, ASIS and PSIS level (Wu et al. 2002)",
    "psis_l": "rearmost point of the ilium, ASIS and PSIS level (Wu et al. 2002)",
    "pubic_tubercle_r": "where the anterior pelvic plane touches the pubis",
    "pubic_tubercle_l": "where the anterior pelvic plane touches the pubis",
    "mid_asis": "midpoint of both ASIS",
}


def _find_sockets(surface: Surface) -> tuple[SphereOnBone, SphereOnBone]:
    """The best pair of hollow spheres of equal size at a pelvis's distance."""
    found = [s for s in find_spheres(surface, SOCKET_RADII_M, hollow=True) if s.covered >= SOCKET_COVERED]
    pairs = [
        (a, b)
        for a, b in combinations(found, 2)
        if SOCKETS_APART_M[0] <= np.linalg.norm(a.centre - b.centre) <= SOCKETS_APART_M[1]
        and max(a.radius, b.radius) <= ALIKE * min(a.radius, b.radius)
    ]
    if not pairs:
        raise MeshRefused(
            f"{len(found)} hollow spheres of a socket's size were found, but no pair of hip sockets",
            remedy="Give the surface of both hip bones, with or without the sacrum",
        )
    return max(pairs, key=lambda pair: min(pair[0].covered, pair[1].covered))


def _find_anterior_frame(surface: Surface, low: SphereOnBone, high: SphereOnBone) -> _Frame:
    middle = 0.5 * (low.centre + high.centre)
    z = high.centre - low.centre
    half = 0.5 * float(np.linalg.norm(z))
    z = z / (2.0 * half)
    first = np.linalg.svd(z[None, :])[2][1]
    plane = np.stack([first, np.cross(z, first)])
    flat = (surface.smooth - middle) @ plane.T
    out = np.abs((surface.smooth - middle) @ z) / half
    corners = ConvexHull(flat).vertices  # counter-clockwise
    best: tuple[float, int, int] | None = None
    for i, j in zip(corners, np.roll(corners, -1), strict=True):
        spine, pubis = (i, j) if out[i] > out[j] else (j, i)
        length = float(np.linalg.norm(flat[i] - flat[j]))
        joins = out[spine] > _SPINE_OUT and out[pubis] < _PUBIS_IN
        if joins and (best is None or length > best[0]):
            best = (length, int(spine), int(pubis))
    if best is None or best[0] < 0.4 * half:
        raise MeshRefused(
            "no plane touches both anterior spines and the pubis",
            remedy="Give whole hip bones; ilium and pubis must be in the surface",
        )
    _, spine, pubis = best
    y = flat[spine] - flat[pubis]
    y = y / np.linalg.norm(y)
    x = np.array([y[1], -y[0]])
    if float(x @ flat[spine]) < 0:  # the plane lies in front of the sockets
        x = -x
    forward, up = plane.T @ x, plane.T @ y
    return _Frame(x=forward, y=up, z=np.cross(forward, up), middle=middle, half=half)


def _touch_plane(surface: Surface, frame: _Frame) -> _Frame:
    """Turned until the plane touches the tips of spines and pubis, which single vertices do not move."""
    for _ in range(_TURNS):
        tips: dict[str, Array] = {}
        for side, sign in _SIDES:
            tips |= _find_plane_tips(surface, frame, side, sign)
        up = tips["asis_r"] + tips["asis_l"] - tips["pubic_tubercle_r"] - tips["pubic_tubercle_l"]
        frame = _turn_forward(frame, np.cross(up, frame.z))
    return frame


def _level_spines(surface: Surface, frame: _Frame) -> dict[str, Array]:
    """Pubic tubercles, and ASIS and PSIS once they stand level with each other (Wu et al. 2002).

    Raises MeshRefused: the line from PSIS to ASIS leans more than any pelvis's.
    """
    touching: dict[str, Array] = {}
    for side, sign in _SIDES:
        touching |= _find_plane_tips(surface, frame, side, sign)
    level, spines = frame, dict(touching)
    for _ in range(_TURNS):
        for side, sign in _SIDES:
            near = np.linalg.norm(surface.smooth - touching[f"asis_{side}"], axis=1) < _SPINE_M
            regions = _select_regions(surface, frame, sign)
            spines[f"asis_{side}"] = _find_furthest(surface, level.x, near & regions.ilium, "ASIS")
            spines[f"psis_{side}"] = _find_furthest(surface, -level.x, regions.rear, "PSIS")
        level = _turn_forward(
            frame, spines["asis_r"] + spines["asis_l"] - spines["psis_r"] - spines["psis_l"]
        )
        lean = float(np.rad2deg(np.arccos(np.clip(level.x @ frame.x, -1.0, 1.0))))
        if lean > MOST_LEAN_DEG:
            raise MeshRefused(
                f"the line from PSIS to ASIS leans by {lean:.0f} degrees off the anterior plane's normal",
                remedy="Give whole hip bones, not deformed",
            )
    return spines


def _turn_forward(frame: _Frame, forward: Array) -> _Frame:
    """The frame turned about the line of the sockets to face forward."""
    forward = forward - float(forward @ frame.z) * frame.z
    forward = forward / np.linalg.norm(forward)
    return _Frame(x=forward, y=np.cross(frame.z, forward), z=frame.z, middle=frame.middle, half=frame.half)


def _find_plane_tips(surface: Surface, frame: _Frame, side: str, sign: float) -> dict[str, Array]:
    """Where the anterior pelvic plane touches one side."""
    regions = _select_regions(surface, frame, sign)
    return {
        f"asis_{side}": _find_furthest(surface, frame.x, regions.ilium, "ASIS"),
        f"pubic_tubercle_{side}": _find_furthest(surface, frame.x, regions.pubis, "pubic tubercle"),
    }


class _Regions(NamedTuple):
    """Vertices of one side in which landmarks are looked for, each (n,)."""

    ilium: Mask
    pubis: Mask
    rear: Mask


def _select_regions(surface: Surface, frame: _Frame, sign: float) -> _Regions:
    """By places outwards, up and ahead of the middle of the sockets, as shares of half their distance."""
    offset = (surface.smooth - frame.middle) / frame.half
    out, height, ahead = sign * (offset @ frame.z), offset @ frame.y, offset @ frame.x
    return _Regions(
        ilium=(out > _SPINE_OUT) & (height > 0.2),
        pubis=(out > 0.0) & (out < _PUBIS_IN) & (height < 0.2),
        rear=(out > 0.2) & (out < 1.0) & (height > 0.0) & (ahead < 0.0),
    )


def _find_furthest(surface: Surface, direction: Array, within: Mask, name: str) -> Array:
    if int(within.sum()) < 10:
        raise MeshRefused(
            f"the part that holds the {name} is not in the surface", remedy="Give whole hip bones"
        )
    return find_tip(surface, direction, within)


def _check(points: dict[str, Array], frame: _Frame) -> None:
    """Refuses spines that no pelvis has: mirrored sides must nearly mirror."""
    for name in ("asis", "psis"):
        right, left = points[f"{name}_r"] - frame.middle, points[f"{name}_l"] - frame.middle
        uneven = abs(float((right + left) @ frame.z)), abs(float((right - left) @ frame.y))
        if max(uneven) > 0.35 * frame.half:  # chosen: 30 mm, five times what sides usually differ by
            raise MeshRefused(
                f"both {name.upper()} stand unevenly by {1e3 * max(uneven):.0f} mm",
                remedy="Give whole hip bones, not deformed",
            )
