"""The pelvis: acetabula, ASIS, PSIS, pubis, with or without the sacrum."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from scaling_service.landmarking.refusals import MeshRefused
from scaling_service.landmarking.results import BoneLandmarks, Quality, Sphere, confidence
from scaling_service.landmarking.spheres import SphereOnBone, spheres
from scaling_service.landmarking.surface import Surface, prepare
from scaling_service.landmarking.tips import tip

Array = NDArray[np.float64]

SOCKET_RADII_M = (0.017, 0.036)
"""A socket is 1-3 mm wider than the head in it."""

SOCKET_COVERED = 0.15
"""Least covered share of a socket's sphere: chosen, half of the usual 0.31-0.36."""

SOCKETS_APART_M = (0.11, 0.24)
"""Hip centres lie 174 (10) mm apart in adults (Puchaud 2019); a child's to a giant's."""

ALIKE = 1.2
"""Largest ratio of both sockets' radii: chosen, sides differ by 1-3 %."""

_SPINE_OUT, _PUBIS_IN = 0.85, 0.5
"""Where both ends of the anterior plane lie, as shares of half the distance between the sockets:
spines at 1.2-1.5, pubic tubercles at 0.2-0.4. Chosen between them."""

_TURNS = 4  # chosen: the frame turns by 5 degrees the first time, by less than 0.1 the third
_SIZE_M = (0.15, 0.42)  # largest extent of both hip bones, a child's to a giant's


@dataclass(frozen=True, slots=True)
class _Frame:
    """Anterior, up and right unit vectors of the anterior pelvic plane, the middle of the sockets, half."""

    x: Array
    y: Array
    z: Array
    middle: Array
    half: float


def pelvis_landmarks(vertices: Array, faces: NDArray[np.integer]) -> BoneLandmarks:
    """Landmarks of both hip bones of unknown orientation.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3), m
    faces : ndarray of int, shape (m, 3)
        One piece or several; a sacrum may be among them.

    Returns
    -------
    BoneLandmarks
        Points ``acetabulum_r/l``, ``asis_r/l``, ``psis_r/l``, ``pubic_tubercle_r/l`` and ``mid_asis``;
        spheres ``acetabulum_r/l``; axis ``asis`` from left to right.

    Raises
    ------
    MeshRefused
        No two sockets, or no anterior plane.

    Notes
    -----
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
    low, high = _sockets(surface)
    frame = _anterior_frame(surface, low, high)
    if float((high.centre - low.centre) @ frame.z) < 0:
        low, high = high, low
    points = {"acetabulum_r": high.centre, "acetabulum_l": low.centre}
    level, spines = frame, dict[str, Array]()
    for _ in range(_TURNS):
        for side, sign in (("r", 1.0), ("l", -1.0)):
            spines |= _spines(surface, frame, level, side, sign)
        level = _levelled(frame, spines)
    points |= spines
    points["mid_asis"] = 0.5 * (points["asis_r"] + points["asis_l"])
    _check(points, frame)
    across = points["asis_r"] - points["asis_l"]
    return BoneLandmarks(
        bone="pelvis",
        side=None,
        side_from="shape",
        points={name: surface.to_image(point) for name, point in points.items()},
        spheres={
            "acetabulum_r": _sphere(surface, high),
            "acetabulum_l": _sphere(surface, low),
        },
        axes={"asis": surface.turned(across / np.linalg.norm(across))},
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


def _sockets(surface: Surface) -> tuple[SphereOnBone, SphereOnBone]:
    """The best pair of hollow spheres of equal size at a pelvis's distance."""
    found = [s for s in spheres(surface, SOCKET_RADII_M, hollow=True) if s.covered >= SOCKET_COVERED]
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


def _anterior_frame(surface: Surface, low: SphereOnBone, high: SphereOnBone) -> _Frame:
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
    return _Frame(forward, up, np.cross(forward, up), middle, half)


def _levelled(frame: _Frame, spines: dict[str, Array]) -> _Frame:
    """Forward is from the PSIS to the ASIS, across the line of the sockets (Wu et al. 2002)."""
    forward = spines["asis_r"] + spines["asis_l"] - spines["psis_r"] - spines["psis_l"]
    forward = forward - float(forward @ frame.z) * frame.z
    forward = forward / np.linalg.norm(forward)
    return _Frame(forward, np.cross(frame.z, forward), frame.z, frame.middle, frame.half)


def _spines(surface: Surface, frame: _Frame, level: _Frame, side: str, sign: float) -> dict[str, Array]:
    offset = surface.smooth - frame.middle
    along, height, ahead = sign * (offset @ frame.z), offset @ frame.y, offset @ frame.x
    ilium = (along > _SPINE_OUT * frame.half) & (height > 0.2 * frame.half)
    pubis = (along > 0.0) & (along < _PUBIS_IN * frame.half) & (height < 0.2 * frame.half)
    rear = (along > 0.2 * frame.half) & (along < frame.half) & (height > 0.0) & (ahead < 0.0)
    return {
        f"asis_{side}": _furthest(surface, level.x, ilium, "ASIS"),
        f"pubic_tubercle_{side}": _furthest(surface, frame.x, pubis, "pubic tubercle"),
        f"psis_{side}": _furthest(surface, -level.x, rear, "PSIS"),
    }


def _furthest(surface: Surface, direction: Array, within: NDArray[np.bool_], name: str) -> Array:
    if int(within.sum()) < 10:
        raise MeshRefused(
            f"the part that holds the {name} is not in the surface", remedy="Give whole hip bones"
        )
    return tip(surface, direction, within)


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


def _sphere(surface: Surface, ball: SphereOnBone) -> Sphere:
    trust = min(
        confidence(ball.covered, poor=SOCKET_COVERED, good=0.28),
        confidence(ball.rms / ball.radius, poor=0.06, good=0.02),
    )
    return Sphere(surface.to_image(ball.centre), ball.radius, Quality(ball.rms, ball.covered, trust))
