"""The joint angles of a moving model as a gait laboratory defines them, and over its gait cycles."""

from __future__ import annotations

import re
from collections import abc
from dataclasses import dataclass, field

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.errors import ModelRefused
from scaling_service.model import body
from scaling_service.model import compile as compiling
from scaling_service.model import poses as posing
from scaling_service.model.anatomy import frames as anatomy_frames
from scaling_service.model.anatomy import lengths, markers
from scaling_service.model.results import Motion
from scaling_service.numerics.multibody import tree as trees
from scaling_service.numerics.statistics import waveforms

_PELVIS = ("RASIS", "LASIS", "RPSIS", "LPSIS", "SACR")
_LEG = ("LFE", "MFE", "LM", "MM", "HEE", "TOE", "MT1", "MT5")
_BEHIND_M = 0.05
"""Chosen: a third of the way from front to back of an adult's pelvis, far beyond what markers are off."""

_CENTRES = {"hip": "HJC", "knee": "KJC", "ankle": "AJC"}
_TOES = re.compile(r"[RL]TOE(TIP)?")
"""The second metatarsal's head or the tip before it: on one line with the heel, seen from above."""

Cycle = tuple[float, float]
"""First and last time of a gait cycle, s."""

_Place = tuple[str, Array]
"""Segment, and a position in ground where all turns of the model are zero, (3,), m."""

_AGAINST_THE_WAY = ("pelvis_internal_rotation", "foot_internal_progression")
"""Angles that are counted from the walking direction."""

_LEAST_WAY_M = 0.3
"""Of the pelvis over a cycle or a recording, else the recording's x axis is the walking direction. Chosen:
half a child's stride; on a treadmill the pelvis stays within a few centimetres."""

_TILT_UNSEEN = (
    "pelvic tilt and hip flexion, and with them the scores: no marker behind the front spines of the pelvis "
    "was followed, so they may be off by a constant of tens of degrees"
)

_STEP = 1e-5  # rad or m; chosen: the angles' curvature and rounding both stay below 1e-9

_LOCKED = 1e-4
"""rad. Chosen: under a hundredth of a degree, which no free knee keeps while it bends by half a degree."""


def find_clinical_landmarks(model: body.BodyModel) -> dict[str, body.Marker]:
    """The landmarks of ``Points`` that a model has.

    Joint centres are the model's, the others its markers of that name or alias. Where a model knows both
    epicondyles or malleoli, the lateral one counts as lying beside the joint's centre in their direction.

    All turns of the model at zero are its neutral pose: the shank's frontal plane is the thigh's there, so
    that knee rotation counts from it and tibial torsion does not enter; and soles are level, heel and toe
    marker equally high.

    Returns landmark to a marker at its place on a segment; without those that the model does not have.
    """
    names = (*_PELVIS, *(f"{letter}{name}" for letter in "RL" for name in _LEG))
    own = {n: next((m for m in model.markers if _is_landmark(m.name, n)), None) for n in names}
    shanks = {letter: lengths.find_segment(model, "tibia", letter.lower()) for letter in "RL"}
    centres = lengths.find_joint_centres(model)
    straight = {c.name: 0.0 for c in model.coordinates if c.kind == "rotation"}
    values, frames = posing.list_model_values(model), posing.pose_neutral_frames(model, straight)

    def place(segment: str, local: Array) -> _Place:
        rotation, origin = frames[segment]
        return segment, origin + rotation @ local

    places = {
        f"{name[-1].upper()}{_CENTRES[name[:-2]]}": place(segment, np.array(at))
        for name, (segment, at) in centres.items()
        if name[:-2] in _CENTRES
    }
    for name, marker in own.items():
        if marker is not None:
            places[name] = place(marker.segment, posing.evaluate_marker(marker, values))
    for letter, shank in shanks.items():
        places |= _place_beside(places, f"{letter}KJC", f"{letter}LFE", f"{letter}MFE")
        places |= _place_beside(places, f"{letter}AJC", f"{letter}LM", f"{letter}MM")
        places |= _place_knee_axis(places, letter, shank)
        places |= _place_foot_line(places, letter)
    placed = {}
    for name, (segment, point) in places.items():
        rotation, origin = frames[segment]
        placed[name] = body.Marker.at(name, segment, body.to_vector(rotation.T @ (point - origin)))
    return placed


