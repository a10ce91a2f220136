"""The pelvis: acetabula, ASIS, PSIS, pubis, with or without the sacrum."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scaling_service.bones.fits import SphereOnBone, find_spheres, find_tip, place_sphere
from scaling_service.bones.results import BoneLandmarks, MeshRefused
from scaling_service.bones.surface import Surface, prepare
from scaling_service.model.anatomy.frames import build_pelvis_frame
from scaling_service.model.anatomy.hip_centre import predict_hip_centres

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SOCKET_RADII_M = (0.017, 0.036)  # a socket is 1-3 mm wider than the head in it

SOCKET_COVERED = 0.15  # least covered share of a socket's sphere: chosen, half of the usual 0.31-0.36

SOCKETS_APART_M = (0.11, 0.24)
"""Hip centres lie 174 (10) mm apart in adults (Puchaud 2019); a child's to a giant's."""

ALIKE = 1.2  # largest ratio of both sockets' radii: chosen, sides differ by 1-3 %

_SACRUM_OUT, _SACRUM_SHARE = 0.2, 0.01  # chosen: bone in the middle, in halves; share of the whole surface
_PSIS_OUT = (0.36, 0.75)
"""Where PSIS lie to the side, in halves of the sockets' distance: half 40-47 of 87 mm (models and palpation),
give or take two and a half standard deviations of 12 %."""
_HIP_SD_M = np.array([0.009, 0.008, 0.008])
_FAR = 4.0
"""Of hips about Harrington's regression in adults, who miss it by 12 mm on average (Mantovani 2016), and of
spines by one rater and another; beyond four of these a pelvis is none."""
_NEAR_EDGE_M = 0.010  # chosen: edges of triangles and a blunt tip's size

_SPINE_OUT, _PUBIS_IN = 0.85, 0.5
"""Where both ends of the anterior plane lie, as shares of half the distance between the sockets:
spines at 1.2-1.5, pubic tubercles at 0.2-0.4. Chosen between them."""

_WINGS_OUT, _PUBIS_OUT = 1.1, 0.35
_PUBIS_REACH, _PUBIS_BELOW, _PUBIS_AHEAD = 0.9, 0.3, 0.1
"""In halves of the distance between the sockets. Beyond 1.1 to the side there is nothing but the wings: ASIS
and crests lie at 1.2 to 1.7, ischia at 0.5 to 0.9 in women, too. Within 0.35 there is the pubis, not farther
from the sockets' line than 0.9 (symphysis: 0.4 to 0.7), and behind it the sacrum, farther (1.0 to 1.4).
Chosen between these, from the shapes in anatomies of both sexes; the pubis lies about 0.4 ahead."""

_TURNS = 6  # chosen: the frame turns by 5 degrees the first time, by less than 0.1 the third
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

    The sockets give the transverse axis. Only the wings lie outside the sockets, so that they tell where up
    is, and between the sockets lies the pubis, ahead of them. The anterior pelvic plane then touches spines
    and pubis. ASIS and PSIS are the foremost and rearmost points of the ilia once they stand level with each
    other.
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
    sacrum = _holds_sacrum(surface, frame)
    points |= _level_spines(surface, frame, sacrum)
    points["mid_asis"] = 0.5 * (points["asis_r"] + points["asis_l"])
    refused = _refuse_uneven(points, frame)
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
        definitions={name: words for name, words in _DEFINITIONS.items() if name in points},
        refused=refused,
        warnings=(*surface.notes, *_list_doubts(surface, points, sacrum)),
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
    """Up is where the wings are, the only bone outside the sockets; ahead is the pubis, between them."""
    middle = 0.5 * (low.centre + high.centre)
    z = high.centre - low.centre
    half = 0.5 * float(np.linalg.norm(z))
    z = z / (2.0 * half)
    first = np.linalg.svd(z[None, :])[2][1]
    plane = np.stack([first, np.cross(z, first)])
    flat = (surface.smooth - middle) @ plane.T
    out, reach = np.abs((surface.smooth - middle) @ z) / half, np.linalg.norm(flat, axis=1) / half
    wings = out > _WINGS_OUT
    if not wings.any():
        raise MeshRefused(
            "nothing of it lies outside the hip sockets",
            remedy="Give whole hip bones; the ilia must be in the surface",
        )
    y = np.average(flat[wings], axis=0, weights=surface.areas[wings])
    y = y / np.linalg.norm(y)
    x = np.array([y[1], -y[0]])
    pubis = (out < _PUBIS_OUT) & (reach < _PUBIS_REACH) & (flat @ y < _PUBIS_BELOW * half)
    if not pubis.any():
        raise MeshRefused(
            "there is no pubis between the hip sockets",
            remedy="Give whole hip bones; the pubis must be in the surface",
        )
    ahead = float(np.average(flat[pubis] @ x, weights=surface.areas[pubis]))
    if abs(ahead) < _PUBIS_AHEAD * half:
        raise MeshRefused(
            "the pubis lies neither before nor behind the hip sockets",
            remedy="Give whole hip bones, not deformed",
        )
    x = np.sign(ahead) * x
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


def _level_spines(surface: Surface, frame: _Frame, sacrum: bool) -> dict[str, Array]:
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
            rear = regions.beside_sacrum if sacrum else regions.rear
            spines[f"psis_{side}"] = _find_furthest(surface, -level.x, rear, "PSIS")
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


def _holds_sacrum(surface: Surface, frame: _Frame) -> bool:
    """Whether there is bone in the middle behind the sockets."""
    offset = (surface.smooth - frame.middle) / frame.half
    behind = (np.abs(offset @ frame.z) < _SACRUM_OUT) & (offset @ frame.x < -_PUBIS_BELOW)
    return float(surface.areas[behind].sum()) > _SACRUM_SHARE * float(surface.areas.sum())


def _list_doubts(surface: Surface, points: dict[str, Array], sacrum: bool) -> Iterator[str]:
    """What may be wrong with points: hips as an independent check, the sacrum, edges of the image."""
    offsets = _measure_hips(points)
    if offsets is not None and float(np.sqrt(((offsets / _HIP_SD_M) ** 2).sum(axis=1)).max()) > _FAR:
        worst = 1e3 * float(np.linalg.norm(offsets, axis=1).max())
        yield (
            f"the sockets lie {worst:.0f} mm from where hips lie in a pelvis with these spines: asis, psis, "
            "pubic tubercle and mid asis may be other points; look at them"
        )
    if sacrum:
        yield (
            "a sacrum is in the surface: psis was looked for beside it; leave the sacrum out to be sure of it"
        )
    edge = _find_edge(surface)
    on_edge = [
        name
        for name, at in points.items()
        if len(edge) and float(np.linalg.norm(edge - at, axis=1).min()) < _NEAR_EDGE_M
    ]
    if on_edge:
        words = ", ".join(name.replace("_", " ") for name in on_edge)
        yield f"{words}: on an edge where the surface ends, so that they need not be the landmarks"


def _measure_hips(points: dict[str, Array]) -> Array | None:
    """The sockets less where Harrington 2007 puts the hips by these spines, right and left, (2, 3), m."""
    if "psis_r" not in points:
        return None
    spines = [points[name] for name in ("asis_r", "asis_l", "psis_r", "psis_l")]
    found = predict_hip_centres(*spines)
    if not np.isfinite(found.right).all():
        return None
    axes = build_pelvis_frame(*(spine[None] for spine in spines))
    rows = []
    for name, predicted in (("acetabulum_r", found.right[0]), ("acetabulum_l", found.left[0])):
        rows.append(axes.rotation[0].T @ (points[name] - axes.origin[0]) - predicted)
    return np.array(rows)


def _find_edge(surface: Surface) -> Array:
    """Vertices of edges that only one face has, (n, 3)."""
    edges = np.sort(surface.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    return np.asarray(surface.points[np.unique(unique[count == 1])])


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
    beside_sacrum: Mask


def _select_regions(surface: Surface, frame: _Frame, sign: float) -> _Regions:
    """By places outwards, up and ahead of the middle of the sockets, as shares of half their distance."""
    offset = (surface.smooth - frame.middle) / frame.half
    out, height, ahead = sign * (offset @ frame.z), offset @ frame.y, offset @ frame.x
    return _Regions(
        ilium=(out > _SPINE_OUT) & (height > 0.2),
        pubis=(out > 0.0) & (out < _PUBIS_IN) & (height < 0.2),
        rear=(out > 0.2) & (out < 1.0) & (height > 0.0) & (ahead < 0.0),
        beside_sacrum=(out > _PSIS_OUT[0]) & (out < _PSIS_OUT[1]) & (height > 0.0) & (ahead < 0.0),
    )


def _find_furthest(surface: Surface, direction: Array, within: Mask, name: str) -> Array:
    if int(within.sum()) < 10:
        raise MeshRefused(
            f"the part that holds the {name} is not in the surface", remedy="Give whole hip bones"
        )
    return find_tip(surface, direction, within)


def _refuse_uneven(points: dict[str, Array], frame: _Frame) -> dict[str, str]:
    """Takes out PSIS that no pelvis has, and says why: mirrored sides must nearly mirror.

    Raises MeshRefused: the ASIS are such, without which there is no pelvis.
    """
    refused: dict[str, str] = {}
    for name in ("asis", "psis"):
        right, left = points[f"{name}_r"] - frame.middle, points[f"{name}_l"] - frame.middle
        uneven = abs(float((right + left) @ frame.z)), abs(float((right - left) @ frame.y))
        if max(uneven) <= 0.35 * frame.half:  # chosen: 30 mm, five times what sides usually differ by
            continue
        why = f"both {name.upper()} stand unevenly by {1e3 * max(uneven):.0f} mm"
        if name == "asis":
            raise MeshRefused(why, remedy="Give whole hip bones, not deformed")
        for side, _ in _SIDES:
            points.pop(f"{name}_{side}")
            refused[f"{name}_{side}"] = why
    return refused
