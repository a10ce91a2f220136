"""A joint that moves in a way that the model locks: a turn or shift that may take any value in any frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Literal

import numpy as np

from scaling_service.capabilities.discovery.effects.catalogue import Effect
from scaling_service.capabilities.discovery.evidence.courses import (
    FreeCourse,
    compute_course_error,
    compute_course_rms,
    compute_energies,
    find_common_axis,
    solve_courses,
    spread_along,
)
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate
from scaling_service.capabilities.discovery.evidence.settings import IDENTIFIABLE
from scaling_service.capabilities.discovery.evidence.statistics import Fitted, HeldOut, assess_above_zero
from scaling_service.capabilities.discovery.laws.apply import name_freedom
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate, FreeMotion
from scaling_service.capabilities.discovery.laws.spots import At, JointSpot
from scaling_service.capabilities.discovery.observations.tracked import Role
from scaling_service.core.threads import map_parallel
from scaling_service.model.body import Vector
from scaling_service.numerics.multibody.laws import Array

MOST = {"rotation": np.radians(20.0), "translation": 0.03}
"""RMS of a motion that a model could have locked by mistake (chosen: nobody would lock a joint of more)."""

_PLACES: tuple[tuple[At, Literal["rotation", "translation"]], ...] = (
    ("before", "rotation"),
    ("after", "rotation"),
    ("start", "translation"),
)

_NOTES = {"before": "extra turn", "after": "extra turn about own axes", "start": "extra shift"}


def find_locked_motions(fit: Fit) -> Iterator[ScoredCandidate]:
    """Every joint that turns, with its best directions of turning and of shifting."""
    jointed = fit.scene.jointed
    spots = [JointSpot(s.name, at, kind, k) for s in jointed for at, kind in _PLACES for k in range(3)]
    joints = [(s, *place) for s in jointed for place in _PLACES]
    courses = map_parallel(partial(solve_courses, spots=spots), fit.tracked)
    shares = _compute_shares(courses)
    for k, (segment, at, kind) in enumerate(joints):
        if shares[k] > IDENTIFIABLE:
            by_trial = [found[k] for found, _ in courses]
            made = _find_best_direction(fit, by_trial)
            if made is not None and spread_along(by_trial, np.array(made[0])) < MOST[kind]:
                axis, fitted, gains, held_out = made
                motion = FreeMotion(segment.name, at, kind, axis)
                where = (fit.model.segment(segment.name).joint_name,)
                candidate = Candidate(
                    kind="missing_dof", where=where, columns=(), note=_NOTES[at], change=motion
                )
                yield ScoredCandidate(candidate=candidate, fitted=fitted, gains=gains, held_out=held_out)


def _compute_shares(courses: Sequence[tuple[list[FreeCourse], Array]]) -> Array:
    """Of every joint and kind: the largest share of a direction's square that no pose hides."""
    shown = [
        np.linalg.eigvalsh(np.sum([each[0][k].curvature.sum(axis=0) for each in courses], axis=0))[-1]
        for k in range(len(courses[0][0]))
    ]
    return np.asarray(np.array(shown) / np.maximum(np.sum([raw for _, raw in courses], axis=0), 1e-300))


def _find_best_direction(
    fit: Fit, courses: Sequence[FreeCourse]
) -> tuple[Vector, Fitted, Array, HeldOut] | None:
    """The direction that one joint's residuals keep to, and what a motion along it takes off."""
    parts: dict[Role, list[FreeCourse]] = {"fit": [], "held_out": []}
    for item, course in zip(fit.tracked, courses, strict=True):
        parts[item.role] += [course.cut(rows) for rows in item.blocks(fit.settings.block_s)]
    fitting, held = parts["fit"], parts["held_out"]
    axis = find_common_axis(fitting)
    if axis is None:
        return None
    gains, chance = compute_energies(fitting, axis)
    crossed = [
        _log_ratio(new, other)
        for known, new in ((fitting[0::2], fitting[1::2]), (fitting[1::2], fitting[0::2]))
        if (other := find_common_axis(known)) is not None and new
    ]
    p = assess_above_zero(np.concatenate(crossed)) if crossed else 1.0
    fitted = Fitted.of_any_course(float(gains.sum()), float(chance.sum()), p)
    tried = held or fitting
    gain, noise = compute_energies(held, axis) if held else (gains, chance)
    share = float((gain - noise).sum() / sum(c.square.sum() for c in tried))
    held_p = assess_above_zero(_log_ratio(held, axis)) if held else p
    x, y, z = (float(v) for v in axis)
    return (x, y, z), fitted, gains, HeldOut(share, held_p, folds=not held)


def _log_ratio(courses: Sequence[FreeCourse], axis: Array) -> Array:
    own, chance = compute_energies(courses, axis)
    return np.asarray(np.log(np.maximum(own, 1e-300) / np.maximum(chance, 1e-300)))


def is_in_usual_range(effect: Estimate, fit: Fit) -> bool:
    """Whether all numbers, estimated with everything else, are such as a laboratory could meet."""
    motion = effect.candidate.change
    if isinstance(motion, FreeMotion):
        return bool(compute_course_rms(fit.tracked, name_freedom(effect.candidate)) < MOST[motion.kind])
    return effect.candidate.plausible(effect.size)


def _describe_motion(effect: Estimate, after: Fit) -> Mapping[str, float]:
    """How much it moves, and along which axis."""
    motion = effect.candidate.change
    assert isinstance(motion, FreeMotion)
    rms = compute_course_rms(after.tracked, name_freedom(effect.candidate))
    return {
        **_size_in_results(motion, rms),
        **dict(zip(("axis_x", "axis_y", "axis_z"), motion.axis, strict=True)),
    }


def _estimate_motion_spreads(effect: Estimate, after: Fit) -> Mapping[str, float]:
    """How well its RMS is known."""
    motion = effect.candidate.change
    assert isinstance(motion, FreeMotion)
    sd = compute_course_error(after.tracked, name_freedom(effect.candidate), after.settings.block_s)
    return _size_in_results(motion, sd) if np.isfinite(sd) else {}


def _size_in_results(motion: FreeMotion, size: float) -> Mapping[str, float]:
    """In the units of results."""
    return {"rms_deg": float(np.degrees(size))} if motion.kind == "rotation" else {"rms_mm": 1e3 * size}


EFFECTS = (
    Effect(
        kind="missing_dof",
        meaning="the joint moves in a way that the model locks",
        search=find_locked_motions,
        details=_describe_motion,
        spreads=_estimate_motion_spreads,
    ),
)
