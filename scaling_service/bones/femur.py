"""The femur: hip centre, knee centre and axis, epicondyles, side."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scaling_service.bones import condyles, cuts, fits, pieces, results
from scaling_service.bones.deviations import Tip, add_definitions, deviate_line, deviate_sphere, find_tips
from scaling_service.bones.surface import Surface, prepare
from scaling_service.core.arrays import Array

FLARE = 1.3  # largest ratio of a cut end's width to the shaft's: chosen, an ankle has 1.6-2
_ELONGATED = 2.0  # chosen: length over thickness below which the shaft need not be the long axis
_HALF = 0.5  # heads cover 0.49-0.85 of their spheres, other balls on an end 0.22-0.43
_SHORTEST_M = 0.05  # chosen: a head with its neck
AXES_APART_DEG = 3.0  # sphere axis against cylinder axis, above which a warning is given (contract)

HEAD_RADII_M = (0.015, 0.032)
"""Heads of adults are 42.5 (2.2) to 48 (2.5) mm wide; wider by 4 SD, and down to a child's."""

HEAD_COVERED = 0.42
"""Least covered share of the head: heads reach 0.49-0.85, the other end 0.22-0.38 (field experience)."""

HEAD_RMS = 0.08  # largest rms as a share of the radius: chosen, nearly four times that of rough MRI (0.022)

ROUND = 0.12
"""Most by which a head is longer along one direction than along another, as a share: chosen, twice the 0.03
to 0.06 of three persons (two CT, one MRI). An image stretched by a quarter along an axis gives 0.19 or
more."""

SET_OFF_M = 0.008
"""Least distance between head and shaft: chosen, whole femurs have 25-50 mm, a head cut off with its
trochanter 11."""

STRADDLING = 0.45
"""Least ratio of two condyles' distances from the line of the shaft: chosen below the 0.6-0.8 of four femurs;
a trochanter sits on the shaft, a head 24-38 mm beside it."""


def find_femur_landmarks(
    vertices: Array, faces: NDArray[np.integer], *, named_side: results.Side | None = None
) -> results.BoneLandmarks:
    """Landmarks of a femur of unknown orientation and side.

    ``vertices``: (n, 3), m. ``faces``: (m, 3). ``named_side`` {"r", "l"}: what the bone is called; believed
    only where its shape does not tell. Returns points ``hip_centre``, ``knee_centre``,
    ``epicondyle_medial`` and ``epicondyle_lateral``; spheres ``head``, ``condyle_medial``,
    ``condyle_lateral``; cylinder ``condyles``; axis ``knee``. Raises MeshRefused: it is no femur, is called
    by the wrong side, or neither of its ends can be used.

    Pillet et al. 2014 (sphere on the head); Kai et al. 2014 and Sauret et al. 2016 (condyles);
    Modenese & Renault 2021 (description only).
    """
    surface = prepare(vertices, faces)
    refused: dict[str, str] = {}
    ends = pieces.find_ends(surface)
    if ends is not None:
        return _find_on_ends(ends, named_side, refused)
    surface, notes = pieces.require_one_bone(surface, "femur")
    surface, piece = _stand_piece(surface)
    if not piece:
        pieces.require_long(surface, "femur")
    head = find_head(surface, refused, shaft=not piece)
    knee, reason = _find_knee_end(surface, None if piece else head)
    if piece and head is not None:  # one end shows either; a ball on condyles covers less than half
        if knee is None or head.covered > _HALF:
            knee, reason = None, "the surface is cut off above the knee"
        else:
            head, refused["hip_centre"] = None, "the surface is cut off below the hip"
    if knee is None:
        refused["knee_centre"] = reason
    elif head is None and not cuts.is_cut(surface, knee.frame.y) and _widens_distally(surface, knee):
        knee = None
        refused["knee_centre"] = "the other end flares but bears no head, as that of a tibia"
    if head is None and knee is None:
        raise results.MeshRefused(
            f"it is no femur that can be used: {refused['hip_centre']}; {refused['knee_centre']}",
            remedy="Give the surface of one femur, in the right unit",
        )
    side, side_from = _tell_side(surface, head, knee, named_side)
    return _collect(surface, head, knee, (side, side_from), refused, notes)


def _stand_piece(surface: Surface) -> tuple[Surface, bool]:
    """One end of a femur, not much longer than thick, along the normal of its cut; and whether it is such."""
    size = np.ptp(surface.points, axis=0)
    if size[0] > _ELONGATED * float(size[1:].max()) or size[0] < _SHORTEST_M:
        return surface, False
    normal = cuts.find_cut_plane(surface)
    return (surface, False) if normal is None else (surface.turn(normal), True)


