"""A person's joint centres from what there is: pelvis markers, medial markers, half widths.

Hips come from a regression on the pelvis; a knee or an ankle is the middle of its two epicondyles or malleoli
where both were marked, else by the chord construction of the conventional gait model from the lateral marker
and half the joint's width (Kadaba et al. 1990, Davis et al. 1991). Every centre says how it was found and how
far it may be off beside the markers' own errors, whose sizes stand here, too.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.model.anatomy import frames, hip_centre
from scaling_service.model.anatomy.marker_sets import find_plane_marker

Vector = tuple[float, float, float]

LANDMARK_SD_M: Mapping[str, Vector] = MappingProxyType(
    {
        "ASIS": (0.007, 0.007, 0.007),
        "PSIS": (0.006, 0.008, 0.006),
        "SACR": (0.006, 0.008, 0.006),
        "LFE": (0.005, 0.005, 0.004),
        "MFE": (0.005, 0.005, 0.004),
        "FH": (0.004, 0.005, 0.004),
        "LM": (0.003, 0.003, 0.003),
        "MM": (0.003, 0.003, 0.003),
    }
)
"""Standard deviation of a marker's place about its landmark, x, y, z of the segment, of adults. Proposed from
the overall errors of Della Croce et al. 1999, 2005 (6-21 mm within, 13-25 mm between examiners); the sacrum's
is a PSIS'."""

ADULT_STATURE_M = 1.70
"""Of the adults on whom palpation was studied (chosen); errors are taken to grow with stature."""

OTHER_SD_M: Vector = (0.006, 0.006, 0.006)
"""Chosen: of landmarks that those studies did not have (foot, trunk, arm), the middle of theirs."""

CALIPER_SD_M = 0.003
"""Chosen: of a width measured over skin with a caliper; makers of calipers state 1 mm, skin yields more."""

CALIPER_ASIS_SD_M = 0.005
"""Chosen: between the ASIS, which are palpated each time; half of what two markers leave (7 mm each)."""

TAPE_SD = 0.03
"""Chosen, relative: a tape from ASIS over the knee to the malleolus against the straight line."""

_SIZE_SD_M: Mapping[str, float] = MappingProxyType({"asis_width": CALIPER_ASIS_SD_M})

SIDES: tuple[Side, Side] = ("r", "l")

MARKER_RADIUS_M = 0.007
"""Chosen: of the usual balls of 14 mm, where the recording does not say."""

JOINT_SD_M = 0.003
"""Chosen, along each axis: the middle of epicondyles or malleoli against the centre in which the bones turn.
The malleoli's tips have theirs 4 mm off that of the talus' sphere."""

MALLEOLUS_DROP_M = 0.005
"""The lateral malleolus lies 10 mm lower than the medial one (TLEM, lower_limb_14dof), so the ankle centre is
half of that above the point that the chord construction finds at its level."""

COMMON_PLANE_DEG = 35.0
"""Chosen: a thigh or shank marker by which the joint's plane is turned further than this against the pelvis
or the knee is no marker of that plane; standing feet turn out by 10 to 20 degrees."""

REGRESSION_SD_M: Mapping[str, Vector] = MappingProxyType(
    {
        "harrington2007": (0.0052, 0.0045, 0.0038),
        "harrington2007_multi": (0.0052, 0.0036, 0.0032),
        "harrington2007_single": (0.0052, 0.0045, 0.0038),
        "hara2016": (0.0052, 0.0044, 0.0038),
    }
)
"""Leave-one-out errors of the regressions along x, y, z, from bony landmarks (Harrington 2007, Hara 2016). Of
the form with single predictors, which ``harrington2007`` is, y and z are chosen a fifth to a quarter more."""

_TITLES: Mapping[str, str] = MappingProxyType(
    {
        "harrington2007": "Harrington 2007",
        "harrington2007_multi": "Harrington 2007",
        "harrington2007_single": "Harrington 2007 (single predictors)",
        "bell1990": "Bell 1990",
        "hara2016": "Hara 2016",
        "davis1991": "Davis 1991",
        "plug_in_gait": "Plug-in Gait",
    }
)

_OTHER_SD_M: Vector = (0.011, 0.011, 0.011)
"""Bell 1990: 19 mm on average, which is 11 mm along each axis; others are no better (Mantovani 2016: Davis 25
mm against 12 mm of Harrington's, from markers)."""

_JOINTS: Mapping[Joint, tuple[str, str, str]] = MappingProxyType(
    {"knee": ("hip", "LFE", "MFE"), "ankle": ("knee", "LM", "MM")}
)
"""Joint to the joint above, its lateral and its medial landmark."""


def size_sd(name: str, value: float) -> float:
    """Standard deviation (m) of a size measured by hand, by its name in ``sizes``.

    Examples
    --------
    >>> size_sd("knee_width_r", 0.104), size_sd("leg_length_r", 0.8)
    (0.003, 0.024)
    """
    return TAPE_SD * value if name.startswith("leg_length") else _SIZE_SD_M.get(name, CALIPER_SD_M)


