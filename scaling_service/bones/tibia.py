"""The tibia with its fibula: malleoli, ankle centre, fibula head, side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.bones import femur, pieces, results
from scaling_service.bones import surface as surfaces
from scaling_service.bones.cuts import is_cut
from scaling_service.bones.deviations import TURN, Tip, add_definitions, find_tips
from scaling_service.bones.fits import SHARP_M, find_spheres
from scaling_service.bones.shank import ShankPose, find_shank_pose, measure_width
from scaling_service.core.arrays import Array

ANKLE_M = 0.03  # height of the block that holds a malleolus: chosen, above their prominences (12-15 mm)


FLARE = 1.3  # least ratio of the ankle end's width to the narrowest shaft's: chosen, ankles have 1.6-2

MALLEOLUS_M = 3e-3
"""How far the medial malleolus stands below the rest of the end at least; chosen, usual are 10-15 mm."""

_LOOSE_TURN = float(np.deg2rad(15.0))
"""Of medial and lateral where no plateau tells them well: chosen. The malleoli stand turned against a
plateau that is not seen by 15 to 30 degrees, the fibula less; what is left of a fibula that was grown to the
tibia tips the plateau."""

_AT_KNEE = ("plateau_medial", "plateau_lateral", "fibula_head")
_AT_ANKLE = (
    "malleolus_medial",
    "malleolus_medial_prominence",
    "malleolus_lateral",
    "malleolus_lateral_prominence",
    "ankle_centre",
)
_OF_FIBULA = ("malleolus_lateral", "malleolus_lateral_prominence", "fibula_head", "ankle_centre")

_DEFINITIONS = {
    "ankle_centre": "midpoint of the tips of the malleoli (Wu et al. 2002); about 4 mm lateral and 4 mm "
    "proximal of the axis of the talus",
    "malleolus_medial": "most distal point",
    "malleolus_lateral": "most distal point",
    "malleolus_medial_prominence": "most medial point of the distal 30 mm",
    "malleolus_lateral_prominence": "most lateral point of the distal 30 mm",
    "fibula_head": "most proximal point",
    "plateau_medial": "most medial point of the plateau's edge",
    "plateau_lateral": "most lateral point of the plateau's edge",
}


@dataclass(frozen=True, slots=True)
class TibiaFrame:
    """Anterior, proximal and right unit vectors in the image, for fits on neighbouring bones.

    ``surface`` (n, 3), m: vertices of tibia and fibula in the image, close enough to measure gaps to.
    """

    x: Array
    y: Array
    z: Array
    surface: Array


def find_tibia_landmarks(
    vertices: Array, faces: NDArray[np.integer], *, named_side: results.Side | None = None
) -> tuple[results.BoneLandmarks, TibiaFrame]:
    """Landmarks of a tibia of unknown orientation and side, the fibula joined, apart or absent.

    ``vertices``: (n, 3), m. ``faces``: (m, 3): the whole bone, or its end at the knee or at the ankle.
    ``named_side`` {"r", "l"}: what the bone is called; believed only where its shape does not tell. Returns
    points ``ankle_centre`` (midpoint of the malleoli's tips; Wu et al. 2002), the tips and the prominences of
    the malleoli, ``fibula_head``, ``plateau_medial`` and ``plateau_lateral``; what is cut off is refused.
    Raises MeshRefused: it is no tibia, or holds a second one.
    """
    surface = surfaces.prepare(vertices, faces)
    shank = pieces.separate_fibula(surface)
    tibia, fibula = shank.tibia, shank.fibula
    pieces.require_shank(shank)
    if fibula is None:
        _refuse_femur(tibia)
    pose = find_shank_pose(shank, named_side)
    turn = TURN if pose.plateau is not None and not shank.joined else _LOOSE_TURN
    tips: dict[str, Tip] = {}
    refused: dict[str, str] = {}
    if pose.plateau is None:
        refused |= dict.fromkeys(_AT_KNEE, "the surface is cut off below the knee")
    else:
        for name, direction in (("plateau_medial", -pose.outwards), ("plateau_lateral", pose.outwards)):
            tips[name] = Tip(tibia, direction, pose.plateau, depth=SHARP_M, turn=turn)
        _add_fibula_head(shank, pose, tips, refused)
    cut = _find_cut(tibia, pose)
    if cut is not None:
        refused |= dict.fromkeys(_AT_ANKLE, cut)
    else:
        ankle = pose.height < ANKLE_M
        along = tibia.smooth @ pose.outwards
        chosen: NDArray[np.bool_] = along < 0.5 * float(along[ankle].max() + along[ankle].min())
        medial = ankle & chosen
        tips["malleolus_medial"] = Tip(tibia, -pose.y, medial, depth=SHARP_M)
        tips["malleolus_medial_prominence"] = Tip(tibia, -pose.outwards, ankle, depth=SHARP_M, turn=turn)
        if fibula is None:
            refused |= dict.fromkeys(_OF_FIBULA, "there is no fibula in the surface")
        else:
            height = fibula.smooth @ pose.y
            low = height < height.min() + ANKLE_M
            tips["malleolus_lateral"] = Tip(fibula, -pose.y, low, depth=SHARP_M)
            tips["malleolus_lateral_prominence"] = Tip(fibula, pose.outwards, low, depth=SHARP_M, turn=turn)
    points, gone = find_tips(tips)
    refused |= gone
    off = {name: tips[name].deviate() for name in points}
    _add_ankle(points, off, refused)
    deviations, axis_deviations = add_definitions(
        off, {"plateau": turn if shank.joined else 0.0} if pose.plateau is not None else {}
    )
    if "ankle_centre" in off:
        deviations |= add_definitions({"ankle_centre_malleoli": off["ankle_centre"]}, {})[0]
        deviations["ankle_centre"] = deviations.pop("ankle_centre_malleoli")
    landmarks = results.BoneLandmarks(
        bone="tibia",
        side=pose.side,
        side_from=pose.side_from,
        points={name: surface.to_image(point) for name, point in points.items()},
        deviations=deviations,
        axes={name: surface.turn_to_image(pose.z) for name in axis_deviations},
        axis_deviations=axis_deviations,
        definitions=_DEFINITIONS,
        refused=refused,
        warnings=(*surface.notes, *shank.notes),
    )
    x, y, z = (surface.turn_to_image(axis) for axis in (pose.x, pose.y, pose.z))
    return landmarks, TibiaFrame(x, y, z, surface.to_image(surface.smooth))


def _find_cut(tibia: surfaces.Surface, pose: ShankPose) -> str | None:
    """Why the distal end is no ankle: it is cut, does not flare, or no malleolus stands below the rest."""
    height, total = pose.height, float(pose.height.max())
    if is_cut(tibia, -pose.y):
        return "the surface is cut off above the ankle"
    if pose.plateau is not None:
        levels = np.linspace(0.25, 0.6, 8)
        shaft = [measure_width(tibia, pose.y, np.abs(height - x * total) < 0.02 * total) for x in levels]
        end = measure_width(tibia, pose.y, height < ANKLE_M)
        if end < FLARE * min(shaft):
            return f"the distal end is {1e3 * end:.0f} mm wide, no wider than a shaft: it is cut off"
    along = tibia.smooth @ pose.outwards
    ankle = height < ANKLE_M
    middle = 0.5 * float(along[ankle].max() + along[ankle].min())
    below = float(height[ankle & (along > middle)].min())
    if below < MALLEOLUS_M:
        return f"the medial malleolus stands {1e3 * below:.0f} mm below the rest: the end is cut off"
    return None


def _refuse_femur(tibia: surfaces.Surface) -> None:
    """A bone without fibula that bears a femoral head is a femur."""
    balls = find_spheres(tibia, femur.HEAD_RADII_M)
    if balls and balls[0].covered >= femur.HEAD_COVERED:
        raise results.MeshRefused(
            f"it bears a ball that covers {balls[0].covered:.2f} of its sphere, as a femur's head",
            remedy="Give the surface of a tibia, with or without its fibula",
        )


def _add_fibula_head(
    shank: pieces.Shank, pose: ShankPose, tips: dict[str, Tip], refused: dict[str, str]
) -> None:
    if shank.fibula is None:
        refused["fibula_head"] = "there is no fibula in the surface"
    elif shank.joined:
        # Along the shafts it is clear what is fibula; under the plateau it is not.
        refused["fibula_head"] = "the fibula is grown to the tibia, so its upper end cannot be told"
    else:
        level = shank.fibula.smooth @ pose.y
        tips["fibula_head"] = Tip(shank.fibula, pose.y, level > level.max() - ANKLE_M, depth=SHARP_M)


def _add_ankle(points: dict[str, Array], off: dict[str, float], refused: dict[str, str]) -> None:
    """The middle of both malleoli's tips."""
    tips = ("malleolus_medial", "malleolus_lateral")
    if not set(tips) <= points.keys():
        refused.setdefault("ankle_centre", "a malleolus is missing")
        return
    apart = float(np.linalg.norm(points[tips[0]] - points[tips[1]]))
    if 0.03 <= apart <= 0.09:  # intermalleolar widths of 55-75 mm in adults; a child's to a giant's
        points["ankle_centre"] = 0.5 * (points[tips[0]] + points[tips[1]])
        off["ankle_centre"] = 0.5 * float(np.hypot(off[tips[0]], off[tips[1]]))
    else:
        refused["ankle_centre"] = f"the malleoli lie {1e3 * apart:.0f} mm apart"
