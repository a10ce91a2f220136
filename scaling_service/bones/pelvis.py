"""The pelvis: acetabula, ASIS, PSIS, pubis, with or without the sacrum."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scaling_service.bones import constellation, fits, results
from scaling_service.bones import deviations as bones_deviations
from scaling_service.bones import surface as surfaces
from scaling_service.bones.shapes import span_plane
from scaling_service.core.arrays import Array, Mask

SOCKET_RADII_M = (0.017, 0.036)  # a socket is 1-3 mm wider than the head in it

SOCKET_COVERED = 0.15  # least covered share of a socket's sphere: chosen, half of the usual 0.31-0.36

SOCKETS_APART_M = (0.11, 0.24)
"""Hip centres lie 174 (10) mm apart in adults (Puchaud 2019); a child's to a giant's."""

ALIKE = 1.2  # largest ratio of both sockets' radii: chosen, sides differ by 1-3 %

_SACRUM_OUT, _SACRUM_SHARE = 0.2, 0.01  # chosen: bone in the middle, in halves; share of the whole surface
_BEHIND = 0.3  # chosen: of the sockets, in halves of their distance; the pubis lies ahead of them
_BOTH_SIDES = 0.25  # chosen: least share of a piece on either side of the middle, as of a sacrum
_PSIS_OUT = (0.36, 0.75)
"""Where PSIS lie to the side, in halves of the sockets' distance: half 40-47 of 87 mm (models and palpation),
give or take two and a half standard deviations of 12 %."""

_BESIDE_SACRUM_M = 0.006  # chosen: a third of the breadth that is searched; what is rearmost may be sacrum
_SPINE_OUT, _PUBIS_IN = 0.85, 0.5
"""Where both ends of the anterior plane lie, as shares of half the distance between the sockets:
spines at 1.2-1.5, pubic tubercles at 0.2-0.4. Chosen between them."""

_TURNS = 6  # chosen: the frame turns by 5 degrees the first time, by less than 0.1 the third
_SIDES = (("r", 1.0), ("l", -1.0))
_SOCKETS = ("acetabulum_r", "acetabulum_l")

_SPINE_M = 0.025
"""How far an ASIS lies from where the anterior pelvic plane touches it at most: chosen, so that the inferior
spine, which lies further down and can reach as far forward, stays out."""

_OUTWARD = 0.5
"""The tubercle is the corner of the pubis: from it the front of the body falls back by 0.1-0.3 of the way to
the middle, the superior ramus by 0.8-1.0 of the way outwards. It reaches furthest along what lies between."""

_STARTS = 12  # chosen: poses tried about the sockets' line, 30 degrees apart; each settles within 45
_COARSE = 5000  # chosen: vertices on which rivals are told apart, some 3 mm apart
_APART = float(np.cos(np.deg2rad(30.0)))  # chosen: poses that differ by less are one
_SURE = 2.0  # chosen: a hundred to one, as a logarithm; below, a pose is a guess

_SIZE_M = (0.15, 0.42)  # largest extent of both hip bones, a child's to a giant's

_DEFINITIONS = {
    "acetabulum_r": "centre of the least-squares sphere in the socket",
    "acetabulum_l": "centre of the least-squares sphere in the socket",
    "asis_r": "foremost point of the ilium, ASIS and PSIS level (Wu et al. 2002)",
    "asis_l": "foremost point of the ilium, ASIS and PSIS level (Wu et al. 2002)",
    "psis_r": "rearmost point of the ilium, ASIS and PSIS level (Wu et al. 2002)",
    "psis_l": "rearmost point of the ilium, ASIS and PSIS level (Wu et al. 2002)",
    "pubic_tubercle_r": "corner of the pubis: furthest forward, and outward by half as much",
    "pubic_tubercle_l": "corner of the pubis: furthest forward, and outward by half as much",
    "mid_asis": "midpoint of both ASIS",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Frame:
    """Anterior, up and right unit vectors of the anterior pelvic plane, the middle of the sockets, half."""

    x: Array
    y: Array
    z: Array
    middle: Array
    half: float


def find_pelvis_landmarks(vertices: Array, faces: NDArray[np.integer]) -> results.BoneLandmarks:
    """Landmarks of both hip bones of unknown orientation.

    ``vertices``: (n, 3), m. ``faces`` (m, 3): one piece or several; a sacrum may be among them. Returns
    points ``acetabulum_r/l``, ``asis_r/l``, ``psis_r/l``, ``pubic_tubercle_r/l`` and ``mid_asis``; spheres
    ``acetabulum_r/l``; axis ``asis`` from left to right. What lies where the surface is cut is refused.
    Raises MeshRefused: no two sockets, no pose in which it is a pelvis, or two that are as likely.

    Every pair of sockets gives a transverse axis. From starts all around it the anterior pelvic plane
    settles on spines and pubis; of the poses that are found the likeliest among people counts
    (:mod:`scaling_service.bones.constellation`). ASIS and PSIS are the foremost and rearmost points of the
    ilia once they stand level with each other.
    """
    surface = surfaces.prepare(vertices, faces)
    size = float(np.ptp(surface.points, axis=0).max())
    if not _SIZE_M[0] <= size <= _SIZE_M[1]:
        raise results.MeshRefused(
            f"it is {1e3 * size:.4g} mm wide; both hip bones have "
            f"{1e3 * _SIZE_M[0]:.0f}-{1e3 * _SIZE_M[1]:.0f} mm",
            remedy="Check the unit (mm or m), and that both hip bones are in the surface",
        )
    pose = _choose_pose(surface)
    sockets = dict(zip(_SOCKETS, (pose.right, pose.left), strict=True))
    off = {name: bones_deviations.deviate_sphere(surface, ball) for name, ball in sockets.items()}
    surface, pieces = _leave_sacrum(surface, pose)
    frame = _touch_plane(surface, pose.frame)
    points = {name: ball.centre for name, ball in sockets.items()}
    sacrum = _holds_sacrum(surface, frame)
    # ASIS, PSIS and pubic tubercles
    spines, level = _level_spines(surface, frame, sacrum)
    tips = {}
    for side, sign in _SIDES:
        regions = _select_regions(surface, frame, sign)
        near = np.linalg.norm(surface.smooth - spines[f"asis_{side}"], axis=1) < _SPINE_M
        rear = regions.beside_sacrum if sacrum else regions.rear
        corner = (frame.x + _OUTWARD * sign * frame.z) / np.hypot(1.0, _OUTWARD)
        tips[f"asis_{side}"] = bones_deviations.Tip(surface, level.x, near & regions.ilium)
        tips[f"psis_{side}"] = bones_deviations.Tip(surface, -level.x, rear)
        tips[f"pubic_tubercle_{side}"] = bones_deviations.Tip(surface, corner, regions.pubis)
    found, refused = bones_deviations.find_tips(tips)
    refused |= _refuse_uneven(found, frame)
    points |= found
    off |= {
        name: float(np.hypot(tips[name].deviate(), _BESIDE_SACRUM_M if sacrum and "psis" in name else 0.0))
        for name in found
    }
    axes, turned = {}, {}
    if {"asis_r", "asis_l"} <= found.keys():
        points["mid_asis"] = 0.5 * (points["asis_r"] + points["asis_l"])
        off["mid_asis"] = 0.5 * float(np.hypot(off["asis_r"], off["asis_l"]))
        across = points["asis_r"] - points["asis_l"]
        width = float(np.linalg.norm(across))
        axes["asis"] = surface.turn_to_image(across / width)
        turned["asis"] = bones_deviations.deviate_line(width, off["asis_r"], off["asis_l"])
    deviations, axis_deviations = bones_deviations.add_definitions(off, turned)
    return results.BoneLandmarks(
        bone="pelvis",
        side=None,
        side_from="shape",
        points={name: surface.to_image(point) for name, point in points.items()},
        spheres={name: fits.place_sphere(surface, ball) for name, ball in sockets.items()},
        axes=axes,
        deviations=deviations,
        axis_deviations=axis_deviations,
        definitions={name: words for name, words in _DEFINITIONS.items() if name in points},
        refused=refused,
        warnings=(*surface.notes, *pieces, *_list_doubts(points, sacrum)),
        pose_odds=pose.odds,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pose:
    """Which way a pelvis lies. ``odds``: of it against its best rival, as a logarithm to base 10."""

    frame: _Frame
    right: fits.SphereOnBone
    left: fits.SphereOnBone
    odds: float


def _choose_pose(surface: surfaces.Surface) -> _Pose:
    """The likeliest of all poses of all pairs of sockets; see :func:`find_pelvis_landmarks`."""
    some = surface.part(np.arange(len(surface.points)) % max(1, len(surface.points) // _COARSE) == 0)
    found: list[tuple[float, _Frame, fits.SphereOnBone, fits.SphereOnBone]] = []
    why = "it has no spines and pubis as a pelvis has"
    for low, high in _pair_sockets(surface):
        for left, right in ((low, high), (high, low)):
            for angle in 2.0 * np.pi * np.arange(_STARTS) / _STARTS:
                try:
                    frame = _touch_plane(some, _start_frame(left, right, angle), find=_find_vertex)
                    spines, _ = _level_spines(some, frame, _holds_sacrum(some, frame), find=_find_vertex)
                except results.MeshRefused as error:
                    why = error.problem
                    continue
                places = spines | {"acetabulum_r": right.centre, "acetabulum_l": left.centre}
                unlike = constellation.measure_unlikeness(places) + constellation.measure_sockets(
                    right.covered, left.covered
                )
                found.append((unlike, frame, right, left))
    if not found:
        raise results.MeshRefused(why, remedy="Give whole hip bones, not deformed")
    best, frame, right, left = min(found, key=lambda one: one[0])
    rivals = [unlike for unlike, other, *_ in found if min(other.x @ frame.x, other.z @ frame.z) < _APART]
    odds = 0.5 * (min(rivals, default=constellation.MOST_UNLIKE) - best) / np.log(10.0)
    if odds < _SURE:
        raise results.MeshRefused(
            f"two ways in which it may lie are nearly as likely (odds of {10**odds:.0f} to 1)",
            remedy="Give whole hip bones, not deformed",
        )
    return _Pose(frame=frame, right=right, left=left, odds=float(odds))


def _pair_sockets(surface: surfaces.Surface) -> list[tuple[fits.SphereOnBone, fits.SphereOnBone]]:
    """Pairs of hollow spheres of equal size at a pelvis's distance."""
    found = [
        s for s in fits.find_spheres(surface, SOCKET_RADII_M, hollow=True) if s.covered >= SOCKET_COVERED
    ]
    pairs = [
        (a, b)
        for a, b in combinations(found, 2)
        if SOCKETS_APART_M[0] <= np.linalg.norm(a.centre - b.centre) <= SOCKETS_APART_M[1]
        and max(a.radius, b.radius) <= ALIKE * min(a.radius, b.radius)
    ]
    if not pairs:
        raise results.MeshRefused(
            f"{len(found)} hollow spheres of a socket's size were found, but no pair of hip sockets",
            remedy="Give the surface of both hip bones, with or without the sacrum",
        )
    return pairs


