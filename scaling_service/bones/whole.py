"""All bones of one image together: what one says about another, and what they say of a model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scaling_service.bones import results
from scaling_service.bones import tibia as tibias
from scaling_service.bones.femur import find_femur_landmarks
from scaling_service.bones.pelvis import find_pelvis_landmarks
from scaling_service.bones.talus import find_talus_landmarks
from scaling_service.core.arrays import Array
from scaling_service.core.names import say_name
from scaling_service.model import trial as trials
from scaling_service.model.body import Vector

Mesh = tuple[Array, NDArray[np.integer]]

BONES = ("pelvis", "femur_r", "tibia_r", "talus_r", "femur_l", "tibia_l", "talus_l")
"""Names of bones, the sides as in the built-in models."""

_TALUS_ALONE = "a talus alone does not show which of its facets is the trochlea"

SIZE_M: Mapping[str, tuple[float, float]] = {
    "pelvis": (0.15, 0.45),
    "femur": (0.08, 0.64),
    "tibia": (0.05, 0.49),
    "talus": (0.03, 0.09),
}
"""Largest extents, parts of long bones included. Each range spans less than a factor of ten, so that
no two of mm, cm and m can both be right."""

UNITS: Mapping[str, float] = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}  # metres in a unit

_JOINT_GAP_M = 0.02  # chosen: a head sits within 5 mm of its socket, posed images included
_OTHER_FRAME_M = 0.06  # chosen: beyond it, head and socket are no joint whatever the pose
_HEAD_IN_SOCKET = (0.65, 1.05)
"""Chosen: radius of a head over its socket's; 0.85 and 0.91 on two persons. Outside, they do not fit."""
_KNEE_GAP = (1.1, 2.0, 3.5)
"""Chosen: from the middle of the condyles to that of the plateaus over the condyles' radius, 1.55 to 1.6 on
three persons: below the first or above the second there is a warning, above the third they are no knee."""
_PLATEAU_TO_FEMUR = (0.78, 1.15)
"""Chosen: width of the plateau over that between the epicondyles, 0.91 to 0.98 on three persons.
Outside, tibia and femur are of persons of different size."""
_TURNED_DEG = 60.0
"""Chosen: between the axis of the condyles and the one across the plateau, which differ by a few degrees in
people and by 10-30 in a bent or turned knee; beyond it a tibia lies back to front or belongs elsewhere."""
_LENGTHS_APART = 0.06  # chosen: thrice the 2 % by which a person's legs differ at most usually
_CONDYLE_M = 0.02  # chosen: an adult's, where no sphere was fitted
_KNEE_ON_PLATEAU_M, _KNEE_ON_PLATEAU_SD = (-0.0046, 0.031, -0.0043), 0.004
"""From the middle of the plateaus to that of the condyles: forward, along the shank, to the lateral side,
m. The mean of three persons (two CT, one MRI); each is within 1.9 mm of the other two's. SD, in space: twice
that, chosen."""

_LENGTHS = {"femur": ("hip_centre", "knee_centre"), "tibia": ("plateau_medial", "malleolus_medial")}

_CENTRES = {
    "femur": {"hip_centre": "hip", "knee_centre": "knee"},
    "tibia": {"knee_centre": "knee", "ankle_centre": "ankle"},
    "talus": {"subtalar_centre": "subtalar"},
}
_LANDMARKS = {
    "pelvis": {"asis_r": "RASIS", "asis_l": "LASIS", "psis_r": "RPSIS", "psis_l": "LPSIS"},
    "femur": {"epicondyle_lateral": "LFE", "epicondyle_medial": "MFE"},
    "tibia": {"fibula_head": "FH", "malleolus_lateral": "LM", "malleolus_medial": "MM"},
}
"""Points on bone, by bone, and the markers that are put on them; of a leg without its side."""


def find_unit(extents: Mapping[str, float]) -> str:
    """The unit in which all bones have the size of bones.

    ``extents``: bone to the largest distance between two of its points, in the unknown unit. Raises
    MeshRefused: none, or not the same for all.

    Examples
    --------
    >>> find_unit({"femur_r": 445.0, "talus_r": 61.0})
    'mm'
    """
    usual = [(*SIZE_M[name.split("_")[0]], extent) for name, extent in extents.items()]
    fitting = [
        unit
        for unit, metres in UNITS.items()
        if all(low <= extent * metres <= high for low, high, extent in usual)
    ]
    if fitting:
        return fitting[0]
    sizes = ", ".join(f"{name} {extent:.4g}" for name, extent in extents.items())
    raise results.MeshRefused(
        f"in no unit are all bones as large as bones ({sizes})",
        field="--units",
        remedy="Give all bones in one unit, mm or m, each in its place",
    )


