"""Which way is up and forward in a laboratory, and whether the stated unit can be true.

The decision is one rotation by right angles, so that lab axes stay lab axes and force plates stay aligned.
It is taken on one recording and holds for all recordings and forces of the session.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError
from scaling_service.model.trial import Repair, Trial
from scaling_service.recording import plausibility

CLEAR_SHARE = 0.75
"""Share of a direction along its nearest axis that makes it clear (chosen: within 41 deg of the axis)."""

PLATE_SHARE = 0.97
"""Cosine of the tilt against an axis up to which force plates lie level (chosen: 14 deg, a steep ramp)."""

WALKED_M = 0.5  # chosen: displacement that counts as walking; sway and squats stay below

FLOOR_M = 0.25
"""Chosen: the lowest marker of a standing or walking body is this close to the lab's zero height."""

_HEIGHT_GROUPS: tuple[frozenset[str], ...] = (
    frozenset({"RASIS", "LASIS", "RPSIS", "LPSIS", "SACR", "SACRUM"}),
    frozenset({"RLFE", "RMFE", "RFH", "LLFE", "LMFE", "LFH"}),
    frozenset({"RLM", "RMM", "LLM", "LMM"}),
)
"""Pelvis, knees, ankles: from high to low in any posture on the feet."""

_FRONT = (frozenset({"RASIS", "LASIS"}),)
_BACK = (frozenset({"RPSIS", "LPSIS"}), frozenset({"SACR"}), frozenset({"SACRUM"}))
"""Sets that are symmetric about the midline: one side alone would point sideways."""

_PAIRS = (
    ("RASIS", "LASIS"),
    ("RPSIS", "LPSIS"),
    ("RLFE", "LLFE"),
    ("RLM", "LLM"),
    ("RMFE", "LMFE"),
    ("RMM", "LMM"),
)
_AXES = "xyz"


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Orientation:
    """How the axes of a laboratory become Y up and, where it matters, X forward and Z right."""

    R_new_old: Array  # (3, 3); signed permutation; maps laboratory vectors to ours
    repairs: tuple[Repair, ...] = ()  # what was decided and from what
    clarity: float = (
        1.0  # cosine between where the person faces and the axis taken for forward; 0: nothing tells it
    )
    vertical: int = 1  # which of our axes points up: y, but where a model stands otherwise

    @property
    def description(self) -> str:
        """Such as ``"up +z, forward -y"``."""
        return f"up {self.up}, forward {self.forward}"

    @property
    def up(self) -> str:
        """The laboratory axis that points up, such as ``"+z"``."""
        return _name(self.R_new_old[self.vertical])

    @property
    def forward(self) -> str:
        """The laboratory axis that points forward."""
        return _name(self.R_new_old[0])

    def rotate(self, vectors: ArrayLike) -> Array:
        """Vectors (forces, moments, points) in our axes; no change of unit.

        ``vectors``: (..., 3). Returns (..., 3).
        """
        return np.asarray(vectors, float) @ self.R_new_old.T