def look_up_landmark_sd(landmark: str) -> Vector:
    """Standard deviation (m) of a marker about its landmark, by canonical name.

    Examples
    --------
    >>> look_up_landmark_sd("RASIS"), look_up_landmark_sd("C7")
    ((0.007, 0.007, 0.007), (0.006, 0.006, 0.006))
    """
    return LANDMARK_SD_M.get(landmark) or LANDMARK_SD_M.get(landmark[1:], OTHER_SD_M)


Joint = Literal["knee", "ankle"]
Side = Literal["r", "l"]
Points = Mapping[str, Array]
"""Canonical landmark to its trajectory, (n_frames, 3), m."""


Size = float | Array
"""A length, m, of the whole recording or of each frame."""


@dataclasses.dataclass(frozen=True, slots=True)
class BodySizes:
    """Sizes that the construction needs beside markers, m."""

    widths: Mapping[str, tuple[Size, float]] = dataclasses.field(default_factory=lambda: MappingProxyType({}))
    """``knee_r``, ``ankle_l`` … to the joint's width over the skin and its standard deviation."""
    leg_lengths: Mapping[str, float] = dataclasses.field(default_factory=lambda: MappingProxyType({}))
    """``r`` and ``l`` to the length from ASIS to medial malleolus."""
    marker_radius: float = MARKER_RADIUS_M

    def with_leg_lengths(self, measured: Mapping[str, float]) -> BodySizes:
        """The same with leg lengths where there are none yet."""
        return dataclasses.replace(self, leg_lengths={**measured, **self.leg_lengths})


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Centre:
    """A joint centre over time."""

    at: Array  # (n_frames, 3), m: NaN where it cannot be constructed
    source: str  # how it was found, in plain words
    sd: Vector
    """(3,) m: standard deviation of the construction itself along x, y, z of the pelvis, beside the errors
    of the markers and sizes that it rests on."""
    kind: Literal["regression", "functional", "middle", "chord"]
    """``regression``, ``functional``, ``middle`` of two landmarks, or ``chord``."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Pelvis:
    """The pelvis' landmarks as the regressions want them, and what stands for what."""

    rasis: Array
    lasis: Array
    back: Array
    source: str

    @property
    def frame(self) -> frames.Frames:
        """Origin half-way between the ASIS (Wu 2002 but for the origin)."""
        return frames.build_pelvis_frame(self.rasis, self.lasis, self.back, self.back)


def with_mirrored_psis(points: Points) -> Points:
    """The points with a PSIS that is not there as the mirror image of the other one, between the ASIS."""
    known = [name for name in ("RPSIS", "LPSIS") if name in points and _is_ever_known(points[name])]
    if len(known) != 1 or not {"RASIS", "LASIS"} <= points.keys():
        return points
    rasis, lasis, own = points["RASIS"], points["LASIS"], points[known[0]]
    across = rasis - lasis
    across = across / np.linalg.norm(across, axis=1, keepdims=True)
    off = np.sum((own - (rasis + lasis) / 2.0) * across, axis=1, keepdims=True)
    other = "LPSIS" if known[0] == "RPSIS" else "RPSIS"
    return {**points, other: own - 2.0 * off * across}


def read_pelvis(points: Points) -> Pelvis | None:
    """Both ASIS and the back of the pelvis; None where it is not there.

    The back is the middle of both PSIS, else the sacrum, else the middle of one PSIS and its mirror image.
    """
    if not {"RASIS", "LASIS"} <= points.keys():
        return None
    front = points["RASIS"], points["LASIS"]
    psis = [points[name] for name in ("RPSIS", "LPSIS") if name in points]
    if len(psis) == 2 and _is_ever_known(psis[0] + psis[1]):
        return Pelvis(*front, (psis[0] + psis[1]) / 2.0, "both PSIS")
    if "SACR" in points and _is_ever_known(points["SACR"]):
        return Pelvis(*front, points["SACR"], "the sacrum for both PSIS")
    both = with_mirrored_psis(points)
    if both is points:
        return None
    return Pelvis(*front, (both["RPSIS"] + both["LPSIS"]) / 2.0, "one PSIS and its mirror image")


def _is_ever_known(trajectory: Array) -> bool:
    return bool(np.isfinite(trajectory).all(axis=1).any())


