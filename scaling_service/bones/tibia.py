"""The tibia with its fibula: malleoli, ankle centre, fibula head, side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.bones.femur import HEAD_COVERED, HEAD_RADII_M
from scaling_service.bones.fits import SHARP_M, find_spheres, find_tip
from scaling_service.bones.pieces import require_long, separate_fibula
from scaling_service.bones.results import BoneLandmarks, MeshRefused, Side
from scaling_service.bones.surface import Surface, prepare

Array = NDArray[np.float64]

PLATEAU_M = 0.02  # height of the block that holds the plateau: chosen, above the tuberosity
ANKLE_M = 0.03  # height of the block that holds a malleolus: chosen, above their prominences (12-15 mm)

PLATEAU_WIDTH_M = (0.045, 0.11)  # width of a plateau from a child to a giant; adults have 65-85 mm

WIDER = 1.2  # least ratio of the ends' widths: chosen, a plateau is 1.4-1.8 times as wide as the ankle end
FLARE = 1.3  # least ratio of the ankle end's width to the narrowest shaft's: chosen, ankles have 1.6-2

MALLEOLUS_M = 3e-3
"""How far the medial malleolus stands below the rest of the end at least; chosen, usual are 10-15 mm."""

_BEHIND_M = 5e-3  # chosen: the fibula's head lies 10-25 mm behind the middle of the plateau


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
    vertices: Array, faces: NDArray[np.integer], *, named_side: Side | None = None
) -> tuple[BoneLandmarks, TibiaFrame]:
    """Landmarks of a tibia of unknown orientation and side, the fibula joined, apart or absent.

    ``vertices``: (n, 3), m. ``faces``: (m, 3). ``named_side`` {"r", "l"}: what the bone is called; believed
    only where its shape does not tell. Returns points ``ankle_centre`` (midpoint of the malleoli's tips; Wu
    et al. 2002), the tips and the prominences of the malleoli, ``fibula_head``, ``plateau_medial`` and
    ``plateau_lateral``. Raises MeshRefused: it is no tibia, or holds a second one.
    """
    surface = prepare(vertices, faces)
    shank = separate_fibula(surface)
    tibia, fibula = shank.tibia, shank.fibula
    require_long(tibia, "tibia")
    if fibula is None:
        _refuse_femur(tibia)
    up, height, plateau = _find_proximal_end(tibia)
    frame, side, side_from = _build_frame(tibia, fibula, up, plateau, named_side)
    outwards = frame.z if side == "r" else -frame.z
    points: dict[str, Array] = {}
    refused: dict[str, str] = {}
    ankle = height < ANKLE_M
    points["plateau_medial"] = find_tip(tibia, -outwards, plateau, SHARP_M)
    points["plateau_lateral"] = find_tip(tibia, outwards, plateau, SHARP_M)
    cut = _find_cut(tibia, up, height, outwards)
    if cut is not None:
        for name in ("malleolus_medial", "malleolus_lateral", "ankle_centre"):
            refused[name] = cut
        if fibula is not None:
            level = fibula.smooth @ up
            points["fibula_head"] = find_tip(fibula, up, level > level.max() - ANKLE_M, SHARP_M)
    else:
        points["malleolus_medial"] = find_tip(
            tibia, -up, ankle & _select_medial(tibia, outwards, ankle), SHARP_M
        )
        points["malleolus_medial_prominence"] = find_tip(tibia, -outwards, ankle, SHARP_M)
        _add_fibula(fibula, up, outwards, points, refused)
    if shank.joined and points.pop("fibula_head", None) is not None:
        # Along the shafts it is clear what is fibula; under the plateau it is not.
        refused["fibula_head"] = "the fibula is grown to the tibia, so its upper end cannot be told"
    image = {name: surface.to_image(point) for name, point in points.items()}
    landmarks = BoneLandmarks(
        bone="tibia",
        side=side,
        side_from=side_from,
        points=image,
        axes={"plateau": surface.turn_to_image(frame.z)},
        definitions=_DEFINITIONS,
        refused=refused,
        warnings=(*surface.notes, *shank.notes),
    )
    x, y, z = (surface.turn_to_image(axis) for axis in (frame.x, frame.y, frame.z))
    return landmarks, TibiaFrame(x, y, z, surface.to_image(surface.smooth))


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


def _find_cut(tibia: Surface, up: Array, height: Array, outwards: Array) -> str | None:
    """Why the distal end is no ankle: it does not flare, or no malleolus stands below the rest."""
    total = float(height.max())
    levels = np.linspace(0.25, 0.6, 8)
    shaft = [_measure_width(tibia, up, np.abs(height - x * total) < 0.02 * total) for x in levels]
    end = _measure_width(tibia, up, height < ANKLE_M)
    if end < FLARE * min(shaft):
        return f"the distal end is {1e3 * end:.0f} mm wide, no wider than a shaft: it is cut off"
    along = tibia.smooth @ outwards
    ankle = height < ANKLE_M
    middle = 0.5 * float(along[ankle].max() + along[ankle].min())
    below = float(height[ankle & (along > middle)].min())
    if below < MALLEOLUS_M:
        return f"the medial malleolus stands {1e3 * below:.0f} mm below the rest: the end is cut off"
    return None


def _refuse_femur(tibia: Surface) -> None:
    """A bone without fibula that bears a femoral head is a femur."""
    balls = find_spheres(tibia, HEAD_RADII_M)
    if balls and balls[0].covered >= HEAD_COVERED:
        raise MeshRefused(
            f"it bears a ball that covers {balls[0].covered:.2f} of its sphere, as a femur's head",
            remedy="Give the surface of a tibia, with or without its fibula",
        )


def _add_fibula(
    fibula: Surface | None, up: Array, outwards: Array, points: dict[str, Array], refused: dict[str, str]
) -> None:
    if fibula is None:
        for name in ("malleolus_lateral", "malleolus_lateral_prominence", "fibula_head", "ankle_centre"):
            refused[name] = "there is no fibula in the surface"
        return
    height = fibula.smooth @ up
    low = height < height.min() + ANKLE_M
    points["fibula_head"] = find_tip(fibula, up, height > height.max() - ANKLE_M, SHARP_M)
    points["malleolus_lateral"] = find_tip(fibula, -up, low, SHARP_M)
    points["malleolus_lateral_prominence"] = find_tip(fibula, outwards, low, SHARP_M)
    apart = float(np.linalg.norm(points["malleolus_medial"] - points["malleolus_lateral"]))
    if 0.03 <= apart <= 0.09:  # intermalleolar widths of 55-75 mm in adults; a child's to a giant's
        points["ankle_centre"] = 0.5 * (points["malleolus_medial"] + points["malleolus_lateral"])
    else:
        refused["ankle_centre"] = f"the malleoli lie {1e3 * apart:.0f} mm apart"


def _find_proximal_end(tibia: Surface) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Unit vector to the plateau, heights above the other end, and the plateau's block."""
    axis = tibia.widest_direction()
    along = tibia.smooth @ axis
    ends = {sign: sign * along > (sign * along).max() - PLATEAU_M for sign in (-1.0, 1.0)}
    widths = {sign: _measure_width(tibia, axis, chosen) for sign, chosen in ends.items()}
    sign = max(widths, key=lambda s: widths[s])
    if widths[sign] < WIDER * widths[-sign]:
        raise MeshRefused(
            f"its ends are {1e3 * widths[sign]:.0f} and {1e3 * widths[-sign]:.0f} mm wide, "
            "no plateau and ankle",
            remedy="Give the surface of a tibia, with or without its fibula",
        )
    if not PLATEAU_WIDTH_M[0] <= widths[sign] <= PLATEAU_WIDTH_M[1]:
        raise MeshRefused(
            f"its plateau is {1e3 * widths[sign]:.0f} mm wide; a tibia's has 45-110 mm",
            remedy="Give the surface of a tibia; check the unit",
        )
    height = sign * along
    return sign * axis, height - height.min(), ends[sign]