def find_landmarks(
    bones: Mapping[str, Mesh], *, progress: Callable[[str], None] | None = None
) -> dict[str, results.BoneLandmarks]:
    """Landmarks of every bone of one image.

    ``bones``: name (of :data:`BONES`) to vertices (n, 3), m, and faces (m, 3), all in the image's axes.
    ``progress``: called with the name of each bone before its turn.
    Name to landmarks, in the order of :data:`BONES`. Where a talus is given, ``ankle_centre`` of its tibia is
        that of the talus, and the malleoli's stands as ``ankle_centre_malleoli``.
    Raises MeshRefused: with the bone's name as ``field``.
    """
    found: dict[str, results.BoneLandmarks] = {}
    frames: dict[str, tibias.TibiaFrame] = {}
    for name in [bone for bone in BONES if bone in bones]:
        if progress is not None:
            progress(name)
        try:
            found[name] = _find_one(name, bones[name], frames)
        except results.MeshRefused as error:
            raise results.MeshRefused(error.problem, field=error.field or name, remedy=error.remedy) from None
    for side in ("r", "l"):
        _take_from_talus(found, side)
        _complete_knee(found, side)
        _check_socket(found, side)
    return found


def _find_one(name: str, mesh: Mesh, frames: dict[str, tibias.TibiaFrame]) -> results.BoneLandmarks:
    vertices, faces = mesh
    if name == "pelvis":
        return find_pelvis_landmarks(vertices, faces)
    kind, side = name.split("_")
    named: results.Side = "r" if side == "r" else "l"
    if kind == "femur":
        return _require_side(name, find_femur_landmarks(vertices, faces, named_side=named))
    if kind == "tibia":
        landmarks, frames[side] = tibias.find_tibia_landmarks(vertices, faces, named_side=named)
        return _require_side(name, landmarks)
    if side not in frames:
        raise results.MeshRefused(
            _TALUS_ALONE, remedy=f"Give tibia_{side} of the same image too, or leave {name} out"
        )
    return find_talus_landmarks(vertices, faces, named_side=named, tibia=frames[side])


def _require_side(name: str, landmarks: results.BoneLandmarks) -> results.BoneLandmarks:
    if name.endswith(f"_{landmarks.side}"):
        return landmarks
    words = {"r": "right", "l": "left"}
    said, is_ = words[name[-1]], words[landmarks.side or "r"]
    raise results.MeshRefused(
        f"it is a {is_} {landmarks.bone}, but is given as a {said} one",
        remedy=f"Give it as {landmarks.bone}_{landmarks.side}; if the export mirrored it, mirror it back",
    )


def _take_from_talus(found: dict[str, results.BoneLandmarks], side: str) -> None:
    """The ankle's centre of the tibia from the talus, where there is one."""
    tibia, talus = found.get(f"tibia_{side}"), found.get(f"talus_{side}")
    if tibia is None or talus is None:
        return
    points, words = dict(tibia.points), dict(tibia.definitions)
    if "ankle_centre" in points:
        points["ankle_centre_malleoli"] = points["ankle_centre"]
        words["ankle_centre_malleoli"] = words["ankle_centre"]
    off = dict(tibia.deviations)
    if "ankle_centre" in off:
        off["ankle_centre_malleoli"] = off["ankle_centre"]
    points["ankle_centre"], off["ankle_centre"] = (
        talus.points["ankle_centre"],
        talus.deviations["ankle_centre"],
    )
    words["ankle_centre"] = talus.definitions["ankle_centre"]
    refused = {name: why for name, why in tibia.refused.items() if name != "ankle_centre"}
    found[f"tibia_{side}"] = replace(
        tibia,
        points=points,
        deviations=off,
        axis_deviations={**tibia.axis_deviations, "ankle": talus.axis_deviations["ankle"]},
        definitions=words,
        refused=refused,
        axes={**tibia.axes, "ankle": talus.axes["ankle"]},
    )


def _complete_knee(found: dict[str, results.BoneLandmarks], side: str) -> None:
    """The knee's centre over the plateaus of a tibia whose femur was not imaged down there."""
    tibia, femur = found.get(f"tibia_{side}"), found.get(f"femur_{side}")
    needed = ("plateau_medial", "plateau_lateral", "ankle_centre")
    if tibia is None or not set(needed) <= tibia.points.keys():
        return
    if femur is not None and "knee_centre" in femur.points:
        return
    medial, lateral, ankle = (tibia.points[name] for name in needed)
    middle = (medial + lateral) / 2.0
    y = (middle - ankle) / np.linalg.norm(middle - ankle)
    outward = (lateral - medial) - ((lateral - medial) @ y) * y
    z = outward / np.linalg.norm(outward)
    x = np.cross(y, z) * (1.0 if side == "r" else -1.0)
    plateaus = np.linalg.norm([tibia.deviations[name] for name in needed[:2]]) / 2.0
    found[f"tibia_{side}"] = replace(
        tibia,
        points={**tibia.points, "knee_centre": middle + np.array(_KNEE_ON_PLATEAU_M) @ np.array([x, y, z])},
        deviations={**tibia.deviations, "knee_centre": float(np.hypot(_KNEE_ON_PLATEAU_SD, plateaus))},
        definitions={**tibia.definitions, "knee_centre": "over the plateaus, as in persons with both bones"},
        warnings=(*tibia.warnings, "its knee's centre stands over its plateaus, as in other persons"),
    )