def track_landmarks(
    model: body.BodyModel, motion: Motion, placed: abc.Mapping[str, body.Marker]
) -> dict[str, Array]:
    """Landmark to its trajectory in a motion of the model, (n_frames, 3), m.

    NaN where it hangs on a coordinate that the recording, or this frame of it, does not determine.
    """
    q = np.full((len(motion.times), len(model.coordinates)), np.nan)
    for k, name in enumerate(model.coordinate_names):
        if name in motion.estimated:
            q[:, k] = motion.column(name)
    where = posing.place_points(model, tuple(placed.values()), q)
    return {name: where[:, k] for k, name in enumerate(placed)}


def tilt_is_seen(model: body.BodyModel, motion: Motion) -> bool:
    """Whether a marker that a motion follows shows how far the pelvis is tilted.

    One that lies off the line through both front spines does. A motion that follows no marker of the pelvis
    at all (as of a virtual person) is taken as known.
    """
    front = {name: m for m in model.markers for name in ("RASIS", "LASIS") if _is_landmark(m.name, name)}
    if len(front) < 2:
        return True
    values, pelvis = posing.list_model_values(model), front["RASIS"].segment
    right, left = (posing.evaluate_marker(front[name], values) for name in ("RASIS", "LASIS"))
    across = (right - left) / np.linalg.norm(right - left)
    seen = {name for k, name in enumerate(motion.markers) if np.isfinite(motion.residuals[:, k]).any()}
    off = [
        float(np.linalg.norm(np.cross(posing.evaluate_marker(m, values) - left, across)))
        for m in model.markers
        if m.segment == pelvis and m.name in seen
    ]
    return not off or max(off) > _BEHIND_M


def _is_landmark(label: str, landmark: str) -> bool:
    if markers.find_canonical(label) == landmark:
        return True
    plain = re.sub(r"[\s._-]+", "", markers.strip_prefix(label).upper())
    return plain == landmark or (
        landmark[1:] == "TOE" and landmark[0] == plain[:1] and bool(_TOES.fullmatch(plain))
    )


def _place_beside(
    places: abc.Mapping[str, _Place], centre: str, lateral: str, medial: str
) -> dict[str, _Place]:
    """The lateral landmark beside the joint's centre, in the direction from the medial one."""
    if not {centre, lateral, medial} <= places.keys() or places[lateral][0] != places[medial][0]:
        return {}
    segment, outside = places[lateral]
    return {lateral: (segment, places[centre][1] + (outside - places[medial][1]) / 2.0)}


def _place_knee_axis(places: abc.Mapping[str, _Place], letter: str, shank: str | None) -> dict[str, _Place]:
    """Beside the ankle as the lateral epicondyle is beside the knee, on the shank."""
    knee, lateral, ankle = (f"{letter}{name}" for name in ("KJC", "LFE", "AJC"))
    if shank is None or not {knee, lateral, ankle} <= places.keys():
        return {}
    return {f"{letter}KAX": (shank, places[ankle][1] + places[lateral][1] - places[knee][1])}