def _measure_width(surface: Surface, axis: Array, chosen: NDArray[np.bool_]) -> float:
    """Largest extent across an axis."""
    points = surface.smooth[chosen]
    flat = points - (points @ axis)[:, None] * axis
    centred = flat - flat.mean(axis=0)
    direction = np.linalg.eigh(centred.T @ centred)[1][:, 2]
    return float(np.ptp(points @ direction))


def _build_frame(
    tibia: Surface, fibula: Surface | None, up: Array, plateau: NDArray[np.bool_], named: Side | None
) -> tuple[TibiaFrame, Side, str]:
    """Across the plateau lies medial-lateral; the fibula's head is lateral and behind."""
    middle, wide = tibia.middle(plateau), tibia.widest_direction(plateau, across=up)
    ahead = np.cross(up, wide)
    behind = _measure_behind(tibia, fibula, up, middle, ahead)
    if behind > 0:
        ahead, wide = -ahead, -wide
    if abs(behind) < _BEHIND_M:
        raise MeshRefused(
            "neither the fibula nor the tuberosity tells front from back",
            remedy="Give the whole tibia, with its fibula if there is one",
        )
    if fibula is None:
        if named is None:
            raise MeshRefused(
                "a tibia without its fibula does not tell left from right here",
                remedy="Name it tibia_r or tibia_l",
            )
        return TibiaFrame(ahead, up, wide, tibia.smooth), named, "name"
    head = _find_middle_of_end(fibula, up, 1.0)
    side: Side = "r" if float((head - middle) @ wide) > 0 else "l"
    return TibiaFrame(ahead, up, wide, tibia.smooth), side, "shape"


def _measure_behind(tibia: Surface, fibula: Surface | None, up: Array, middle: Array, ahead: Array) -> float:
    """How far what lies behind the plateau's middle stands along ``ahead``, m: negative if it is ahead."""
    if fibula is not None:
        return float((_find_middle_of_end(fibula, up, 1.0) - middle) @ ahead)
    height = tibia.smooth @ up
    level = height.max() - height
    # The tuberosity stands out in front between 25 and 60 mm below the plateau.
    chosen = (level > 0.025) & (level < 0.06)
    along = (tibia.smooth[chosen] - middle) @ ahead
    return -float(along.max() + along.min())


def _find_middle_of_end(bone: Surface, up: Array, sign: float) -> Array:
    height = sign * (bone.smooth @ up)
    return bone.middle(height > height.max() - PLATEAU_M)


def _select_medial(tibia: Surface, outwards: Array, ankle: NDArray[np.bool_]) -> NDArray[np.bool_]:
    along = tibia.smooth @ outwards
    chosen: NDArray[np.bool_] = along < 0.5 * float(along[ankle].max() + along[ankle].min())
    return chosen
