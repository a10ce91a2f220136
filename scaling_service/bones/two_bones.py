"""A shank's surface into tibia and fibula, whether they are apart or grown together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from scaling_service.bones.refusals import MeshRefused
from scaling_service.bones.surface import Surface
from scaling_service.bones.whole_bone import inner_shells

Array = NDArray[np.float64]

_FIBULA_LENGTH = (0.75, 1.25)  # of the tibia's; chosen around the usual 0.95-1.0
_FIBULA_AREA = (0.12, 0.75)  # of the tibia's; chosen around the usual 0.3-0.45
_FUSED_MIDDLE = (0.35, 0.65)  # share of the length where two shafts run apart; chosen


@dataclass(frozen=True, slots=True)
class Shank:
    """Tibia, fibula (None if there is none), whether they were grown together, and what was noticed."""

    tibia: Surface
    fibula: Surface | None
    joined: bool
    notes: list[str]


def without_fibula(surface: Surface) -> Shank:
    """A shank's surface into its bones.

    Raises MeshRefused: there is a further piece that is no fibula.
    """
    inner, outer = inner_shells(surface)
    notes = [f"{len(inner)} shells inside the bones were left out"] if inner else []
    tibia = surface.part(surface.shell == 0)
    if not outer:
        return _parted(surface, notes)
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
    """As long as the tibia, thinner, beside it and along it."""
    (length, axis), (other, direction) = _long_axis(tibia), _long_axis(piece)
    ratio, area = other / length, float(piece.areas.sum() / tibia.areas.sum())
    return (
        _FIBULA_LENGTH[0] < ratio < _FIBULA_LENGTH[1]
        and _FIBULA_AREA[0] < area < _FIBULA_AREA[1]
        and abs(float(axis @ direction)) > 0.95
        and abs(float((_middle(piece) - _middle(tibia)) @ axis)) < 0.2 * length
    )


def _parted(surface: Surface, notes: list[str]) -> Shank:
    """One piece: two bones if the middle of it runs as two shafts."""
    main = surface.shell == 0
    length, axis = _long_axis(surface.part(main))
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
    fibula = main & _nearer_to_fibula(surface, shafts, axis)
    said = "tibia and fibula are joined in one surface and were parted along their shafts"
    return Shank(surface.part(main & ~fibula), surface.part(fibula), joined=True, notes=[*notes, said])


def _nearer_to_fibula(surface: Surface, shafts: list[NDArray[np.bool_]], axis: Array) -> NDArray[np.bool_]:
    """Vertices that belong to the thinner shaft, grown from the middle to both ends slice by slice."""
    level = surface.smooth @ axis
    fibula = np.zeros(len(level), dtype=bool)
    fibula |= shafts[1]
    done = shafts[0] | shafts[1]
    step = 5e-3
    low, high = level[done].min(), level[done].max()
    while not done.all():
        low, high = low - step, high + step
        fresh = ~done & (level > low) & (level < high)
        if fresh.any():
            near = done & ((level < low + 4 * step) | (level > high - 4 * step))
            tree = cKDTree(surface.smooth[near])
            _, nearest = tree.query(surface.smooth[fresh])
            fibula[fresh] = fibula[near][nearest]
            done |= fresh
        elif low < level.min() and high > level.max():
            break
    return fibula


def _long_axis(surface: Surface) -> tuple[float, Array]:
    w = surface.areas / surface.areas.sum()
    local = surface.smooth - w @ surface.smooth
    axis = np.linalg.eigh(local.T @ (w[:, None] * local))[1][:, 2]
    return float(np.ptp(local @ axis)), axis


def _middle(surface: Surface) -> Array:
    return np.asarray(surface.areas @ surface.smooth / surface.areas.sum())