def _start_frame(left: fits.SphereOnBone, right: fits.SphereOnBone, angle: float) -> _Frame:
    """From the line of the sockets, turned about it by an angle, rad."""
    z = right.centre - left.centre
    half = 0.5 * float(np.linalg.norm(z))
    z = z / (2.0 * half)
    first, second = span_plane(z)
    x = np.cos(angle) * first + np.sin(angle) * second
    middle = 0.5 * (left.centre + right.centre)
    return _Frame(x=x, y=np.cross(z, x), z=z, middle=middle, half=half)


def _leave_sacrum(surface: surfaces.Surface, pose: _Pose) -> tuple[surfaces.Surface, list[str]]:
    """Without pieces behind the sockets that hold none of them and lie on both sides of the middle."""
    frame, kept, notes = pose.frame, np.ones(len(surface.points), dtype=bool), []
    sockets = (pose.right.support > 0) | (pose.left.support > 0)
    for k in range(int(surface.shell.max()) + 1):
        piece = surface.shell == k
        if (sockets & piece).any():
            continue
        out = (surface.smooth[piece] - frame.middle) @ frame.z
        share = float(surface.areas[piece][out > 0].sum() / surface.areas[piece].sum())
        behind = float((surface.middle(piece) - frame.middle) @ frame.x) < 0.0
        if behind and min(share, 1.0 - share) > _BOTH_SIDES:
            kept &= ~piece
            notes.append("a piece between the hip bones, as a sacrum, was left out")
    return (surface.part(kept), notes) if notes else (surface, [])


