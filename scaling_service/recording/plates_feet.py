"""Which foot stands on which plate, when, and whether that can be true.

A contact (a run of loaded samples of one plate) belongs to the foot that the centre of pressure stays
under, or else to the only one that stands then and that no plate bears. A foot that the markers show on the
floor must bear a load, and one that they show in swing must not.
"""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array, Mask
from scaling_service.core.errors import TrialUnusable
from scaling_service.core.names import say_foot, say_name, say_plates
from scaling_service.model.forces import GroundForces, SegmentLoads
from scaling_service.model.trial import Repair
from scaling_service.numerics.multibody.rigid import rotate_about
from scaling_service.numerics.signals.filters import find_runs

NOBODY = -1  # no foot

REACH_M = 0.12
"""How far the centre of pressure may lie from the lines between a foot's markers (chosen: half a shoe's
width, 5 cm, and toes up to 8 cm before a metatarsal marker; two feet in walking stand farther apart)."""

SHOE_M = 0.05
"""Half a shoe's width: pressure under a foot is no farther from its markers. In 17 walks and runs whose feet
have markers it is 1 to 31 mm off in the median."""

_CLOSER = 1.0 / 3.0  # chosen: share of a distance that is left where a plate is put right

SOLE_M = 0.07
"""How far pressure may leave a foot's markers while the other foot stands unloaded (chosen: half a shoe's
width and 2 cm for the markers)."""

LIFTED_M = 0.05
"""Height of a foot's lowest marker above its usual place on the floor that means swing (chosen: toe
clearance in walking is smaller, but the heel then is high and the foot fast)."""

EDGE_M = 0.02
"""How far a marker near the floor may lie beyond a plate's edge while the whole foot is on it (chosen: a
shoe's rim and half a marker)."""

FAST_M_S = 0.5
"""Horizontal speed of a foot's slowest marker that means swing (chosen: a swinging foot reaches 3 to 4 m/s,
a standing one stays under 0.3 m/s with skin motion)."""

BRIEF_S = 0.03  # loads briefer than this are knocks (chosen)

ASTRAY_M = 0.3
"""How far pressure may lie from the only foot that can bear a load (chosen: a hand that pushes 100 N at 1.2 m
of height moves it by 0.2 m; a neighbour's foot is farther away)."""

ALIKE = 0.3  # chosen: share of the largest load from which one is a foot's, and not a stick's

TOLERATED = 0.2
"""Share of a contact in which the markers may disagree before it is noted (chosen: rolling at both ends)."""