def decide(
    trial: Trial,
    *,
    roles: Mapping[str, str] | None = None,
    up: str | None = None,
    forward: str | None = None,
    upright: Array | None = None,
    level: Array | None = None,
    facing: bool = True,
) -> Orientation:
    """Find which axes of the laboratory point up and, unless its heading is to be kept, forward.

    ``trial``: preferably standing; walking will do.
    ``roles``: label to canonical marker name (``RASIS``, ``LPSIS``, ``RLFE``, ``RLM`` …). Labels without a
        role are used for extents only.
    ``up``, ``forward``: overrides such as ``"+z"``, ``"z"`` or ``"-x"``.
    ``upright`` (3,): where the upright axis of the body's root points on average, in the laboratory; shorter
        than one where it turns.
    ``level``: corners of force plates, (n_plates, 4, 3), m.
    ``facing``: whether forward is sought; else a laboratory is turned by its vertical alone, and one whose y
        points up not at all.
    Raises InputError: if an override is not an axis, or both name the same one.
    Raises TrialUnusable: if no marker is seen at all, or the unit cannot be told.

    Up: square to the force plates, where there are any; else the upright axis of the body's root, which a
    bent or raised leg does not tilt; else pelvis above knees above ankles, where these are known and clear
    of 45 degrees; else the longest extent of the body, ties decided by which side stands still near height
    zero (the floor). Forward: from PSIS to ASIS; else square to right-left pairs; else the displacement;
    else a lab axis, which is said.
    """
    factor, unit_repairs = plausibility.find_unit_factor(trial)
    positions = trial.markers * factor
    known = roles or {}
    where = {known[label]: positions[:, k] for k, label in enumerate(trial.labels) if label in known}
    up_vector, forward_vector = check_axes(up, forward)
    if up_vector is None:
        up_vector, why_up = _find_up(positions, where, forward_vector, upright, level)
    else:
        why_up = "given"
    clarity, why_forward = 1.0, "given"
    keeps = forward_vector is None and not facing
    if keeps:
        # The axis that the smallest turn of `up` onto y brings to x
        if up_vector[1]:
            forward_vector = _make_axis(0, 1.0)  # half a turn about x where y points down
        else:
            forward_vector = _make_axis(1, -up_vector[0]) if up_vector[0] else _make_axis(0, 1.0)
    elif forward_vector is None:
        ahead, why_forward = _find_facing(positions, where, up_vector)
        kept = _make_axis(0 if up_vector[0] == 0 else 1, 1.0)
        forward_vector = kept if ahead is None else _snap_to_axis(ahead)
        clarity = 0.0 if ahead is None else _share(ahead)
    rotation = np.stack((forward_vector, up_vector, np.cross(forward_vector, up_vector))) + 0.0  # no -0
    up_name, forward_name = _name(up_vector), _name(forward_vector)
    heading = f"forward is {forward_name} of the laboratory ({why_forward})"
    if keeps:
        heading = f"the laboratory's heading is kept: x is its {forward_name}"
    said = (
        Repair("up_axis", trial.name, f"up is {up_name} of the laboratory ({why_up})"),
        Repair("forward_axis", trial.name, heading),
    )
    return Orientation(rotation, (*said, *unit_repairs), clarity)


def apply(orientation: Orientation, trial: Trial) -> Trial:
    """Turn a recording into X forward, Y up, Z right, and m where its stated unit cannot be true.

    ``trial``: any recording of the same session, as read. Raises TrialUnusable if no marker is seen at all,
    or the unit cannot be told.
    """
    factor, unit_repairs = plausibility.find_unit_factor(trial)
    axes = tuple(r for r in orientation.repairs if r.what != "unit")
    turned = trial.with_markers(orientation.rotate(trial.markers * factor), *axes, *unit_repairs)
    return turn_rotations(orientation, turned)


def turn_rotations(orientation: Orientation, trial: Trial) -> Trial:
    """The recording with its rotations, if it has any, in the new axes; its markers as they are."""
    if trial.rotations is None:
        return trial
    return dataclasses.replace(trial, rotations=trial.rotations.turn(orientation.R_new_old))


def stand_along(orientation: Orientation, vertical: int) -> Orientation:
    """The same laboratory for a model that stands along another axis than y (0, 2), by the smallest turn."""
    turn = np.eye(3)
    if vertical == 0:
        turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    elif vertical == 2:
        turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    return dataclasses.replace(orientation, R_new_old=turn @ orientation.R_new_old + 0.0, vertical=vertical)


def _average_markers(where: Mapping[str, Array], names: frozenset[str]) -> Array | None:
    """Mean of the named markers in every frame, NaN where one of them is missing; None if none exists."""
    present = [where[name] for name in sorted(names) if name in where and np.isfinite(where[name]).any()]
    return np.mean(present, axis=0) if present else None