def _check_socket(found: dict[str, results.BoneLandmarks], side: str) -> None:
    """A warning where the head does not sit in its socket, or is not of its size."""
    pelvis, femur = found.get("pelvis"), found.get(f"femur_{side}")
    if pelvis is None or femur is None or "hip_centre" not in femur.points:
        return
    warnings = list(femur.warnings)
    apart = _measure_hip_gap(found, side) or 0.0
    if apart > _JOINT_GAP_M:
        warnings.append(
            f"its head lies {1e3 * apart:.0f} mm from the socket of the pelvis: other poses or images"
        )
    head, socket = femur.spheres.get("head"), pelvis.spheres.get(f"acetabulum_{side}")
    if head is not None and socket is not None:
        low, high = _HEAD_IN_SOCKET
        if not low <= head.radius / socket.radius <= high:
            warnings.append(
                f"its head has a radius of {1e3 * head.radius:.0f} mm, the socket of the pelvis one of "
                f"{1e3 * socket.radius:.0f} mm: check that the bones are of one person and in one unit"
            )
    found[f"femur_{side}"] = replace(femur, warnings=tuple(warnings))


def _measure_hip_gap(found: Mapping[str, results.BoneLandmarks], side: str) -> float | None:
    """From the socket to the femur's head, m; None where not both were found."""
    pelvis, femur = found.get("pelvis"), found.get(f"femur_{side}")
    socket = None if pelvis is None else pelvis.points.get(f"acetabulum_{side}")
    head = None if femur is None else femur.points.get("hip_centre")
    return None if socket is None or head is None else float(np.linalg.norm(head - socket))


def _measure_knee_gap(found: Mapping[str, results.BoneLandmarks], side: str) -> tuple[float, float] | None:
    """From the middle of the condyles to that of the plateaus, m, and over the condyles' radius."""
    femur, tibia = found.get(f"femur_{side}"), found.get(f"tibia_{side}")
    if femur is None or tibia is None or "knee_centre" not in femur.points:
        return None
    plateaus = [tibia.points[name] for name in ("plateau_medial", "plateau_lateral") if name in tibia.points]
    if len(plateaus) < 2:
        return None
    gap = float(np.linalg.norm(np.mean(plateaus, axis=0) - femur.points["knee_centre"]))
    radii = [s.radius for name, s in femur.spheres.items() if name.startswith("condyle")]
    return gap, gap / (float(np.mean(radii)) if radii else _CONDYLE_M)


def _compare_widths(found: Mapping[str, results.BoneLandmarks], side: str) -> Iterator[str]:
    """A warning where a plateau is too wide or too narrow for the epicondyles."""
    ends = {
        "tibia": ("plateau_medial", "plateau_lateral"),
        "femur": ("epicondyle_medial", "epicondyle_lateral"),
    }
    widths = {}
    for bone, (medial, lateral) in ends.items():
        points = found[f"{bone}_{side}"].points if f"{bone}_{side}" in found else {}
        if medial not in points or lateral not in points:
            return
        widths[bone] = float(np.linalg.norm(points[medial] - points[lateral]))
    low, high = _PLATEAU_TO_FEMUR
    if not low <= widths["tibia"] / widths["femur"] <= high:
        yield (
            f"{say_name(f'tibia_{side}')}: its plateau is {1e3 * widths['tibia']:.0f} mm wide, "
            f"the {say_name(f'femur_{side}')} {1e3 * widths['femur']:.0f} mm between the epicondyles: "
            "check that they are of one person"
        )


def _compare_sides(found: Mapping[str, results.BoneLandmarks]) -> Iterator[str]:
    """A warning where both sides' bones are of different length."""
    for bone, (upper, lower) in _LENGTHS.items():
        pair = [found[f"{bone}_{side}"].points for side in "rl" if f"{bone}_{side}" in found]
        if len(pair) < 2 or not all({upper, lower} <= points.keys() for points in pair):
            continue
        right, left = (1e3 * float(np.linalg.norm(points[upper] - points[lower])) for points in pair)
        if abs(right - left) > _LENGTHS_APART * max(right, left):
            yield (
                f"the right {bone} is {right:.0f} mm long and the left one {left:.0f} mm between their "
                "joints: check that they are of one person"
            )