def construct_centres(
    points: Points,
    sizes: BodySizes,
    regression: str,
    *,
    hips: Points | None = None,
    errors: Points | None = None,
) -> dict[str, Centre]:
    """All joint centres of hips, knees and ankles that a recording's markers give, in every frame.

    ``points``: canonical landmarks; ``RTHI``, ``RTIB`` … where a conventional set has them. ``regression``:
    as ``hip_centres`` takes it. ``hips``: hip centres (``hip_r``) that are known better than by regression,
    (n_frames, 3), m. ``errors``: centre to an offset along x, y, z of the pelvis that is added to it,
    (n_frames, 3), m: how errors of one construction are carried on to the next. Returns ``hip_r``,
    ``knee_r``, ``ankle_r`` and the left ones; ``ankle_r_chord`` where ``ankle_r`` is another.
    """
    pelvis = read_pelvis(points)
    found = {} if pelvis is None else _construct_hips(pelvis, sizes, regression)
    found |= {
        name: Centre(at, "functional movements", (0.0, 0.0, 0.0), "functional")
        for name, at in (hips or {}).items()
    }
    axes = None if pelvis is None else pelvis.frame.rotation

    def keep(name: str, centre: Centre | None) -> None:
        offset = (errors or {}).get(name)
        if centre is not None and offset is not None:
            offset = offset if axes is None else np.einsum("nij,nj->ni", axes, offset)
            centre = dataclasses.replace(centre, at=centre.at + offset)
        if centre is not None:
            found[name] = centre

    for name, centre in tuple(found.items()):
        keep(name, centre)
    for joint in _JOINTS:
        for side in SIDES:
            # Half-way between a joint's lateral and medial landmark
            _, lateral, medial = _JOINTS[joint]
            ends = [points.get(f"{side.upper()}{name}") for name in (lateral, medial)]
            if ends[0] is None or ends[1] is None or not _is_ever_known(ends[0] + ends[1]):
                middle = None
            else:
                how = "the middle of its lateral and medial marker"
                middle = Centre((ends[0] + ends[1]) / 2.0, how, (JOINT_SD_M,) * 3, "middle")
            chord = _construct_chord(points, found, sizes, joint, side, axes)
            keep(f"{joint}_{side}", middle or chord)
            if joint == "ankle" and middle is not None:
                keep(f"{joint}_{side}_chord", chord)
    return found


def _construct_hips(pelvis: Pelvis, sizes: BodySizes, regression: str) -> dict[str, Centre]:
    found = hip_centre.predict_hip_centres(
        pelvis.rasis,
        pelvis.lasis,
        pelvis.back,
        pelvis.back,
        regression=regression,
        leg_length_r=sizes.leg_lengths.get("r"),
        leg_length_l=sizes.leg_lengths.get("l"),
        marker_radius=sizes.marker_radius,
    )
    how = f"{_TITLES.get(regression, regression)}, {pelvis.source}"
    sd = REGRESSION_SD_M.get(regression, _OTHER_SD_M)
    return {
        f"hip_{side}": Centre(at, how, sd, "regression")
        for side, at in (("r", found.right_ground), ("l", found.left_ground))
    }


def _construct_chord(
    points: Points,
    found: Mapping[str, Centre],
    sizes: BodySizes,
    joint: Joint,
    side: Side,
    axes: Array | None,
) -> Centre | None:
    """Half the joint's width from its lateral marker, in the segment's side plane if that was marked."""
    above, lateral, _ = _JOINTS[joint]
    outer = points.get(f"{side.upper()}{lateral}")
    start = found.get(f"{above}_{side}")
    width = sizes.widths.get(f"{joint}_{side}")
    # Where a joint's lateral side is, (n_frames, 3): a knee's as the pelvis', an ankle's as the knee's.
    if joint == "ankle" and f"knee_{side}" in found and f"{side.upper()}LFE" in points:
        outward = np.asarray(points[f"{side.upper()}LFE"] - found[f"knee_{side}"].at)
    elif axes is None:
        outward = None
    else:
        outward = np.asarray(axes[:, :, 2] * (1.0 if side == "r" else -1.0))
    if outer is None or start is None or width is None or outward is None:
        return None
    plane, how = outer + outward, "across from the pelvis" if joint == "knee" else "across from the knee"
    label = find_plane_marker(tuple(points), joint, side)
    if label is not None and _is_plane_marker(start.at, outer, points[label], outward):
        plane, how = points[label], f"in the plane of {label}"
    at = hip_centre.solve_chord_centre(start.at, outer, plane, width[0] / 2.0 + sizes.marker_radius)
    if joint == "ankle":
        at = lift_ankle(at, start.at)
    source = f"half its width from the lateral marker, {how}"
    return Centre(at, source, (JOINT_SD_M,) * 3, "chord") if _is_ever_known(at) else None


def lift_ankle(found: Array, knee: Array) -> Array:
    """The ankle's centre from where the chord construction finds it at the lateral malleolus' level."""
    along = knee - found
    return np.asarray(found + MALLEOLUS_DROP_M * along / np.linalg.norm(along, axis=1, keepdims=True))


def _is_plane_marker(start: Array, lateral: Array, wand: Array, outward: Array) -> bool:
    """Whether a marker lies to the segment's side as a marker of the joint's plane does."""
    along = start - lateral
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    across = [v - np.sum(v * along, axis=1, keepdims=True) * along for v in (wand - lateral, outward)]
    cosine = np.sum(across[0] * across[1], axis=1) / np.prod(
        [np.linalg.norm(v, axis=1) for v in across], axis=0
    )
    known = cosine[np.isfinite(cosine)]
    return bool(len(known) and np.median(known) > np.cos(np.radians(COMMON_PLANE_DEG)))
