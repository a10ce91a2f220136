"""From results in memory to the verdict on them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from itertools import combinations

import numpy as np

from scaling_service.capabilities.scaling.comparison.kinematic_error import KinematicError
from scaling_service.capabilities.scaling.comparison.verdict import judge
from scaling_service.capabilities.scaling.comparison.verdict_evidence import (
    Evidence,
    Following,
    MethodEvidence,
    Verdict,
)
from scaling_service.capabilities.scaling.methods.table import METHODS, Optimised
from scaling_service.capabilities.scaling.plausible import SHARE_OF_STATURE, SPREAD
from scaling_service.capabilities.scaling.run import Results, Scaling
from scaling_service.documents.results import TrustNote, VerdictDocument
from scaling_service.model.body import GROUND, BodyModel


def verdict_of(results: Results) -> Verdict:
    """Which of the methods computed to use for this person, why, and how far to trust it."""
    return judge(evidence_of(results))


def evidence_of(results: Results) -> Evidence:
    """What a verdict on the methods computed rests on."""
    session = results.session
    fitted = [trial.name for trial in session.calibration]
    held_out = [trial.name for trial in session.dynamic if trial.name not in fitted]
    return Evidence(
        tuple(_method(scaling, fitted, held_out) for scaling in results.scalings.values()),
        frozenset() if session.images is None else frozenset(session.images.centres),
        usual_lengths(session.subject.height_m, results.scalings),
        SPREAD,
        angles_apart(results.scalings, held_out or fitted),
    )


def verdict_document(verdict: Verdict) -> VerdictDocument:
    """The verdict as it is written into ``comparison.json``."""
    return VerdictDocument(
        method=verdict.method,
        strength=verdict.strength,
        headline=verdict.headline,
        why=list(verdict.why),
        trust=[TrustNote(topic=t.topic, level=t.level, text=t.text) for t in verdict.trust],
    )


def _method(scaling: Scaling, fitted: Iterable[str], held_out: Iterable[str]) -> MethodEvidence:
    calibration, shape = scaling.calibration, scaling.geometry
    method = METHODS[calibration.method]
    parameters = calibration.parameters
    return MethodEvidence(
        calibration.method,
        start=method.needs,
        from_images=_from_images(calibration.method),
        fits_lengths=isinstance(method, Optimised) and method.freedom.lengths,
        fitted=_following(scaling.errors, fitted),
        held_out=_following(scaling.errors, held_out),
        parameters=len(parameters),
        undetermined=sum(not p.identifiable for p in parameters),
        at_bounds=sum(p.at_bound for p in parameters),
        lengths=shape.lengths,
        hip_centres={
            name: at for name, (_, at) in shape.joint_centres.items() if name.partition("_")[0] == "hip"
        },
        knee_axes=shape.knee_axes,
        length_sds={
            size.dimension: size.sd * shape.lengths[size.dimension]
            for size in calibration.sizes.values()
            if size.dimension in shape.lengths
        },
        inferred=tuple(name for name, size in calibration.sizes.items() if not size.own),
    )


def _from_images(method: str) -> bool:
    return METHODS[method].needs_images


def _following(errors: Mapping[str, KinematicError], trials: Iterable[str]) -> Following | None:
    """Over trials that show any marker; None if there is none."""
    known = [errors[name] for name in trials if name in errors and not math.isnan(errors[name].mean)]
    if not known:
        return None
    return Following(
        mean=float(np.mean([e.mean for e in known])),
        rms=float(np.sqrt(np.mean([e.rms**2 for e in known]))),
        max=max(e.max for e in known),
        trials=len(known),
    )


def usual_lengths(height_m: float | None, scalings: Mapping[str, Scaling]) -> dict[str, float]:
    """Length to what is usual for a height, m; empty where the height is not known."""
    if height_m is None:
        return {}
    names = {name for scaling in scalings.values() for name in scaling.geometry.lengths}
    roles = {name: name.rpartition("_")[0] for name in sorted(names)}
    return {
        name: height_m * SHARE_OF_STATURE[role] for name, role in roles.items() if role in SHARE_OF_STATURE
    }


def joint_angles(model: BodyModel) -> tuple[str, ...]:
    """The coordinates that are angles of joints: turns, but not those of the whole body in the laboratory."""
    root = {
        term.coordinate
        for segment in model.children(GROUND)
        for joint in segment.joints
        for term in joint.law.terms
    }
    return tuple(c.name for c in model.coordinates if c.kind == "rotation" and c.name not in root)


def angles_apart(
    scalings: Mapping[str, Scaling], trials: Iterable[str]
) -> dict[tuple[str, str], tuple[str, float]]:
    """For every two methods the joint angle in which they differ most, and its RMS difference, rad.

    Over the frames of ``trials`` in which both methods know the angle.
    """
    chosen, found = tuple(trials), {}
    for first, second in combinations(scalings, 2):
        gaps = _gaps(scalings[first], scalings[second], chosen)
        if gaps:
            worst = max(gaps, key=lambda name: gaps[name])
            found[first, second] = (worst, gaps[worst])
    return found


def _gaps(first: Scaling, second: Scaling, trials: tuple[str, ...]) -> dict[str, float]:
    """Joint angle to the RMS difference of two methods, rad."""
    gaps = {}
    for name in joint_angles(first.calibration.model):
        squares = [
            (_angle(first, trial, name) - _angle(second, trial, name)) ** 2
            for trial in trials
            if _follows(first, trial, name) and _follows(second, trial, name)
        ]
        known = np.concatenate(squares) if squares else np.empty(0)
        known = known[np.isfinite(known)]
        if known.size:
            gaps[name] = float(np.sqrt(known.mean()))
    return gaps


def _follows(scaling: Scaling, trial: str, coordinate: str) -> bool:
    return trial in scaling.motions and coordinate in scaling.motions[trial].estimated


def _angle(
    scaling: Scaling, trial: str, coordinate: str
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    motion = scaling.motions[trial]
    return motion.q[:, motion.coordinates.index(coordinate)]
