"""Whether a surface can be one bone at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from scaling_service.bones.refusals import MeshRefused
from scaling_service.bones.surface import Surface

Array = NDArray[np.float64]

SECOND_BONE = 0.25
"""A separate piece above this share of the main one's area is another bone; chosen: a loose trochanter
or growth plate is below, a fibula (0.3-0.6 of a tibia) and a second femur are above."""

LONG_M = (0.08, 0.62)
"""Length of a long bone or a usable part of one; the upper end is above the tallest men's femurs."""


def one_bone(surface: Surface, bone: str) -> tuple[Surface, list[str]]:
    """Without inner shells (the marrow cavity of a CT segmentation); refuses a second bone.

    Raises MeshRefused: there is a second bone.
    """
    inner, outer = inner_shells(surface)
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


def inner_shells(surface: Surface) -> tuple[list[int], list[int]]:
    """Numbers of the shells inside the largest one, and of those outside it."""
    inner: list[int] = []
    outer: list[int] = []
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