def _find_midpoint(where: Mapping[str, Array], choices: tuple[frozenset[str], ...]) -> Array | None:
    """Mean of the first set of which every marker is seen at some time."""
    for names in choices:
        if all(name in where and np.isfinite(where[name]).any() for name in names):
            return _average_markers(where, names)
    return None


def _average_rows(vectors: Array) -> Array | None:
    """Mean of the rows that are complete; None if none is."""
    complete = vectors[np.isfinite(vectors).all(axis=-1)]
    return complete.mean(axis=0) if len(complete) else None


def _find_up(
    positions: Array,
    where: Mapping[str, Array],
    forward: Array | None,
    upright: Array | None,
    level: Array | None,
) -> tuple[Array, str]:
    allowed = np.ones(3, bool) if forward is None else forward == 0
    standing = None if level is None else _find_square(level, positions)
    if standing is not None and allowed[np.argmax(np.abs(standing))]:
        return _snap_to_axis(standing), "square to the force plates, on the side of the markers"
    if upright is not None and allowed[np.argmax(np.abs(upright))] and np.abs(upright).max() >= CLEAR_SHARE:
        return _snap_to_axis(upright), f"the body's root stands {_describe_off_axis(upright)} off it"
    centres = [centre for group in _HEIGHT_GROUPS if (centre := _average_markers(where, group)) is not None]
    if len(centres) > 1:
        rise = _average_rows(centres[0] - centres[-1])
        if rise is not None and np.linalg.norm(rise) > 0:
            share = np.abs(rise) / np.linalg.norm(rise)
            if allowed[np.argmax(share)] and share.max() >= CLEAR_SHARE:
                return _snap_to_axis(rise), f"pelvis, knees and ankles lie {_describe_off_axis(rise)} off it"
    low, high = plausibility.find_extremes(positions)
    seen = np.isfinite(low).all(axis=1)
    low, high = low[seen], high[seen]
    extent = np.where(allowed, np.median(high - low, axis=0), -1.0)
    floor = np.stack((_measure_floor_misfit(low), _measure_floor_misfit(-high)))  # up positive, up negative
    near = extent >= CLEAR_SHARE * extent.max()
    axis = int(np.argmin(np.where(near, floor.min(axis=0), np.inf)))
    sign = 1.0 if floor[0, axis] <= floor[1, axis] else -1.0
    reason = (
        "the longest extent of the body"
        if near.sum() == 1
        else "a long extent of the body, standing on a floor"
    )
    return _make_axis(axis, sign), reason


def _find_square(corners: Array, positions: Array) -> Array | None:
    """The direction in which all plates face, to the side of the markers; None where they do not agree."""
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    sizes = np.linalg.norm(normals, axis=1, keepdims=True)
    if not len(corners) or not np.isfinite(normals).all() or not (sizes > 0.0).all():
        return None
    normals = normals / sizes
    axis = int(np.argmax(np.abs(normals).sum(axis=0)))
    middle = np.nanmedian(positions.reshape(-1, 3), axis=0)[axis] - corners[:, :, axis].mean()
    agree = np.abs(normals[:, axis]).min() >= PLATE_SHARE
    return _make_axis(axis, 1.0 if middle > 0.0 else -1.0) if agree else None


def _measure_floor_misfit(lowest: Array) -> Array:
    """How badly the lowest markers fit a floor at zero: distance beyond reach of it plus change over time."""
    middle = np.median(lowest, axis=0)
    change = np.subtract(*np.percentile(lowest, [95, 5], axis=0))
    misfit: Array = np.clip(np.abs(middle) - FLOOR_M, 0.0, None) + np.clip(-middle, 0.0, None) + change
    return misfit


