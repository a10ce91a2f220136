"""Which way a shank lies: whole, or the piece of it at the knee or at the ankle that an image shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scaling_service.bones import cuts
from scaling_service.bones.pieces import Shank
from scaling_service.bones.results import MeshRefused, Side
from scaling_service.bones.surface import Surface
from scaling_service.core.arrays import Array, Mask

PLATEAU_M = 0.02  # height of the block that holds the plateau: chosen, above the tuberosity
PLATEAU_WIDTH_M = (0.045, 0.11)  # width of a plateau from a child to a giant; adults have 65-85 mm
WIDER = 1.2  # least ratio of the ends' widths: chosen, a plateau is 1.4-1.8 times as wide as the ankle end

_BEHIND_M = 5e-3  # chosen: the fibula's head lies 10-25 mm behind the middle of the plateau
_ELONGATED = 2.0  # chosen: least length over thickness of a tibia whose own long axis is its shaft's

_SHORT_OF_M = {"knee": (0.013, 0.005), "ankle": (-0.008, 0.005)}
"""How far the fibula ends short of the tibia, mean and deviation: its head 10-15 mm below the plateau, its
malleolus 5-10 mm below the tibia's; twice the range as the deviation."""
_WIDE_M = {"knee": (0.074, 0.007), "ankle": (0.048, 0.006)}
"""How wide the tibia's ends are: plateaus of 65-85 mm (both sexes), ankles of 1/1.4-1/1.8 of them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShankPose:
    """Anterior, proximal and right unit vectors of a shank in its surface's frame, and what of it there is.

    ``height`` (n,), m: of the tibia's vertices above its lower end. ``plateau``: those of its upper end, None
    where that is cut off.
    """

    x: Array
    y: Array
    z: Array
    height: Array
    plateau: Mask | None
    side: Side
    side_from: str

    @property
    def outwards(self) -> Array:
        """Unit vector to the lateral side."""
        return self.z if self.side == "r" else -self.z


def find_shank_pose(shank: Shank, named: Side | None) -> ShankPose:
    """From the ends that are not cut off.

    Raises MeshRefused: none is left, or what is left is no plateau and no ankle.
    """
    tibia, fibula = shank.tibia, shank.fibula
    axis = _find_shaft(tibia, fibula)
    cut = {sign: cuts.is_cut(tibia, sign * axis) for sign in (-1.0, 1.0)}
    if all(cut.values()):
        raise MeshRefused(
            "both of its ends are cut off: a shaft has no landmarks",
            remedy="Give the end at the knee or at the ankle, or both",
        )
    if not any(cut.values()):
        up, plateau = _find_proximal_end(tibia, axis)
        return _look_from_plateau(tibia, fibula, up, plateau, named)
    end = next(sign for sign in (-1.0, 1.0) if not cut[sign]) * axis
    if _tell_end(tibia, fibula, end) == "knee":
        level = tibia.smooth @ end
        return _look_from_plateau(tibia, fibula, end, level > level.max() - PLATEAU_M, named)
    return _look_from_ankle(tibia, fibula, -end, named)


def measure_width(surface: Surface, axis: Array, chosen: Mask) -> float:
    """Largest extent across an axis, m."""
    points = surface.smooth[chosen]
    flat = points - (points @ axis)[:, None] * axis
    centred = flat - flat.mean(axis=0)
    direction = np.linalg.eigh(centred.T @ centred)[1][:, 2]
    return float(np.ptp(points @ direction))


def _find_shaft(tibia: Surface, fibula: Surface | None) -> Array:
    """Along the shank; of a piece hardly longer than thick between the fibula, which is thin, and its cut."""
    own = tibia.widest_direction()
    if fibula is None:
        return own
    across = tibia.smooth - (tibia.smooth @ own)[:, None] * own
    thickness = 2.0 * float(np.linalg.norm(across - across.mean(axis=0), axis=1).max())
    if float(np.ptp(tibia.smooth @ own)) > _ELONGATED * thickness:
        return own
    thin, normal = fibula.widest_direction(), cuts.find_cut_plane(tibia)
    if normal is None:
        return thin
    both = normal + thin * np.sign(thin @ normal)
    return np.asarray(both / np.linalg.norm(both))


def _tell_end(tibia: Surface, fibula: Surface | None, outward: Array) -> str:
    """Whether the end in a direction is the likelier one of a knee or of an ankle."""
    level = tibia.smooth @ outward
    width = measure_width(tibia, outward, level > level.max() - PLATEAU_M)
    unlike = {end: ((width - mean) / sd) ** 2 for end, (mean, sd) in _WIDE_M.items()}
    if fibula is not None:
        short = float(level.max() - (fibula.smooth @ outward).max())
        for end, (mean, sd) in _SHORT_OF_M.items():
            unlike[end] += ((short - mean) / sd) ** 2
    return min(unlike, key=lambda end: unlike[end])


def _find_proximal_end(tibia: Surface, axis: Array) -> tuple[Array, Mask]:
    """Unit vector to the plateau, and the plateau's block."""
    along = tibia.smooth @ axis
    ends = {sign: sign * along > (sign * along).max() - PLATEAU_M for sign in (-1.0, 1.0)}
    widths = {sign: measure_width(tibia, axis, chosen) for sign, chosen in ends.items()}
    sign = max(widths, key=lambda s: widths[s])
    if widths[sign] < WIDER * widths[-sign]:
        raise MeshRefused(
            f"its ends are {1e3 * widths[sign]:.0f} and {1e3 * widths[-sign]:.0f} mm wide, "
            "no plateau and ankle",
            remedy="Give the surface of a tibia, with or without its fibula",
        )
    return sign * axis, ends[sign]