_Finder = abc.Callable[[surfaces.Surface, Array, Mask], Array]


def _find_vertex(surface: surfaces.Surface, direction: Array, within: Mask) -> Array:
    """The furthest vertex; see :func:`find_tip`, which is slower and truer."""
    points = surface.smooth[within]
    return np.asarray(points[int(np.argmax(points @ direction))])


def _touch_plane(surface: surfaces.Surface, frame: _Frame, find: _Finder = fits.find_tip) -> _Frame:
    """Turned until the plane touches the tips of spines and pubis, which single vertices do not move."""
    for _ in range(_TURNS):
        tips: dict[str, Array] = {}
        for side, sign in _SIDES:
            tips |= _find_plane_tips(surface, frame, side, sign, find)
        up = tips["asis_r"] + tips["asis_l"] - tips["pubic_tubercle_r"] - tips["pubic_tubercle_l"]
        frame = _turn_forward(frame, np.cross(up, frame.z))
    return frame


def _level_spines(
    surface: surfaces.Surface, frame: _Frame, sacrum: bool, find: _Finder = fits.find_tip
) -> tuple[dict[str, Array], _Frame]:
    """Where the plane touches the pubis, ASIS and PSIS once they stand level, and the frame that does."""
    touching: dict[str, Array] = {}
    for side, sign in _SIDES:
        touching |= _find_plane_tips(surface, frame, side, sign, find)
    level, spines, places = frame, dict(touching), {}
    for side, sign in _SIDES:
        near = np.linalg.norm(surface.smooth - touching[f"asis_{side}"], axis=1) < _SPINE_M
        regions = _select_regions(surface, frame, sign)
        places[side] = near & regions.ilium, regions.beside_sacrum if sacrum else regions.rear
    for _ in range(_TURNS):
        for side, (front, rear) in places.items():
            spines[f"asis_{side}"] = _find_furthest(surface, level.x, front, "ASIS", find)
            spines[f"psis_{side}"] = _find_furthest(surface, -level.x, rear, "PSIS", find)
        level = _turn_forward(
            frame, spines["asis_r"] + spines["asis_l"] - spines["psis_r"] - spines["psis_l"]
        )
    return spines, level