def _find_facing(positions: Array, where: Mapping[str, Array], up: Array) -> tuple[Array | None, str]:
    """Which way the person faces, square to ``up``, and from what; None where nothing tells."""
    front, back = _find_midpoint(where, _FRONT), _find_midpoint(where, _BACK)
    if front is not None and back is not None:
        facing = _project_horizontally(_average_rows(front - back), up)
        if facing is not None:
            return facing, f"from PSIS to ASIS, {_describe_off_axis(facing)} off it"
    pairs = [where[right] - where[left] for right, left in _PAIRS if right in where and left in where]
    if pairs:
        rightwards = [mean for pair in pairs if (mean := _average_rows(pair)) is not None]
        facing = _project_horizontally(np.cross(up, np.sum(rightwards, axis=0)), up) if rightwards else None
        if facing is not None:
            return facing, f"square to right and left markers, {_describe_off_axis(facing)} off it"
    # Last minus first seen position, mean over the markers seen over most of the trial
    seen: NDArray[np.bool_] = np.all(np.isfinite(positions), axis=-1)
    n = len(positions)
    first, last = seen.argmax(axis=0), n - 1 - seen[::-1].argmax(axis=0)
    lasting = seen.any(axis=0) & (last - first >= n // 2)
    displacement: Array | None = None
    if n >= 2 and lasting.any():
        columns = np.flatnonzero(lasting)
        displacement = (positions[last[columns], columns] - positions[first[columns], columns]).mean(axis=0)
    way = _project_horizontally(displacement, up)
    if way is not None and np.linalg.norm(way) >= WALKED_M:
        return way, f"displacement of {np.linalg.norm(way):.1f} m, {_describe_off_axis(way)} off it"
    return None, "not known: no pelvis markers with a role and no walking; kept, give it if it matters"


def _project_horizontally(vector: Array | None, up: Array) -> Array | None:
    """The part square to ``up``; None where there is none to speak of."""
    if vector is None:
        return None
    flat = vector - (vector @ up) * up
    return flat if np.linalg.norm(flat) > 1e-2 * max(float(np.linalg.norm(vector)), 1e-9) else None


def _snap_to_axis(vector: Array) -> Array:
    """The lab axis, with sign, nearest to a vector."""
    axis = int(np.argmax(np.abs(vector)))
    return _make_axis(axis, float(np.sign(vector[axis])))


def _describe_off_axis(vector: Array) -> str:
    return f"{np.degrees(np.arccos(_share(vector))):.0f} deg"


def _share(vector: Array) -> float:
    """Cosine between a vector and the nearest lab axis."""
    return min(float(np.abs(vector).max() / np.linalg.norm(vector)), 1.0)


def check_axes(up: str | None, forward: str | None) -> tuple[Array | None, Array | None]:
    """The laboratory's directions that were given as ``"+z"``, ``"z"`` or ``"-x"``.

    Raises InputError: one is no axis, or both name the same one.
    """
    up_vector = _to_axis(up, "up") if up is not None else None
    forward_vector = _to_axis(forward, "forward") if forward is not None else None
    if up_vector is not None and forward_vector is not None and up_vector @ forward_vector:
        raise InputError(
            "up and forward name the same axis", field="forward", remedy="Give two different axes"
        )
    return up_vector, forward_vector


def _to_axis(text: str, field: str) -> Array:
    word = text.strip().lower()
    sign, name = (word[0], word[1:]) if word[:1] in ("+", "-") else ("+", word)
    if len(name) != 1 or name not in _AXES:
        raise InputError(
            f"'{text}' is no axis",
            field=field,
            remedy="Give x, y or z with an optional sign, such as +z or -x",
        )
    return _make_axis(_AXES.index(name), 1.0 if sign == "+" else -1.0)


def _make_axis(axis: int, sign: float) -> Array:
    vector = np.zeros(3)
    vector[axis] = sign
    return vector


def _name(vector: Array) -> str:
    axis = int(np.argmax(np.abs(vector)))
    return ("+" if vector[axis] > 0 else "-") + _AXES[axis]