def _look_from_plateau(
    tibia: Surface, fibula: Surface | None, up: Array, plateau: Mask, named: Side | None
) -> ShankPose:
    """Across the plateau lies medial-lateral; the fibula's head is lateral and behind."""
    width = measure_width(tibia, up, plateau)
    if not PLATEAU_WIDTH_M[0] <= width <= PLATEAU_WIDTH_M[1]:
        raise MeshRefused(
            f"its plateau is {1e3 * width:.0f} mm wide; a tibia's has 45-110 mm",
            remedy="Give the surface of a tibia; check the unit",
        )
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
    if fibula is not None:
        head = _find_middle_of_end(fibula, up, 1.0)
        shown: Side = "r" if float((head - middle) @ wide) > 0 else "l"
        side, side_from = shown, "shape"
    elif named is not None:
        side, side_from = named, "name"
    else:
        raise MeshRefused(
            "a tibia without its fibula does not tell left from right here",
            remedy="Name it tibia_r or tibia_l",
        )
    height = tibia.smooth @ up
    return ShankPose(
        x=ahead,
        y=up,
        z=wide,
        height=height - height.min(),
        plateau=plateau,
        side=side,
        side_from=side_from,
    )


def _look_from_ankle(tibia: Surface, fibula: Surface | None, up: Array, named: Side | None) -> ShankPose:
    """The fibula's malleolus is lateral, the tibia's medial; front and back follow from the name."""
    if named is None:
        raise MeshRefused(
            "the end of a shank at the ankle does not tell left from right",
            remedy="Name it tibia_r or tibia_l",
        )
    middle = _find_middle_of_end(tibia, up, -1.0)
    height = tibia.smooth @ up
    height = height - height.min()
    if fibula is not None:
        lateral = _find_middle_of_end(fibula, up, -1.0) - middle
    else:
        lateral = middle - tibia.smooth[int(np.argmin(height))]
    lateral = lateral - float(lateral @ up) * up
    lateral = lateral / np.linalg.norm(lateral)
    right = lateral if named == "r" else -lateral
    return ShankPose(
        x=np.cross(up, right), y=up, z=right, height=height, plateau=None, side=named, side_from="name"
    )


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