def _holds_sacrum(surface: surfaces.Surface, frame: _Frame) -> bool:
    """Whether there is bone in the middle behind the sockets."""
    offset = (surface.smooth - frame.middle) / frame.half
    behind = (np.abs(offset @ frame.z) < _SACRUM_OUT) & (offset @ frame.x < -_BEHIND)
    return float(surface.areas[behind].sum()) > _SACRUM_SHARE * float(surface.areas.sum())


def _list_doubts(points: dict[str, Array], sacrum: bool) -> abc.Iterator[str]:
    """What may be wrong with points: how people's pelves are built, and the sacrum."""
    whole = all(f"{name}_{side}" in points for name in ("asis", "psis", "pubic_tubercle") for side in "rl")
    unlike = constellation.measure_unlikeness(points) if whole else 0.0
    if unlike > constellation.MOST_UNLIKE:
        yield (
            f"its landmarks lie to one another as in fewer than one of {1.0 / constellation.RARE:.0f} "
            "pelves: asis, psis, pubic tubercle and mid asis may be other points; look at them"
        )
    if sacrum:
        yield (
            "a sacrum is in the surface: psis was looked for beside it; leave the sacrum out to be sure of it"
        )


def _turn_forward(frame: _Frame, forward: Array) -> _Frame:
    """The frame turned about the line of the sockets to face forward."""
    forward = forward - float(forward @ frame.z) * frame.z
    forward = forward / np.linalg.norm(forward)
    return _Frame(x=forward, y=np.cross(frame.z, forward), z=frame.z, middle=frame.middle, half=frame.half)