_OF_FEET = frozenset({"two_plates", "over_edge", "no_plate"})
"""Repairs that tell of a foot; others tell of a plate."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FootContacts:
    """Who stands where.

    ``foot`` (n, n_plates): the row of ``feet`` that a plate bears, ``NOBODY`` where it bears none.
    ``supported`` (n,): frames whose forces are all known: every loaded plate bears a known foot, and no
    foot stands beside the plates or over the edge of one. ``repairs``: ``plate_foot`` for every contact;
    ``two_feet``, ``two_plates``, ``in_swing``, ``no_plate``, ``over_edge``, ``no_foot``, ``pressure_astray``,
    ``turned_plate`` where markers and forces disagree.
    """

    feet: tuple[str, ...]
    foot: NDArray[np.intp]
    on_floor: Mask  # (n, n_feet); by the markers alone
    over_edge: Mask  # (n, n_feet): the floor beside a plate bears a part of a foot that is on it
    supported: Mask
    repairs: tuple[Repair, ...]


def assign_plates(forces: GroundForces, feet: abc.Mapping[str, Array]) -> FootContacts:
    """Find the foot that each plate bears in each contact.

    ``forces``: at the times of the markers, Y up.
    ``feet``: foot (any name, usually its segment) to markers on it, shape (n, m, 3), m; heel and toe at
        least, NaN where not seen.
    Raises TrialUnusable: plates are loaded but none of the loads is near a foot.
    """
    names = tuple(feet)
    loaded = forces.in_contact()
    at = forces.centre_of_pressure()
    away = _measure_away(at, feet)
    on_floor, notes = _find_resting([feet[f] for f in names], forces.times, forces.name)
    foot = np.full(loaded.shape, NOBODY, dtype=np.intp)
    step = float(np.median(np.diff(forces.times))) if len(forces.times) > 1 else 0.0
    runs = [(k, *run) for k, one in enumerate(loaded.T) for run in find_runs(one).tolist()]
    spells = [(k, slice(start, stop)) for k, start, stop in runs if (stop - start) * step >= BRIEF_S]
    for k, rows in spells:
        typical = [_take_median(distances) for distances in away[:, rows, k]]
        nearest = int(np.argmin(typical))
        foot[rows, k] = nearest if typical[nearest] < REACH_M else NOBODY
    for k, rows in spells:
        if foot[rows.start, k] == NOBODY and bool(
            np.median(forces.pressing[rows, k]) > ALIKE * np.nanmax(forces.pressing)
        ):
            foot[rows, k] = _choose_idle_foot(away[:, rows, k], on_floor[rows], foot[rows])
        notes += _describe_contact(
            forces.plates[k],
            names,
            int(foot[rows.start, k]),
            on_floor[rows],
            away[:, rows, k],
            forces.times[rows],
        )
    if loaded.any() and (foot == NOBODY).all():
        raise TrialUnusable(
            "no load is near a foot",
            file=forces.name,
            field="forces",
            remedy="Check that forces and markers are of one recording, in one system of axes and unit",
        )
    foot[~loaded] = NOBODY
    notes += _find_turned(forces, feet, on_floor)
    notes += _find_two_feet(foot, away, on_floor, forces) + _find_two_plates(foot, names)
    over_edge, astride = _find_over_edge(foot, feet, forces)
    supported, more = _find_supported(foot, loaded, on_floor, names, forces)
    return FootContacts(
        feet=names,
        foot=foot,
        on_floor=on_floor,
        over_edge=over_edge,
        supported=supported & ~over_edge.any(axis=1),
        repairs=(*notes, *astride, *more),
    )


def _measure_away(at: Array, feet: abc.Mapping[str, Array]) -> Array:
    """Horizontal distance of places (n, n_plates, 3) to lines between a foot's markers, by foot first, m."""
    at = at[..., (0, 2)]
    away = np.full((len(feet), *at.shape[:2]), np.inf)
    for best, markers in zip(away, feet.values(), strict=True):
        flat = markers[..., (0, 2)]
        for i, j in combinations_with_replacement(range(flat.shape[1]), 2):
            start, along = flat[:, i, None], (flat[:, j] - flat[:, i])[:, None]
            square = (along**2).sum(axis=-1)
            share = ((at - start) * along).sum(axis=-1) / np.where(square > 0, square, 1.0)
            nearest = start + np.clip(share, 0.0, 1.0)[..., None] * along
            np.fmin(best, np.linalg.norm(at - nearest, axis=-1), out=best)
    return away


def _find_turned(forces: GroundForces, feet: abc.Mapping[str, Array], on_floor: Mask) -> list[Repair]:
    """Plates whose pressure is under no foot, unless their corners are listed from another one on."""
    if forces.corners is None:
        return []
    lone = forces.in_contact() & (on_floor.sum(axis=1) == 1)[:, None]
    at, middles = forces.centre_of_pressure(), forces.surfaces
    away = []
    for quarter in range(4):
        R = rotate_about([0.0, 1.0, 0.0], quarter * np.pi / 2.0)
        away.append(_measure_away((at - middles) @ R.T + middles, feet).min(axis=0))
    notes = []
    for k, plate in enumerate(forces.plates):
        typical = [_take_median(distances[lone[:, k], k]) for distances in away]
        best = int(np.argmin(typical))
        if typical[0] > SHOE_M and typical[best] < _CLOSER * typical[0]:
            detail = (
                f"pressure lies {100 * typical[0]:.0f} cm off every foot, and {100 * typical[best]:.0f} cm "
                f"with the plate turned by {90 * best} deg: look at the order of its corners"
            )
            frames = int(lone[:, k].sum())
            notes.append(Repair("turned_plate", plate, detail, frames=frames))
    return notes


def assign_foot_loads(
    forces: GroundForces, contacts: FootContacts, segments: abc.Mapping[str, str]
) -> SegmentLoads:
    """The wrench that each foot's segment receives from all plates it stands on.

    ``contacts``: of these forces. ``segments``: foot to the model's segment. Returns NaN where a plate's
    force is not known: it might bear any foot. Loads below the threshold count for nobody.
    """
    owns = contacts.foot[:, None, :] == np.arange(len(contacts.feet))[None, :, None]
    unknown = ~forces.known
    force = np.einsum("nfk,nka->nfa", owns, np.where(unknown[..., None], 0.0, forces.force))
    moment = np.einsum("nfk,nka->nfa", owns, np.where(unknown[..., None], 0.0, forces.moment))
    lost = unknown.any(axis=1)
    force[lost], moment[lost] = np.nan, np.nan
    return SegmentLoads(forces.times, tuple(segments[f] for f in contacts.feet), force, moment)


