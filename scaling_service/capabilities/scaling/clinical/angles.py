"""The joint angles of a moving model as a gait laboratory defines them, and over its gait cycles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.scaling.clinical.landmarks import (
    clinical_landmarks,
    moved_landmarks,
    tilt_is_seen,
)
from scaling_service.capabilities.scaling.comparison.gait_cycles import Cycle
from scaling_service.model.anatomy.conventional import ANGLES, KNEE, Points, conventional_angles
from scaling_service.model.anatomy.frames import Side
from scaling_service.model.body import BodyModel
from scaling_service.model.results import Array, Motion
from scaling_service.numerics.statistics.cycles import NODES, normalised_cycles

SIDES: tuple[Side, ...] = ("r", "l")

_AGAINST_THE_WAY = ("pelvis_internal_rotation", "foot_internal_progression")
"""Angles that are counted from the walking direction."""

_LEAST_WAY_M = 0.3
"""Of the pelvis over a cycle or a recording, else the recording's x axis is the walking direction. Chosen:
half a child's stride; on a treadmill the pelvis stays within a few centimetres."""

_TILT_UNSEEN = (
    "pelvic tilt and hip flexion, and with them the scores: no marker behind the front spines of the pelvis "
    "was followed, so they may be off by a constant of tens of degrees"
)

_LOCKED = 1e-4
"""rad. Chosen: under a hundredth of a degree, which no free knee keeps while it bends by half a degree."""


@dataclass(frozen=True, slots=True, eq=False)
class ClinicalAngles:
    """The conventional angles of both sides over one recording.

    Parameters
    ----------
    trial : str
    times : (n_frames,), s
    values : mapping
        Side to angle (of ``ANGLES``) to (n_frames,), rad; NaN where
        the recording does not determine it.
    pelvis : (n_frames, 3), m
        Half-way between the hip centres.
    heading : float, rad
        The walking direction of the recording: turn about y that leads from x to it.
    left_out : tuple of str
        Which angles are not there and why, one sentence without a full stop each.
    doubtful : tuple of str
        Which are there but rest on little, likewise.
    """

    trial: str
    times: Array
    values: Mapping[Side, Mapping[str, Array]]
    pelvis: Array
    heading: float
    left_out: tuple[str, ...] = ()
    doubtful: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class ClinicalCycles:
    """The conventional angles of one side over gait cycles.

    Parameters
    ----------
    side : 'r' or 'l'
    cycles : tuple of (trial, start_s, end_s)
    values : mapping
        Angle to (n_cycles, n_nodes), rad, from 0 to 100 % of the cycle; NaN in cycles that do not tell it.
    """

    side: Side
    cycles: tuple[tuple[str, float, float], ...]
    values: Mapping[str, Array]


def clinical_angles(model: BodyModel, motion: Motion) -> ClinicalAngles:
    """The conventional angles of a model's motion.

    Joint centres and landmarks are the model's own and move with its segments; see
    ``clinical_landmarks``.

    Parameters
    ----------
    model : BodyModel
        Built-in or from OpenSim, y up.
    motion : Motion
        Coordinates that the recording does not determine make what hangs on them NaN.

    Examples
    --------
    >>> from scaling_service.model.builtin import builtin
    >>> model = builtin("lower_limb_14dof")
    >>> still = np.zeros((1, len(model.coordinates)))
    >>> names = model.coordinate_names
    >>> motion = Motion("still", np.zeros(1), names, still, (), np.empty((1, 0, 3)), names)
    >>> angles = clinical_angles(model, motion)
    >>> round(float(angles.values["r"]["knee_flexion"][0]), 6) + 0.0, angles.left_out
    (0.0, ('ankle and foot: the model has no heel and toe',))
    """
    points = moved_landmarks(model, motion, clinical_landmarks(model))
    sides = {side: conventional_angles(points, side) for side in SIDES}
    pelvis = _between_hips(points, len(motion.times))
    heading = _heading(pelvis[np.isfinite(pelvis).all(axis=1)])
    free = {side: _without_locked(angles) for side, angles in sides.items()}
    values = {side: _against(angles, side, heading) for side, angles in free.items()}
    left_out = tuple(_left_out(sides, values))
    doubtful = () if tilt_is_seen(model, motion) else (_TILT_UNSEEN,)
    return ClinicalAngles(motion.trial, motion.times, values, pelvis, heading, left_out, doubtful)