def _place_foot_line(places: abc.Mapping[str, _Place], letter: str) -> dict[str, _Place]:
    """The heel at the toe's height; the toe between the metatarsal heads where it has no own marker."""
    heel, toe, inner, outer = (f"{letter}{name}" for name in ("HEE", "TOE", "MT1", "MT5"))
    found = dict(places)
    if toe not in found and {inner, outer} <= found.keys():
        found[toe] = (found[inner][0], (found[inner][1] + found[outer][1]) / 2.0)
    if not {heel, toe} <= found.keys():
        return {}
    ends = {name: found[name][1][None] for name in (heel, toe)}
    return {
        toe: found[toe],
        heel: (found[heel][0], anatomy_frames.level_heel(ends, "r" if letter == "R" else "l")[0]),
    }


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ClinicalAngles:
    """The conventional angles of both sides over one recording.

    ``times``: (n_frames,), s.
    ``values``: side to angle (of ``ANGLES``) to (n_frames,), rad; NaN where the recording does not determine
        it.
    ``pelvis`` ((n_frames, 3), m): half-way between the hip centres.
    ``heading`` (rad): the walking direction of the recording: turn about y that leads from x to it; who stays
        on the spot, on a treadmill or standing, walks along the axis of the laboratory that the pelvis faces.
    ``left_out``: which angles are not there and why, one sentence without a full stop each.
    ``doubtful``: which are there but rest on little, likewise.
    """

    trial: str
    times: Array
    values: abc.Mapping[anatomy_frames.Side, abc.Mapping[str, Array]]
    pelvis: Array
    heading: float
    left_out: tuple[str, ...] = ()
    doubtful: tuple[str, ...] = ()
    # as ``values``: standard deviations, where they were asked for
    sd: abc.Mapping[anatomy_frames.Side, abc.Mapping[str, Array]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class ClinicalCycles:
    """The conventional angles of one side over gait cycles.

    ``side``: 'r' or 'l'.
    ``values``: angle to (n_cycles, n_nodes), rad, from 0 to 100 % of the cycle; NaN in cycles that do not
        tell it.
    """

    side: anatomy_frames.Side
    cycles: tuple[tuple[str, float, float], ...]
    values: abc.Mapping[str, Array]


def compute_clinical_angles(
    model: body.BodyModel, motion: Motion, placed: abc.Mapping[str, body.Marker] | None = None
) -> ClinicalAngles:
    """The conventional angles of a model's motion.

    Joint centres and landmarks are the model's own and move with its segments (see
    :func:`find_clinical_landmarks`).

    ``model``: built-in or from OpenSim, y up.
    ``motion``: coordinates that the recording does not determine make what hangs on them NaN.
    ``placed``: the model's landmarks, where they are found already.

    Examples
    --------
    >>> from scaling_service.model.builtin import load_builtin
    >>> model = load_builtin("lower_limb_14dof")
    >>> still = np.zeros((1, len(model.coordinates)))
    >>> names = model.coordinate_names
    >>> motion = Motion(
    ...     trial="still", times=np.zeros(1), coordinates=names, q=still, markers=(),
    ...     residuals=np.empty((1, 0, 3)), estimated=names,
    ... )
    >>> angles = compute_clinical_angles(model, motion)
    >>> round(float(angles.values["r"]["knee_flexion"][0]), 6) + 0.0, angles.left_out
    (0.0, ('ankle and foot: the model has no heel and toe',))
    """
    points = track_landmarks(model, motion, find_clinical_landmarks(model) if placed is None else placed)
    sides = {side: anatomy_frames.compute_conventional_angles(points, side) for side in anatomy_frames.SIDES}
    unknown = np.full((len(motion.times), 3), np.nan)
    pelvis = (points.get("RHJC", unknown) + points.get("LHJC", unknown)) / 2.0
    way = pelvis[np.isfinite(pelvis).all(axis=1)]
    # The axis of the laboratory nearest to where a pelvis faces, rad from x; x where that is not known.
    rotation = sides["r"].get("pelvis_internal_rotation")
    known = np.zeros(0) if rotation is None else rotation[np.isfinite(rotation)]
    if not len(known):
        faced = 0.0
    else:
        faced = float(np.round(np.angle(np.exp(1j * known).mean()) / (np.pi / 2.0)) * (np.pi / 2.0))
    heading = _find_heading(way, faced)
    free = {}
    for side, angles in sides.items():
        # Without turns that the model's knee cannot make: they say nothing of the person.
        bends = "knee_flexion" in angles and _measure_range(angles["knee_flexion"]) > 100.0 * _LOCKED
        locked = [
            name for name in anatomy_frames.KNEE[1:] if bends and _measure_range(angles[name]) < _LOCKED
        ]
        free[side] = {name: value for name, value in angles.items() if name not in locked}
    values = {side: _measure_against(angles, side, heading) for side, angles in free.items()}
    left_out = tuple(_list_left_out(sides, values))
    doubtful = () if tilt_is_seen(model, motion) else (_TILT_UNSEEN,)
    return ClinicalAngles(
        trial=motion.trial,
        times=motion.times,
        values=values,
        pelvis=pelvis,
        heading=heading,
        left_out=left_out,
        doubtful=doubtful,
    )


AngleRates = abc.Callable[[Array], Array]
"""Of coordinates (n_frames, n_coordinates) how angles change, (n_frames, n_angles, n_coordinates)."""


def compute_clinical_rates(
    model: body.BodyModel,
) -> tuple[tuple[tuple[anatomy_frames.Side, str], ...], AngleRates]:
    """Side and name of every conventional angle of a model, and how they change with its coordinates.

    The landmarks' rates are exact; the angles of landmarks are differenced along each.
    Raises ModelRefused: it has too few landmarks for any.
    """
    placed = find_clinical_landmarks(model)
    names = tuple(placed)
    tree = compiling.compile_points(model, list(placed.values()))
    p = compiling.list_parameter_values(model)

    def compute_angles(where: Array) -> dict[tuple[anatomy_frames.Side, str], Array]:
        points = {name: where[k].T for k, name in enumerate(names)}
        return {
            (s, a): v
            for s in anatomy_frames.SIDES
            for a, v in anatomy_frames.compute_conventional_angles(points, s).items()
        }

    angles = tuple(compute_angles(np.zeros((len(names), 3, 0))))
    if not angles:
        raise ModelRefused(
            f"'{model.name}' has no landmarks from which conventional angles come",
            field="angles",
            remedy="Leave the angles out, or take a model with landmarks on pelvis, thighs and shanks",
        )

    def compute_rates(q: Array) -> Array:
        n, count = q.shape
        poses = trees.pose_links(tree, np.ascontiguousarray(q.T), p)
        where = trees.place_tree_markers(tree, poses)
        change = _STEP * trees.compute_jacobian(tree, poses, where, np.arange(count))
        moved = where[None, None] + np.stack([change, -change])  # (2, n_coordinates, n_landmarks, 3, n)
        ends = np.stack(
            list(compute_angles(np.moveaxis(moved, (2, 3), (0, 1)).reshape(len(names), 3, -1)).values())
        )
        rise = np.subtract(*ends.reshape(-1, 2, count, n).swapaxes(0, 1))
        return np.asarray((np.arctan2(np.sin(rise), np.cos(rise)) / (2.0 * _STEP)).transpose(2, 0, 1))

    return angles, compute_rates


def cut_clinical_cycles(
    recordings: abc.Iterable[tuple[ClinicalAngles, abc.Sequence[Cycle]]], side: anatomy_frames.Side
) -> ClinicalCycles | None:
    """Cut the angles of one side at its gait cycles, each on the nodes 0, 1, … 100 %.

    Pelvis rotation and foot progression count from where the pelvis goes during each cycle, so that a turning
    walk can be read, too.

    None where no cycle lies within what is known.
    """
    cut = [
        (angles.trial, cycle, _cut(angles, cycle, side)) for angles, cycles in recordings for cycle in cycles
    ]
    whole = [entry for entry in cut if entry[2]]
    if not whole:
        return None
    unknown = np.full(waveforms.NODES, np.nan)
    return ClinicalCycles(
        side,
        tuple((trial, start, end) for trial, (start, end), _ in whole),
        {
            name: np.stack([curves.get(name, unknown) for _, _, curves in whole])
            for name in anatomy_frames.ANGLES
            if any(name in curves for _, _, curves in whole)
        },
    )


def _cut(angles: ClinicalAngles, cycle: Cycle, side: anatomy_frames.Side) -> dict[str, Array]:
    """The angles known all along one cycle, each (n_nodes,), rad."""
    times, (start, end) = angles.times, cycle
    rows = slice(
        max(int(np.searchsorted(times, start, side="right")) - 1, 0), int(np.searchsorted(times, end)) + 1
    )
    cut = {name: value[rows] for name, value in angles.values[side].items()}
    within = {name: value for name, value in cut.items() if np.isfinite(value).all()}
    if not within:
        return {}
    way = angles.pelvis[rows][np.isfinite(angles.pelvis[rows]).all(axis=1)]
    turned = _measure_against(within, side, _find_heading(way, angles.heading) - angles.heading)
    smooth = np.unwrap(np.column_stack(list(turned.values())), axis=0)
    curves = waveforms.normalise_cycles(
        times[rows], smooth, [cycle], tuple(turned), trial=angles.trial, nodes=waveforms.NODES
    )
    return dict(zip(turned, curves[0], strict=True))


def _measure_against(
    angles: abc.Mapping[str, Array], side: anatomy_frames.Side, heading: float
) -> dict[str, Array]:
    """The same angles, those against the walking direction counted from ``heading`` further, rad."""
    own = heading if side == "r" else -heading
    return {
        name: np.arctan2(np.sin(value - own), np.cos(value - own)) if name in _AGAINST_THE_WAY else value
        for name, value in angles.items()
    }


def _find_heading(way: Array, otherwise: float = 0.0) -> float:
    """Where a way over the floor leads, (n, 3), m, from its first to its last point."""
    gone = way[-1] - way[0] if len(way) else np.zeros(3)
    return float(np.arctan2(-gone[2], gone[0])) if np.hypot(gone[0], gone[2]) > _LEAST_WAY_M else otherwise


def _measure_range(angle: Array) -> float:
    known = angle[np.isfinite(angle)]
    return float(np.ptp(known)) if len(known) else 0.0


def _list_left_out(
    sides: abc.Mapping[anatomy_frames.Side, abc.Mapping[str, Array]],
    values: abc.Mapping[anatomy_frames.Side, abc.Mapping[str, Array]],
) -> abc.Iterable[str]:
    """What the model does not have or locks, and what the recording does not determine."""
    names = set().union(*sides.values())
    reasons = {
        "pelvis_anterior_tilt": "pelvis and hip: the model has no markers on the spines of the pelvis",
        "hip_flexion": "hip: the model has no lateral epicondyles or knee centres",
        "knee_flexion": "knee: the model has no lateral epicondyles or ankle centres",
        "foot_internal_progression": "ankle and foot: the model has no heel and toe",
        "ankle_dorsiflexion": "ankle: the model has no lateral malleoli or ankle centres",
    }
    told_with = {"hip_flexion": "pelvis_anterior_tilt", "ankle_dorsiflexion": "foot_internal_progression"}
    absent = [name for name in reasons if name not in names]
    yield from (reasons[name] for name in absent if told_with.get(name) not in absent)
    locked = [
        name
        for name in anatomy_frames.KNEE
        if any(name in sides[s] and name not in values[s] for s in values)
    ]
    if locked:
        yield f"{' and '.join(name.replace('_', ' ') for name in locked)}: the model's knee does not turn so"
    hidden = [
        f"{name.replace('_', ' ')} ({side})"
        for side, angles in values.items()
        for name, value in angles.items()
        if not np.isfinite(value).any()
    ]
    if hidden:
        yield f"{', '.join(hidden)}: the markers seen do not determine it"