def _find_resting(feet: abc.Sequence[Array], times: Array, name: str) -> tuple[Mask, list[Repair]]:
    """Whether each foot rests, (n, n_feet): a marker near the floor, and one that moves with it.

    The floor is where the lower foot stands, for a foot may be in the air all the time. It moves on a
    treadmill: with the lowest marker of both feet.
    """
    usual = []
    for markers in feet:
        # Height of each marker while its foot stands, (m,); infinite where it is never seen.
        heights = [h[np.isfinite(h)] for h in markers[..., 1].T]
        usual.append(np.array([np.percentile(h, 5) if len(h) else np.inf for h in heights]))
    floor = min(float(heights.min()) for heights in usual)
    above = [m[..., 1] - (h - h.min() + floor) for m, h in zip(feet, usual, strict=True)]
    heights = [np.where(np.isfinite(x), x, np.inf) for x in above]
    velocities = []
    for markers in feet:
        # Horizontal velocities, (n, m, 2), m/s; zero for a single frame.
        flat = markers[..., (0, 2)]
        velocities.append(np.gradient(flat, times, axis=0) if len(times) > 1 else np.zeros_like(flat))
    # Median velocity of the lowest marker, (2,); a floor that is no faster than a swinging foot stands still.
    lowest = np.concatenate(heights, axis=1).argmin(axis=1)
    with_floor = np.concatenate(velocities, axis=1)[np.arange(len(lowest)), lowest]
    with_floor = with_floor[np.isfinite(with_floor).all(axis=1)]
    belt = np.median(with_floor, axis=0) if len(with_floor) else np.zeros(2)
    notes = []
    if np.linalg.norm(belt) <= FAST_M_S:
        belt = np.zeros(2)
    else:
        detail = f"the floor moves at {np.linalg.norm(belt):.2f} m/s, as on a treadmill"
        notes.append(Repair("belt", name, detail))
    resting = []
    for height, velocity in zip(heights, velocities, strict=True):
        speed = np.linalg.norm(velocity - belt, axis=2)
        slowest = np.where(np.isfinite(speed), speed, np.inf).min(axis=1)
        resting.append((height.min(axis=1) < LIFTED_M) & (slowest < FAST_M_S))
    return np.stack(resting, axis=1), notes


def _choose_idle_foot(away: Array, on_floor: Mask, foot: NDArray[np.intp]) -> int:
    """The one foot that stands during a contact (n frames) and that no other plate bears, if it is not far.

    Whoever pushes the body, and a plate that is not where it is said to be, move the pressure off the foot.
    """
    stands = on_floor.mean(axis=0) > 1.0 - TOLERATED
    idle = [f for f in np.flatnonzero(stands).tolist() if (foot == f).any(axis=1).mean() < TOLERATED]
    return idle[0] if len(idle) == 1 and _take_median(away[idle[0]]) < ASTRAY_M else NOBODY


def say_where(what: str, where: str) -> str:
    """Of which plate or foot a kind of repair of forces tells, within a sentence."""
    return say_foot(where) if what in _OF_FEET else say_plates(where)


def _take_median(distances: Array) -> float:
    known = distances[np.isfinite(distances)]
    return float(np.median(known)) if len(known) else float("inf")


def _describe_contact(
    plate: str, names: tuple[str, ...], chosen: int, on_floor: Mask, away: Array, times: Array
) -> list[Repair]:
    """What to say about one contact."""
    span, n = f"from {times[0]:.2f} to {times[-1]:.2f} s", len(times)
    if chosen == NOBODY:
        return [Repair("no_foot", plate, f"loaded {span}, but no foot is near", frames=n)]
    foot = say_foot(names[chosen])
    notes = [Repair("plate_foot", plate, f"bears the {foot} {span}", frames=n)]
    off = _take_median(away[chosen])
    if off >= REACH_M:
        detail = f"pressure lies {100 * off:.0f} cm off the {foot}, the only foot that stands free {span}"
        notes.append(Repair("pressure_astray", plate, detail, frames=n))
    swinging = ~on_floor[:, chosen]
    if swinging.mean() > TOLERATED:
        detail = f"bears the {foot} {span}, but the markers show it in swing in {swinging.mean():.0%} of it"
        notes.append(Repair("in_swing", plate, detail, frames=int(swinging.sum())))
    return notes