def _find_on_ends(
    surface: Surface, named_side: results.Side | None, refused: dict[str, str]
) -> results.BoneLandmarks:
    """Landmarks of a femur without its shaft: its head stands medial of its trochanter, and it has a name."""
    pieces.require_long(surface, "femur")
    head = find_head(surface, refused, shaft=False)
    if head is None or named_side is None:
        raise results.MeshRefused(
            f"it is two pieces that are not the ends of a femur: {refused['hip_centre']}"
            if head is None
            else "both ends of a femur without its shaft do not tell left from right",
            remedy="Name it femur_r or femur_l, and give head and condyles in one image frame",
        )
    upper = np.sign(surface.smooth[:, 0]) == np.sign(head.centre[0])
    medial = (head.centre - surface.middle(upper)) * (0.0, 1.0, 1.0)
    rightward = -medial if named_side == "r" else medial
    found = condyles.find_knee(surface, -float(np.sign(head.centre[0])), rightward)
    if isinstance(found, str):
        refused["knee_centre"] = found
    knee = None if isinstance(found, str) else found
    notes = ["the shaft is missing: left and right are as the bone is called, not seen on it"]
    return _collect(surface, head, knee, (named_side, "name"), refused, notes)


def _find_knee_end(surface: Surface, head: fits.SphereOnBone | None) -> tuple[condyles.Knee | None, str]:
    """The knee at the end without the head (at either without one), or why there is none."""
    ends = [1.0, -1.0] if head is None else [-float(np.sign(head.centre[0]))]
    tried = [condyles.find_knee(surface, end) for end in ends]
    found = [knee for knee in tried if not isinstance(knee, str)]
    if found:
        return max(found, key=lambda knee: knee.least_covered), ""
    return None, next(reason for reason in tried if isinstance(reason, str))


def _widens_distally(surface: Surface, knee: condyles.Knee) -> bool:
    """Whether the far end is wider than the shaft: a femur without its head is cut through the shaft."""
    height = knee.frame.height / float(knee.frame.height.max())
    widths = []
    for level in (0.5, 0.6, 0.7, 0.96):
        points = surface.smooth[np.abs(height - level) < 0.03][:, 1:]
        widths.append(float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0)
    return widths[-1] > FLARE * min(widths[:-1])


def _tell_side(
    surface: Surface, head: fits.SphereOnBone | None, knee: condyles.Knee | None, named: results.Side | None
) -> tuple[results.Side, str]:
    """The head lies medial of the shaft; a bone without one of its ends is what it is called."""
    if head is None or knee is None:
        if named is None:
            raise results.MeshRefused(
                "only one end of the femur can be used, which does not tell left from right",
                remedy="Name it femur_r or femur_l",
            )
        return named, "name"
    level = knee.frame.height / float(knee.frame.height.max())
    shaft = (level > 0.3) & (level < 0.7)
    # Across the shaft only: the knee axis is a few degrees off square, which is 30 mm at the hip.
    right = knee.frame.z - float(knee.frame.z @ knee.frame.y) * knee.frame.y
    medial = float((head.centre - surface.middle(shaft)) @ right)
    if abs(medial) < 10e-3:  # chosen: a head stands 30-50 mm medial of the shaft
        raise results.MeshRefused(
            f"the head stands {1e3 * abs(medial):.0f} mm beside the shaft, so left and right are not clear",
            remedy="Check that the bone is whole and not deformed",
        )
    side: results.Side = "r" if medial < 0 else "l"
    return side, "shape"


def _collect(
    surface: Surface,
    head: fits.SphereOnBone | None,
    knee: condyles.Knee | None,
    side: tuple[results.Side, str],
    refused: dict[str, str],
    notes: list[str],
) -> results.BoneLandmarks:
    points: dict[str, Array] = {}
    balls: dict[str, results.Sphere] = {}
    cylinders: dict[str, results.Cylinder] = {}
    axes: dict[str, Array] = {}
    off: dict[str, float] = {}
    turned: dict[str, float] = {}
    if head is not None:
        points["hip_centre"] = surface.to_image(head.centre)
        balls["head"] = fits.place_sphere(surface, head)
        off["hip_centre"] = deviate_sphere(surface, head)
        oblong, direction = fits.measure_stretch(surface, head)
        if oblong > ROUND:
            axis = "xyz"[int(np.argmax(np.abs(surface.turn_to_image(direction))))]
            notes.append(
                f"its head is no ball: its radii differ by {oblong:.0%}, most along the image's {axis}, "
                "while heads are round within 6 %. Check the spacing of voxels and slices: if the image is "
                "stretched, so is every distance (a diseased head may be so, too)"
            )
    if knee is not None:
        medial, lateral = (knee.low, knee.high) if side[0] == "r" else (knee.high, knee.low)
        points["knee_centre"] = surface.to_image(knee.centre)
        axes["knee"] = surface.turn_to_image(knee.axis)
        balls["condyle_medial"] = fits.place_sphere(surface, medial)
        balls["condyle_lateral"] = fits.place_sphere(surface, lateral)
        centres = deviate_sphere(surface, medial), deviate_sphere(surface, lateral)
        off["knee_centre"] = 0.5 * float(np.hypot(*centres))
        turned["knee"] = deviate_line(float(np.linalg.norm(medial.centre - lateral.centre)), *centres)
        outwards = knee.axis if side[0] == "r" else -knee.axis
        tips = {
            "epicondyle_lateral": Tip(surface, outwards, knee.distal),
            "epicondyle_medial": Tip(surface, -outwards, knee.distal),
        }
        ends, cut = find_tips(tips)
        refused |= cut
        off |= {name: tips[name].deviate() for name in ends}
        points |= {name: surface.to_image(point) for name, point in ends.items()}
        notes += _note_axes(surface, knee, cylinders)
    deviations, axis_deviations = add_definitions(off, turned)
    return results.BoneLandmarks(
        bone="femur",
        side=side[0],
        side_from=side[1],
        points=points,
        deviations=deviations,
        axis_deviations=axis_deviations,
        spheres=balls,
        cylinders=cylinders,
        axes=axes,
        definitions={
            "hip_centre": "centre of the least-squares sphere on the femoral head",
            "knee_centre": "midpoint of the centres of the spheres on the condyles",
            "epicondyle_medial": "furthest point along the knee axis",
            "epicondyle_lateral": "furthest point along the knee axis",
        },
        refused=refused,
        warnings=(*surface.notes, *notes),
    )


