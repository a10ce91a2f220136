"""One bone or two: inner shells, second bones, and a shank's surface into tibia and fibula."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from scaling_service.bones.results import MeshRefused
from scaling_service.bones.surface import Surface
from scaling_service.core.arrays import Array

SECOND_BONE = 0.25
"""A separate piece above this share of the main one's area is another bone; chosen: a loose trochanter
or growth plate is below, a fibula (0.3-0.6 of a tibia) and a second femur are above."""

LONG_M = (0.08, 0.62)
"""Length of a long bone or a usable part of one; the upper end is above the tallest men's femurs."""

GAP_M = 0.05
"""Least length of shaft that an image leaves out between two ends of a bone: chosen, a crack is shorter."""

_FIBULA_LENGTH = 0.45
"""Least ratio of both bones' lengths: whole ones 0.95-1.0; at the ankle the fibula reaches 10-15 mm lower,
half of a tibia of 25 mm, and a tilted cut takes more. Chosen."""
_FIBULA_BESIDE = 0.6  # chosen: least share of the shorter bone that lies beside the other
_ELONGATED = 2.0  # chosen: least length over width of a bone whose own long axis is its shaft's
_ANKLE_M = 0.02  # chosen: the least of a shank that holds both malleoli
_FIBULA_AREA = (0.12, 0.75)  # of the tibia's; chosen around the usual 0.3-0.45
_NO_LENGTH_M = 1e-9
_FUSED_MIDDLE = (0.35, 0.65)  # share of the length where two shafts run apart; chosen


def require_one_bone(surface: Surface, bone: str) -> tuple[Surface, list[str]]:
    """Without inner shells (the marrow cavity of a CT segmentation); refuses a second bone.

    Raises MeshRefused: there is a second bone.
    """
    inner, outer = sort_pieces(surface)
    notes = [f"{len(inner)} shells inside the bone were left out"] if inner else []
    if outer:
        share = max(float(surface.areas[surface.shell == k].sum()) for k in outer)
        share /= float(surface.areas[surface.shell == 0].sum())
        if share > SECOND_BONE:
            raise MeshRefused(
                f"it holds {1 + len(outer)} separate bones, a {bone} is one",
                remedy=f"Cut the other bone off and give the {bone} alone",
            )
        notes.append(f"{len(outer)} pieces that are not joined to the {bone} were left out")
    return (surface.part(surface.shell == 0), notes) if inner or outer else (surface, [])


def find_ends(surface: Surface) -> Surface | None:
    """Both ends of a long bone whose shaft is missing; None of any other surface."""
    _, outer = sort_pieces(surface)
    areas = [float(surface.areas[surface.shell == k].sum()) for k in (0, *outer)]
    ends = [k for k, area in zip((0, *outer), areas, strict=True) if area > SECOND_BONE * areas[0]]
    if len(ends) != 2:
        return None
    spans = sorted((surface.smooth[surface.shell == k, 0] for k in ends), key=lambda x: float(x.min()))
    if float(spans[1].min() - spans[0].max()) < GAP_M:
        return None
    return surface.part(np.isin(surface.shell, ends))