def check_joined(found: Mapping[str, results.BoneLandmarks]) -> tuple[str, ...]:
    """Whether bones meet in their joints, as they do in one image of one person.

    ``found``: bone to its landmarks. Returns a warning for each knee whose gap or whose bones' widths do not
    fit, and for sides of different length. Raises MeshRefused: a femur's head is nowhere near its socket, or
    a tibia nowhere near its femur or turned against it.
    """
    notes: list[str] = list(_compare_sides(found))
    remedy = "Export all bones in the frame of one image of one person, not each in its own"
    for side in "rl":
        femur = say_name(f"femur_{side}")
        notes += _compare_widths(found, side)
        gap = _measure_hip_gap(found, side)
        if gap is not None and gap > _OTHER_FRAME_M:
            problem = f"its head lies {1e3 * gap:.0f} mm from the socket of the pelvis"
            raise results.MeshRefused(problem, field=f"femur_{side}", remedy=remedy)
        # From the axis of the condyles to the one across the plateau, deg; None where one is missing.
        axes = [
            found[bone].axes[name]
            for bone, name in ((f"femur_{side}", "knee"), (f"tibia_{side}", "plateau"))
            if bone in found and name in found[bone].axes
        ]
        turned = (
            float(np.rad2deg(np.arccos(np.clip(axes[0] @ axes[1], -1.0, 1.0)))) if len(axes) == 2 else None
        )
        if turned is not None and turned > _TURNED_DEG:
            problem = f"its plateau is turned by {turned:.0f} degrees against the condyles of the {femur}"
            raise results.MeshRefused(problem, field=f"tibia_{side}", remedy=remedy)
        knee = _measure_knee_gap(found, side)
        if knee is None:
            continue
        narrow, wide, apart = _KNEE_GAP
        said = f"its plateau lies {1e3 * knee[0]:.0f} mm from the middle of the condyles of the {femur}"
        if knee[1] > apart:
            raise results.MeshRefused(said, field=f"tibia_{side}", remedy=remedy)
        if not narrow <= knee[1] <= wide:
            notes.append(f"{say_name(f'tibia_{side}')}: {said}: other poses, images or persons")
    return tuple(notes)


def collect_evidence(
    found: Mapping[str, results.BoneLandmarks],
    markers: Mapping[str, tuple[str, Vector]],
    bones: Mapping[str, trials.Bone],
) -> trials.ImageEvidence:
    """Landmarks under the names of a built-in leg model's joints and markers.

    ``found``: bone (``pelvis``, ``femur_r`` …) to its landmarks, all of one image. ``markers``: skin
    markers seen in that image: model marker to (segment, position in m). ``bones``: the surfaces
    themselves.
    """
    centres = {name: (bone, point) for name, bone, point in _list_centres(found)}
    axes = {
        f"{joint}_{bone.side}": (bone, joint)
        for bone in found.values()
        for joint in ("knee", "ankle", "subtalar")
        if joint in bone.axes
    }
    return trials.ImageEvidence(
        centres={name: _to_vector(bone.points[point]) for name, (bone, point) in centres.items()},
        axes={name: _to_vector(bone.axes[joint]) for name, (bone, joint) in axes.items()},
        deviations={name: bone.deviations[point] for name, (bone, point) in centres.items()}
        | {name: bone.deviations[point] for name, bone, point in _list_marker_landmarks(found)},
        axis_deviations={name: bone.axis_deviations[joint] for name, (bone, joint) in axes.items()},
        landmarks={
            name: _to_vector(bone.points[point]) for name, bone, point in _list_marker_landmarks(found)
        },
        markers=dict(markers),
        source="landmarks of bone meshes",
        bones=dict(bones),
    )


def _list_centres(
    found: Mapping[str, results.BoneLandmarks],
) -> Iterator[tuple[str, results.BoneLandmarks, str]]:
    """Joint centres, their bones and points; a hip whose femur is not there is the centre of its socket."""
    pelvis = found.get("pelvis")
    for side in "rl" if pelvis is not None else "":
        if pelvis is not None and f"acetabulum_{side}" in pelvis.points:
            yield f"hip_{side}", pelvis, f"acetabulum_{side}"
    for bone in found.values():
        for point, joint in _CENTRES.get(bone.bone, {}).items():
            if point in bone.points:
                yield f"{joint}_{bone.side}", bone, point


def _list_marker_landmarks(
    found: Mapping[str, results.BoneLandmarks],
) -> Iterator[tuple[str, results.BoneLandmarks, str]]:
    """Markers over bone, their bones and points."""
    for bone in found.values():
        letter = (bone.side or "").upper()
        for point, marker in _LANDMARKS.get(bone.bone, {}).items():
            if point in bone.points:
                yield f"{letter}{marker}", bone, point


def _to_vector(point: Array) -> Vector:
    x, y, z = point.tolist()
    return (x, y, z)