def _note_axes(surface: Surface, knee: condyles.Knee, cylinders: dict[str, results.Cylinder]) -> list[str]:
    """Adds the cylinder; says where the two axes differ."""
    found = knee.cylinder
    if found is None:
        return ["no cylinder fits both condyles"]
    axis = found.direction * np.sign(found.direction @ knee.axis)
    quality = results.Quality(found.rms, found.covered)
    cylinders["condyles"] = results.Cylinder(
        surface.to_image(found.point + axis * float(axis @ (knee.centre - found.point))),
        surface.turn_to_image(axis),
        found.radius,
        quality,
    )
    apart = float(np.rad2deg(np.arccos(min(1.0, float(axis @ knee.axis)))))
    if apart <= AXES_APART_DEG:
        return []
    return [f"the axes through the spheres and of the cylinder differ by {apart:.1f} degrees"]


def find_head(surface: Surface, refused: dict[str, str], *, shaft: bool = True) -> fits.SphereOnBone | None:
    """The best covered sphere near an end of the bone, or None and the reason.

    ``shaft``: whether there is one, that a neck sets the head off from.
    """
    ends = surface.smooth[:, 0].min(), surface.smooth[:, 0].max()
    found = [
        ball
        for ball in fits.find_spheres(surface, HEAD_RADII_M)
        if min(abs(ball.centre[0] - ends[0]), abs(ball.centre[0] - ends[1])) < 2.5 * ball.radius
    ]
    if not found:
        refused["hip_centre"] = "no part of either end is a ball of a femoral head's size"
        return None
    best = found[0]
    if best.covered < HEAD_COVERED:
        refused["hip_centre"] = (
            f"the best ball covers {best.covered:.2f} of its sphere; a head covers {HEAD_COVERED} or more"
        )
        return None
    if best.rms > HEAD_RMS * best.radius:
        refused["hip_centre"] = f"the head is off its sphere by {1e3 * best.rms:.1f} mm rms"
        return None
    if any(_are_twins(surface, best, other) for other in found[1:]):
        refused["hip_centre"] = "there are two balls alike side by side, as condyles"
        return None
    offset = _measure_offset(surface, best)
    if shaft and offset < SET_OFF_M:
        refused["hip_centre"] = (
            f"the ball stands {1e3 * offset:.0f} mm beside the shaft; a neck sets a head off by 30-50 mm"
        )
        return None
    return best


def _are_twins(surface: Surface, a: fits.SphereOnBone, b: fits.SphereOnBone) -> bool:
    """Whether two balls are alike, as far apart as condyles, and stand on both sides of the shaft.

    A round greater trochanter can be as well covered as a head, but it sits on the shaft.
    """
    apart = float(np.linalg.norm(a.centre - b.centre))
    offsets = _measure_offset(surface, a), _measure_offset(surface, b)
    return (
        min(a.covered, b.covered) > 0.75 * max(a.covered, b.covered)
        and max(a.radius, b.radius) < 1.25 * min(a.radius, b.radius)
        and 0.03 < apart < 0.07
        and min(offsets) > STRADDLING * max(offsets)
    )


def _measure_offset(surface: Surface, head: fits.SphereOnBone) -> float:
    """Distance of the head's centre from the line of the shaft, m."""
    far = np.abs(surface.smooth[:, 0] - head.centre[0])
    shaft = (far > 0.35 * far.max()) & (far < 0.75 * far.max())
    if int(shaft.sum()) < 20:
        return 0.0
    return float(np.linalg.norm((head.centre - surface.middle(shaft))[1:]))
