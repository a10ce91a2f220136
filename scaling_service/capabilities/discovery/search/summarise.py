"""What a search found, with its limits and how much of the gap it closed.

The gap between simulation and measurement lies between noise floor and black-box bound. This bound is what
a correction of the same number of numbers would reach that may add to any marker a constant or a multiple
of any coordinate, wherever it helps most: it knows nothing of bodies. Absorbing lets the numbers that
calibration frees (sizes, knee axes, places of all markers) take up what they can.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from scaling_service.capabilities.discovery.disturbances.disturbance import Disturbance
from scaling_service.capabilities.discovery.effects.catalogue import propose_candidates
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.markers import MARKERS
from scaling_service.capabilities.discovery.evidence.noise_floors import Floors, measure_noise_floors
from scaling_service.capabilities.discovery.evidence.observation import Tally
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidates
from scaling_service.capabilities.discovery.evidence.statistics import fit_each
from scaling_service.capabilities.discovery.evidence.sums import Evidence, invert_curvature
from scaling_service.capabilities.discovery.evidence.wrench import OBSERVATIONS, WRENCH
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column, Estimate, Part
from scaling_service.capabilities.discovery.laws.profiles import ALWAYS, Following, Profile
from scaling_service.capabilities.discovery.laws.spots import MarkerSpot
from scaling_service.capabilities.discovery.observations.tracked import ROLES, Role
from scaling_service.capabilities.discovery.search.estimation import SOON, estimate
from scaling_service.capabilities.discovery.search.findings import Findings, Gap, Level, NamedEffect, Verdict
from scaling_service.capabilities.discovery.search.unexplained import (
    describe_unexplained,
    locate_disagreements,
)
from scaling_service.numerics.multibody.laws import Array

_NORMAL_95 = 1.96
_MARKERS, _FORCES, _MOMENTS = "markers", "force", "moment"
_ABSORBING = ("marker_offset", "segment_length", "joint_axis_tilt")


def measure_gaps(
    named: Sequence[NamedEffect], before: Fit, after: Fit, roles: Sequence[Role], floors: Floors
) -> dict[Role, Gap]:
    """Levels of all observables of the trials of each role."""
    count = sum(max(len(n.candidate.columns), 1) for n in named if MARKERS.shows(n.candidate))
    shares = fit_black_box(before, count) if count else dict.fromkeys(ROLES, 1.0)
    swallowed = _absorb_by_calibration(before) if named else before
    noise = floors[MARKERS.name].noise
    return {
        role: _measure_gap(
            before, after, role, floors, shares[role], _measure_reached(MARKERS.tally(swallowed, role, noise))
        )
        for role in roles
    }


def _measure_reached(tally: Tally | None) -> float:
    """Whitened RMS."""
    if tally is None:
        return float("nan")
    ratio = tally.square.sum(axis=0) / tally.floor.sum(axis=0).clip(1e-300)
    frames = tally.frames.sum(axis=0)
    return float((ratio @ frames / frames.sum()) ** 0.5)


def _measure_gap(before: Fit, after: Fit, role: Role, floors: Floors, left: float, absorbed: float) -> Gap:
    """Levels of a role.

    Parameters
    ----------
    left : float
        Share of the markers' squares that a black-box correction with as many numbers leaves.
    absorbed : float
        Whitened RMS where the calibration's parameters take up what they can instead.
    """
    bound = {_MARKERS: left}
    pairs: dict[str, tuple[Tally, Tally, slice]] = {}
    for observation, parts in ((MARKERS, {_MARKERS: slice(None)}), (WRENCH, _PARTS)):
        noise = floors[observation.name].noise
        old, new = (observation.tally(fit, role, noise) for fit in (before, after))
        if old is not None and new is not None:
            pairs |= {name: (old, new, part) for name, part in parts.items()}
    levels, places = {}, {}
    for name, (old, new, part) in pairs.items():
        levels[name] = _measure_level(old, new, part, bound.get(name, 1.0))
        for k in range(len(old.places))[part]:
            places[old.places[k]] = _measure_level(old, new, slice(k, k + 1), float("nan"))
    if pairs:
        levels = {"whitened": _measure_whitened(pairs, bound), **levels}
    return Gap(levels, places, absorbed)


_PARTS = {_FORCES: slice(0, 3), _MOMENTS: slice(3, 6)}


def _measure_level(old: Tally, new: Tally, part: slice, left: float) -> Level:
    """RMS of places together: a distance for markers, per component for wrenches."""
    frames = _count(old, part)
    before, after = old.square[:, part].sum(axis=1), new.square[:, part].sum(axis=1)
    floor = old.floor[:, part].sum()
    low, high = _estimate_interval(after, _count(new, part))
    mean = float(before.sum() / frames.sum())
    return Level(
        before=mean**0.5,
        after=float((after.sum() / _count(new, part).sum()) ** 0.5),
        floor=float((floor / frames.sum()) ** 0.5),
        ceiling=(mean * left) ** 0.5,
        low=low,
        high=high,
    )


def _count(tally: Tally, part: slice) -> Array:
    return np.asarray(tally.frames[:, part].sum(axis=1))


def _estimate_interval(squares: Array, frames: Array) -> tuple[float, float]:
    """95 % interval of an RMS over blocks."""
    mean = squares.sum() / frames.sum()
    stray = squares - mean * frames
    count = len(squares)
    error = float(np.sqrt((stray**2).sum() * count / max(count - 1, 1)) / frames.sum())
    return max(mean - _NORMAL_95 * error, 0.0) ** 0.5, (mean + _NORMAL_95 * error) ** 0.5


def _measure_whitened(pairs: Mapping[str, tuple[Tally, Tally, slice]], bound: Mapping[str, float]) -> Level:
    """All residuals divided by their floors; the floor is one."""
    before, after, weight, blocks = 0.0, 0.0, 0.0, []
    best = 0.0
    for name, (old, new, part) in pairs.items():
        own = old.floor[:, part].sum(axis=0)
        scale = np.divide(old.frames[:, part].sum(axis=0), own, out=np.zeros_like(own), where=own > 0)
        squares = old.square[:, part] @ scale
        before += float(squares.sum())
        best += float(squares.sum()) * bound.get(name, 1.0)
        blocks.append((new.square[:, part] @ scale, _count(new, part)))
        after += float(blocks[-1][0].sum())
        weight += float(_count(old, part).sum())
    squares, frames = (np.concatenate([b[k] for b in blocks]) for k in (0, 1))
    low, high = _estimate_interval(squares, frames)
    return Level(
        before=(before / weight) ** 0.5,
        after=(after / weight) ** 0.5,
        floor=1.0,
        ceiling=(best / weight) ** 0.5,
        low=low,
        high=high,
    )


def fit_black_box(before: Fit, count: int) -> dict[Role, float]:
    """Share of the markers' squares that the best ``count`` columns leave, by role.

    Columns are taken one after the other, each where it helps most beside those taken (orthogonal matching
    pursuit: Pati et al. 1993).
    """
    scene = before.scene
    profiles: tuple[Profile, ...] = (ALWAYS, *(Following(c) for c in scene.moving))
    choice = [
        Candidate(
            kind="black_box",
            where=(marker,),
            columns=(Column(name="a", unit=1.0, parts=(Part(MarkerSpot(marker, k), profile),)),),
        )
        for marker in scene.markers
        for k in range(3)
        for profile in profiles
    ]
    fitted = fit_each(MARKERS.gather_beside(before, choice, together=False), choice)
    order = sorted(range(len(choice)), key=lambda k: -fitted[k].gain)[: before.settings.black_box_columns]
    detail = MARKERS.gather_beside(before, [choice[k] for k in order], together=True)
    taken, size = _pursue(detail, count)
    left: dict[Role, float] = {}
    for role in ROLES:
        parts = [s for s in detail.blocks if s.role == role]
        square = sum(s.square for s in parts)
        gain = sum(2.0 * size @ s.scores[taken] - size @ s.own[np.ix_(taken, taken)] @ size for s in parts)
        left[role] = float(1.0 - gain / square) if square else 1.0
    return left


def _pursue(detail: Evidence, count: int) -> tuple[list[int], Array]:
    parts = [s for s in detail.blocks if s.role == "fit"]
    curvature, score = np.sum([s.own for s in parts], axis=0), np.sum([s.scores for s in parts], axis=0)
    taken = list(range(detail.nuisances))
    size = np.zeros(len(taken))
    for _ in range(count):
        rest = score - curvature[:, taken] @ size
        own = np.maximum(np.diag(curvature), 1e-300)
        gain = rest**2 / own
        gain[taken] = 0.0
        best = int(np.argmax(gain))
        if gain[best] <= 0.0:
            break
        taken.append(best)
        size = invert_curvature(curvature[np.ix_(taken, taken)], detail.raw[taken])[0] @ score[taken]
    return taken, size


def _absorb_by_calibration(before: Fit) -> Fit:
    """The fit in which what calibration can free takes up what it can."""
    taken = {s.candidate.name for s in before.estimates}
    added = [
        Estimate(c, np.zeros(len(c.columns)))
        for c in propose_candidates(before.scene, _ABSORBING)
        if not c.trials and c.name not in taken
    ]
    return estimate(before, added, SOON)


_DISTURBED = (
    "the recordings follow a law that the catalogue does not have, clearly better than any that it has: "
    "repair what it describes and search again"
)
_SPENT = "{} effects of one kind were named, the most that are looked for"
_NOTHING_MORE = "nothing in the catalogue explains what is left better than chance"


def summarise(
    named: Sequence[NamedEffect],
    scored: ScoredCandidates,
    disturbance: Disturbance | None,
    fits: tuple[Fit, Fit, Fit],
    notes: Sequence[str],
) -> Findings:
    """Where, what, how far the gap closed, and what is left.

    Parameters
    ----------
    fits : tuple of Fit
        Before, after, and as after but with the motion as it is without the markers that move independently.
    """
    before, after, seen = fits
    settings, moving = before.settings, before.scene.moving
    floors = measure_noise_floors(after, moving)
    places = locate_disagreements(before, floors)
    usual = floors if seen is after else measure_noise_floors(seen, moving)
    left = describe_unexplained(seen, usual, disturbance)
    verdict: Verdict = "found" if named else "unexplained" if left else "nothing"
    folds = not any(item.role == "held_out" for item in before.tracked)
    roles = ROLES[:1] if folds else ROLES
    by_role = measure_gaps(named, before, after, roles, floors)
    spent = any(sum(o.shows(n.candidate) for n in named) >= settings.most for o in OBSERVATIONS)
    ended = _SPENT.format(settings.most) if spent else _NOTHING_MORE
    return Findings(
        verdict=verdict,
        disagreements=places,
        named=tuple(named),
        fit=by_role[roles[0]],
        held_out=by_role[roles[-1]],
        folds=folds,
        tried=tuple(o for o in scored.best if o.candidate.key not in {n.key for n in named}),
        unexplained=left,
        reason=_DISTURBED if disturbance else ended,
        notes=(*notes, *_describe_limits(before, folds), *([_DISTURBED] if disturbance else [])),
    )


def _describe_limits(before: Fit, folds: bool) -> tuple[str, ...]:
    said = []
    if folds:
        said.append(
            "no trial was held out: effects were tried on blocks of time between those that fitted them"
        )
    longest = max(float(np.ptp(item.trial.times)) for item in before.tracked)
    if len(before.tracked) == 1 and longest < 5.0:
        undecided = "what changes from trial to trial, and small effects, cannot be decided"
        said.append(f"one trial of {longest:.1f} s: {undecided}")
    return tuple(said)