def _find_two_feet(foot: NDArray[np.intp], away: Array, on_floor: Mask, forces: GroundForces) -> list[Repair]:
    """Plates whose pressure leaves the foot they bear towards one that stands and bears nothing."""
    notes = []
    for k, plate in enumerate(forces.plates):
        shared = np.zeros(len(foot), dtype=bool)
        for f in range(away.shape[0]):
            others = [g for g in range(away.shape[0]) if g != f]
            idle = [on_floor[:, g] & (foot != g).all(axis=1) for g in others]
            nearer = np.min([away[g, :, k] for g in others], axis=0, initial=np.inf) < away[f, :, k]
            leaves = (away[f, :, k] > SOLE_M) | nearer
            shared |= (foot[:, k] == f) & np.any(idle, axis=0) & leaves
        if shared.sum() > TOLERATED * max(1, int((foot[:, k] != NOBODY).sum())):
            detail = (
                "bears two feet at once: pressure lies between them, so their forces cannot be told apart"
            )
            notes.append(Repair("two_feet", plate, detail, frames=int(shared.sum())))
    return notes


def _find_two_plates(foot: NDArray[np.intp], names: tuple[str, ...]) -> list[Repair]:
    notes = []
    for k, name in enumerate(names):
        count = int(((foot == k).sum(axis=1) > 1).sum())
        if count:
            notes.append(
                Repair("two_plates", name, "stands on two plates at once; both loads count", frames=count)
            )
    return notes


def measure_overhang(corners: Array, markers: Array) -> Array:
    """How far a foot's markers near the floor reach beyond the edges of all plates, (n,), m.

    ``corners`` (k, 4, 3) and ``markers`` (n, m, 3) in the same axes, Y up. Negative inside a plate; minus
    infinity where no marker is near the floor.
    """
    height = markers[..., 1]
    usual = [np.percentile(h[np.isfinite(h)], 5) if np.isfinite(h).any() else np.nan for h in height.T]
    low = height < np.array(usual) + LIFTED_M  # False where it is not seen
    beyond = np.full(height.shape, np.inf)
    for rim in corners[..., (0, 2)]:
        sides = rim[[0, 0]] - rim[[1, 3]]
        half = np.linalg.norm(sides, axis=1) / 2.0
        along = np.abs((markers[..., (0, 2)] - rim.mean(axis=0)) @ (sides / (2.0 * half[:, None])).T)
        np.fmin(beyond, (along - half).max(axis=-1), out=beyond)
    return np.asarray(np.where(low, beyond, -np.inf).max(axis=1, initial=-np.inf))


def _find_over_edge(
    foot: NDArray[np.intp], feet: abc.Mapping[str, Array], forces: GroundForces
) -> tuple[Mask, list[Repair]]:
    """Where a foot that a plate bears reaches beyond the edges of all plates, (n, n_feet)."""
    found = np.zeros((len(foot), len(feet)), dtype=bool)
    notes: list[Repair] = []
    if forces.corners is None:
        return found, notes
    for k, (name, markers) in enumerate(feet.items()):
        reach = measure_overhang(forces.corners, markers)
        found[:, k] = (foot == k).any(axis=1) & (reach > EDGE_M)
        for start, stop in find_runs(found[:, k]).tolist():
            on = forces.plates[int(np.argmax(foot[start] == k))]
            detail = (
                f"reaches {1e3 * reach[start:stop].max():.0f} mm beyond the edge of {say_name(on)} from "
                f"{forces.times[start]:.2f} to {forces.times[stop - 1]:.2f} s: the floor bears a part of it"
            )
            notes.append(Repair("over_edge", name, detail, frames=stop - start))
    return found, notes


def _find_supported(
    foot: NDArray[np.intp], loaded: Mask, on_floor: Mask, names: tuple[str, ...], forces: GroundForces
) -> tuple[Mask, list[Repair]]:
    """Frames without an unknown contact, and who stands beside the plates."""
    known = np.asarray(forces.known.all(axis=1))
    bears = np.stack([(foot == k).any(axis=1) for k in range(len(names))], axis=1)
    beside = np.asarray(on_floor & ~bears & known[:, None])
    step = float(np.median(np.diff(forces.times))) if len(forces.times) > 1 else 0.0
    lasting = np.zeros_like(beside)
    notes = []
    for k, name in enumerate(names):
        for start, stop in find_runs(beside[:, k]).tolist():
            # The foot comes down and rolls off for some frames without load.
            lasting[start:stop, k] = (stop - start) * step > 2 * BRIEF_S
        if lasting[:, k].any():
            detail = "stands beside the plates; dynamics cannot be told in these frames"
            notes.append(Repair("no_plate", name, detail, frames=int(lasting[:, k].sum())))
    stray = (loaded & (foot == NOBODY)).any(axis=1)
    return known & ~stray & ~lasting.any(axis=1), notes