def sort_pieces(surface: Surface) -> tuple[list[int], list[int]]:
    """Numbers of the shells inside the largest one, and of those outside it."""
    inner: list[int] = []
    outer: list[int] = []
    if not surface.shell.any():
        return inner, outer
    main = surface.shell == 0
    tree = cKDTree(surface.smooth[main])
    normals = surface.normals[main]
    for k in range(1, int(surface.shell.max()) + 1):
        sample = surface.smooth[surface.shell == k][:: max(1, int((surface.shell == k).sum()) // 400)]
        _, nearest = tree.query(sample)
        behind = np.einsum("ij,ij->i", sample - surface.smooth[main][nearest], normals[nearest]) < 0
        (inner if behind.mean() > 0.8 else outer).append(k)
    return inner, outer


def require_long(surface: Surface, bone: str) -> None:
    """Refuses what is not long and thin, or has an impossible length.

    Raises MeshRefused: with the length, and the unit that would make it possible.
    """
    size = np.ptp(surface.points, axis=0)
    length, thickness = float(size[0]), float(size[1:].max())
    if not LONG_M[0] <= length <= LONG_M[1]:
        raise MeshRefused(
            f"it is {1e3 * length:.4g} mm long; a {bone} has {1e3 * LONG_M[0]:.0f}-{1e3 * LONG_M[1]:.0f} mm",
            remedy="Check the unit (mm or m)",
        )
    if length < 1.2 * thickness:  # chosen: even a third of a femur is longer than its condyles are wide
        raise MeshRefused(
            f"it is {1e3 * length:.0f} mm long and {1e3 * thickness:.0f} mm thick, no {bone}",
            remedy=f"Give the surface of a {bone}",
        )


@dataclass(frozen=True, slots=True)
class Shank:
    """Tibia, fibula (None if there is none), whether they were grown together, and what was noticed."""

    tibia: Surface
    fibula: Surface | None
    joined: bool
    notes: list[str]


def separate_fibula(surface: Surface) -> Shank:
    """A shank's surface into its bones.

    Raises MeshRefused: there is a further piece that is no fibula.
    """
    inner, outer = sort_pieces(surface)
    notes = [f"{len(inner)} shells inside the bones were left out"] if inner else []
    tibia = surface.part(surface.shell == 0)
    if not outer:
        return _part_shafts(surface, notes)
    fibulas = [k for k in outer if _is_fibula(tibia, surface.part(surface.shell == k))]
    others = [k for k in outer if k not in fibulas]
    large = [k for k in others if surface.areas[surface.shell == k].sum() > 0.25 * tibia.areas.sum()]
    if len(fibulas) > 1 or large:
        raise MeshRefused(
            f"it holds {1 + len(outer)} separate bones; a shank has a tibia and a fibula",
            remedy="Give one tibia, with or without its own fibula",
        )
    if others:
        notes.append(f"{len(others)} pieces that are neither tibia nor fibula were left out")
    fibula = surface.part(surface.shell == fibulas[0]) if fibulas else None
    return Shank(tibia, fibula, joined=False, notes=notes)


def _is_fibula(tibia: Surface, piece: Surface) -> bool:
    """Beside the tibia over most of its length, thinner, and along it where both are long."""
    (length, axis), direction = _measure_long_axis(tibia), piece.widest_direction()
    long = length > _ELONGATED * float(np.ptp(tibia.smooth @ tibia.widest_direction(across=axis)))
    if not long:  # a piece at one end: the thinner bone shows where the shafts run
        axis = direction
    spans = [(float(x.min()), float(x.max())) for x in (tibia.smooth @ axis, piece.smooth @ axis)]
    lengths = [high - low for low, high in spans]
    beside = min(spans[0][1], spans[1][1]) - max(spans[0][0], spans[1][0])
    area = float(piece.areas.sum() / tibia.areas.sum())
    return (
        min(lengths) > _FIBULA_LENGTH * max(lengths)
        and beside > _FIBULA_BESIDE * min(lengths)
        and _FIBULA_AREA[0] < area < _FIBULA_AREA[1]
        and (not long or abs(float(axis @ direction)) > 0.95)
    )


def require_shank(shank: Shank) -> None:
    """Refuses what has an impossible length, or is neither long nor has a fibula beside it.

    Raises MeshRefused: with the length, and the unit that would make it possible.
    """
    if shank.fibula is None:
        require_long(shank.tibia, "tibia")
        return
    length = float(np.ptp(shank.tibia.smooth @ shank.fibula.widest_direction()))
    if not _ANKLE_M <= length <= LONG_M[1]:
        raise MeshRefused(
            f"it is {1e3 * length:.4g} mm long; a tibia has up to {1e3 * LONG_M[1]:.0f} mm, its end at the "
            f"ankle at least {1e3 * _ANKLE_M:.0f}",
            remedy="Check the unit (mm or m)",
        )


def _part_shafts(surface: Surface, notes: list[str]) -> Shank:
    """One piece: two bones if the middle of it runs as two shafts."""
    main = surface.shell == 0
    length, axis = _measure_long_axis(surface.part(main))
    level = surface.smooth @ axis
    level = (level - level[main].min()) / length
    between = main & (level > _FUSED_MIDDLE[0]) & (level < _FUSED_MIDDLE[1])
    inside = surface.faces[between[surface.faces].all(axis=1)]
    n = len(surface.points)
    graph = coo_array(
        (np.ones(2 * len(inside)), (inside[:, [0, 1]].ravel(), inside[:, [1, 2]].ravel())), (n, n)
    )
    _, label = connected_components(graph, directed=False)
    names, counts = np.unique(label[between], return_counts=True)
    large = names[counts > 0.15 * counts.max()]
    if len(large) != 2:
        return Shank(surface.part(main), None, joined=False, notes=notes)
    weights = [float(surface.areas[between & (label == name)].sum()) for name in large]
    order = np.argsort(weights)[::-1]
    shafts = [between & (label == large[k]) for k in order]
    fibula = main & _grow_fibula(surface, shafts)
    said = "tibia and fibula are joined in one surface and were parted along their shafts"
    return Shank(surface.part(main & ~fibula), surface.part(fibula), joined=True, notes=[*notes, said])


def _grow_fibula(surface: Surface, shafts: list[NDArray[np.bool_]]) -> NDArray[np.bool_]:
    """Vertices nearer along the surface to the thinner shaft: bridges between both bones part half-way."""
    a, b = surface.faces.ravel(), np.roll(surface.faces, -1, axis=1).ravel()
    lengths = np.linalg.norm(surface.smooth[a] - surface.smooth[b], axis=1)
    n = len(surface.points)
    # Each edge stands twice, once for each of its faces; zero would be no edge.
    graph = csr_array((np.maximum(lengths, _NO_LENGTH_M), (a, b)), shape=(n, n))
    seeds = [np.flatnonzero(shaft) for shaft in shafts]
    _, _, nearest = dijkstra(
        graph, directed=False, indices=np.concatenate(seeds), min_only=True, return_predecessors=True
    )
    return np.asarray(np.isin(nearest, seeds[1]))


def _measure_long_axis(surface: Surface) -> tuple[float, Array]:
    axis = surface.widest_direction()
    return float(np.ptp(surface.smooth @ axis)), axis