def clinical_cycles(
    recordings: Iterable[tuple[ClinicalAngles, Sequence[Cycle]]], side: Side
) -> ClinicalCycles | None:
    """Cut the angles of one side at its gait cycles, each on the nodes 0, 1, … 100 %.

    Pelvis rotation and foot progression count from where the pelvis goes during each cycle, so that a turning
    walk can be read, too.

    Parameters
    ----------
    recordings : iterable of (angles, cycles of this side)

    Returns
    -------
    ClinicalCycles or None
        None where no cycle lies within what is known.
    """
    cut = [
        (angles.trial, cycle, _cut(angles, cycle, side)) for angles, cycles in recordings for cycle in cycles
    ]
    whole = [entry for entry in cut if entry[2]]
    if not whole:
        return None
    unknown = np.full(NODES, np.nan)
    return ClinicalCycles(
        side,
        tuple((trial, start, end) for trial, (start, end), _ in whole),
        {
            name: np.stack([curves.get(name, unknown) for _, _, curves in whole])
            for name in ANGLES
            if any(name in curves for _, _, curves in whole)
        },
    )


def _cut(angles: ClinicalAngles, cycle: Cycle, side: Side) -> dict[str, Array]:
    """The angles known all along one cycle, each (n_nodes,), rad."""
    times, (start, end) = angles.times, cycle
    rows = slice(
        max(int(np.searchsorted(times, start, side="right")) - 1, 0), int(np.searchsorted(times, end)) + 1
    )
    known = [name for name, value in angles.values[side].items() if np.isfinite(value[rows]).all()]
    if not known:
        return {}
    within = {name: angles.values[side][name] for name in known}
    way = angles.pelvis[rows][np.isfinite(angles.pelvis[rows]).all(axis=1)]
    turned = _against(within, side, _heading(way, angles.heading) - angles.heading)
    smooth = np.column_stack([_unwrapped(turned[name], rows) for name in known])
    curves = normalised_cycles(times, smooth, [cycle], known, trial=angles.trial, nodes=NODES)[0]
    return dict(zip(known, curves, strict=True))


def _unwrapped(angle: Array, rows: slice) -> Array:
    whole = angle.copy()
    whole[rows] = np.unwrap(angle[rows])
    return whole


def _against(angles: Mapping[str, Array], side: Side, heading: float) -> dict[str, Array]:
    """The same angles, those against the walking direction counted from ``heading`` further, rad."""
    own = heading if side == "r" else -heading
    return {
        name: np.arctan2(np.sin(value - own), np.cos(value - own)) if name in _AGAINST_THE_WAY else value
        for name, value in angles.items()
    }


def _heading(way: Array, otherwise: float = 0.0) -> float:
    """Where a way over the floor leads, (n, 3), m, from its first to its last point."""
    gone = way[-1] - way[0] if len(way) else np.zeros(3)
    return float(np.arctan2(-gone[2], gone[0])) if np.hypot(gone[0], gone[2]) > _LEAST_WAY_M else otherwise


def _between_hips(points: Points, n_frames: int) -> Array:
    if "RHJC" not in points or "LHJC" not in points:
        return np.full((n_frames, 3), np.nan)
    return np.asarray((points["RHJC"] + points["LHJC"]) / 2.0)


def _without_locked(angles: Mapping[str, Array]) -> dict[str, Array]:
    """Without turns that the model's knee cannot make: they say nothing of the person."""
    bends = "knee_flexion" in angles and _range(angles["knee_flexion"]) > 100.0 * _LOCKED
    locked = [name for name in KNEE[1:] if bends and _range(angles[name]) < _LOCKED]
    return {name: value for name, value in angles.items() if name not in locked}


def _range(angle: Array) -> float:
    known = angle[np.isfinite(angle)]
    return float(np.ptp(known)) if len(known) else 0.0


def _left_out(
    sides: Mapping[Side, Mapping[str, Array]], values: Mapping[Side, Mapping[str, Array]]
) -> Iterable[str]:
    """What the model does not have or locks, and what the recording does not determine."""
    names = set().union(*sides.values())
    reasons = {
        "pelvis_anterior_tilt": "pelvis and hip: the model has no markers on the spines of the pelvis",
        "hip_flexion": "hip: the model has no lateral epicondyles or knee centres",
        "knee_flexion": "knee: the model has no lateral epicondyles or ankle centres",
        "foot_internal_progression": "ankle and foot: the model has no heel and toe",
        "ankle_dorsiflexion": "ankle: the model has no lateral malleoli or ankle centres",
    }
    absent = [name for name in reasons if name not in names]
    if "pelvis_anterior_tilt" in absent and "hip_flexion" in absent:
        absent.remove("hip_flexion")
    if "foot_internal_progression" in absent and "ankle_dorsiflexion" in absent:
        absent.remove("ankle_dorsiflexion")
    yield from (reasons[name] for name in absent)
    locked = [name for name in KNEE if any(name in sides[s] and name not in values[s] for s in values)]
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