def _find_plane_tips(
    surface: surfaces.Surface, frame: _Frame, side: str, sign: float, find: _Finder
) -> dict[str, Array]:
    """Where the anterior pelvic plane touches one side."""
    regions = _select_regions(surface, frame, sign)
    return {
        f"asis_{side}": _find_furthest(surface, frame.x, regions.ilium, "ASIS", find),
        f"pubic_tubercle_{side}": _find_furthest(surface, frame.x, regions.pubis, "pubic tubercle", find),
    }


class _Regions(NamedTuple):
    """Vertices of one side in which landmarks are looked for, each (n,)."""

    ilium: Mask
    pubis: Mask
    rear: Mask
    beside_sacrum: Mask


def _select_regions(surface: surfaces.Surface, frame: _Frame, sign: float) -> _Regions:
    """By places outwards, up and ahead of the middle of the sockets, as shares of half their distance."""
    offset = (surface.smooth - frame.middle) / frame.half
    out, height, ahead = sign * (offset @ frame.z), offset @ frame.y, offset @ frame.x
    return _Regions(
        ilium=(out > _SPINE_OUT) & (height > 0.2),
        pubis=(out > 0.0) & (out < _PUBIS_IN) & (height < 0.2),
        rear=(out > 0.2) & (out < 1.0) & (height > 0.0) & (ahead < 0.0),
        beside_sacrum=(out > _PSIS_OUT[0]) & (out < _PSIS_OUT[1]) & (height > 0.0) & (ahead < 0.0),
    )


def _find_furthest(
    surface: surfaces.Surface, direction: Array, within: Mask, name: str, find: _Finder = fits.find_tip
) -> Array:
    if int(within.sum()) < 10:
        raise results.MeshRefused(
            f"the part that holds the {name} is not in the surface", remedy="Give whole hip bones"
        )
    return find(surface, direction, within)


def _refuse_uneven(points: dict[str, Array], frame: _Frame) -> dict[str, str]:
    """Takes out PSIS that no pelvis has, and says why: mirrored sides must nearly mirror.

    Raises MeshRefused: the ASIS are such, without which there is no pelvis.
    """
    refused: dict[str, str] = {}
    for name in ("asis", "psis"):
        if not {f"{name}_r", f"{name}_l"} <= points.keys():
            continue
        right, left = points[f"{name}_r"] - frame.middle, points[f"{name}_l"] - frame.middle
        uneven = abs(float((right + left) @ frame.z)), abs(float((right - left) @ frame.y))
        if max(uneven) <= 0.35 * frame.half:  # chosen: 30 mm, five times what sides usually differ by
            continue
        why = f"both {name.upper()} stand unevenly by {1e3 * max(uneven):.0f} mm"
        if name == "asis":
            raise results.MeshRefused(why, remedy="Give whole hip bones, not deformed")
        for side, _ in _SIDES:
            points.pop(f"{name}_{side}")
            refused[f"{name}_{side}"] = why
    return refused
