"""What a cohort's statistics take of one subject: few numbers and mean curves, no recordings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from scaling_service.capabilities.scaling import result
from scaling_service.capabilities.scaling.comparison import geometry
from scaling_service.capabilities.scaling.comparison.curves import StrideCurves, make_stride_curves
from scaling_service.capabilities.scaling.methods.image_points import find_imaged_parts, find_lengths
from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.core.arrays import Array
from scaling_service.model import body
from scaling_service.model.anatomy.lengths import measure_segment_lengths
from scaling_service.model.subject import Session
from scaling_service.model.trial import ImageEvidence

TRUTH = "truth"
"""Stands beside the methods' names where the true body is known."""

IMAGED = "EB"
"""The reference of lengths and joint centres (Puchaud 2019, section 2.3): nothing in it is fitted."""


@dataclass(frozen=True, slots=True)
class Following:
    """How closely a method's model follows the markers of one trial, m.

    ``mean``, ``rms`` and ``max`` are over frames and markers; ``role`` is ``evaluation`` for a trial that
    was not used to fit.
    """

    role: Literal["calibration", "evaluation"]
    mean: float
    rms: float
    max: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodSummary:
    """One method's figures of one subject; an image-based method has what was imaged."""

    lengths: Mapping[str, float] = field(default_factory=dict)  # inter_hip, femur_r … to m
    trials: Mapping[str, Following] = field(default_factory=dict)  # calibration and evaluation
    knee_axes: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """``r``, ``l`` to the turns of the knee axis about x and y of the thigh, rad."""
    marker_shifts: Mapping[str, float] = field(default_factory=dict)
    """Marker to how far the fit moved it, m; empty where the method fits no marker."""
    curves: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """Coordinate to its mean over the subject's strides, (n_nodes,), rad."""
    from_truth_m: Mapping[str, float] = field(default_factory=dict)
    """What is measured (``lengths``, ``hip_centre`` …) to its distance from the truth."""
    from_truth_rad: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class SubjectSummary:
    """One subject's figures under all its methods.

    ``centres``: reference (``EB`` or ``truth``) to method, the reference's own name among them, to joint, to
    where the method puts its centre in the reference's proximal segment, mean over frames, m.
    """

    subject: str
    methods: Mapping[str, MethodSummary]  # in the order computed
    true_lengths: Mapping[str, float] = field(default_factory=dict)  # empty where the truth is not known
    centres: Mapping[str, Mapping[str, Mapping[str, body.Vector]]] = field(default_factory=dict)
    strides: Mapping[str, int] = field(default_factory=dict)  # r, l to the strides behind the curves
    no_strides: Mapping[str, str] = field(default_factory=dict)  # r, l to why there are none
    left_out: Mapping[str, str] = field(default_factory=dict)  # method to why it was not done


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """The true body and motion of a virtual person."""

    model: body.BodyModel
    motions: Mapping[str, Array]  # trial to coordinates, (n_frames, n_coordinates), rad or m


def summarise(
    results: result.Results, truth: Truth | None = None, left_out: Mapping[str, str] | None = None
) -> SubjectSummary:
    """What a cohort's statistics take of one subject's results.

    Joint centres and distances from the truth are taken on the evaluation trials, where there are any. Of
    what was not imaged an image-based method knows no length: what it took over from the other leg, from
    persons alike or from markers is left out here.
    """
    session, scalings = results.session, results.scalings
    motions = {method: scaling.motions for method, scaling in scalings.items()}
    strides = make_stride_curves(session.dynamic, motions, session.model)
    by_images = any(METHODS[method].needs_images for method in scalings)
    imaged = _find_imaged(session.model, session.images) if by_images else frozenset()
    return SubjectSummary(
        subject=session.subject.id,
        methods={
            method: _summarise_method(
                scaling, session, strides, imaged if METHODS[method].needs_images else None, truth
            )
            for method, scaling in scalings.items()
        },
        true_lengths={} if truth is None else measure_segment_lengths(truth.model),
        centres=_measure_centres(results, imaged, truth),
        strides=dict(strides.strides),
        no_strides=dict(strides.reasons),
        left_out=dict(left_out or {}),
    )


def _summarise_method(
    scaling: result.Scaling,
    session: Session,
    strides: StrideCurves,
    imaged: frozenset[str] | None,
    truth: Truth | None,
) -> MethodSummary:
    method, shape = scaling.calibration.method, scaling.geometry
    fitted = {trial.name for trial in session.calibration}
    moves_markers = any(p.group == "marker" for p in scaling.calibration.parameters)
    metres: dict[str, float] = {}
    radians: Mapping[str, float] = {}
    if truth is not None:
        # Distances of one method from the truth, m and rad, as `demo` shows them
        model = scaling.calibration.model
        motions = [scaling.motions[name] for name in _select_judged_trials(session)]
        lengths = [abs(gap) for gap in geometry.compute_length_errors(model, truth.model).values()]
        centres = geometry.compute_centre_errors(model, motions, truth.model, truth.motions)
        metres = {"lengths": sum(lengths) / len(lengths)} | {f"{n}_centre": gap for n, gap in centres.items()}
        radians = geometry.compute_angle_errors(motions, truth.model, truth.motions)
    return MethodSummary(
        lengths={n: v for n, v in shape.lengths.items() if imaged is None or n in imaged},
        trials={
            name: Following("calibration" if name in fitted else "evaluation", e.mean, e.rms, e.max)
            for name, e in scaling.errors.items()
        },
        knee_axes={s: v for s, v in shape.knee_axes.items() if imaged is None or f"knee_{s}" in imaged},
        marker_shifts=dict(shape.marker_shifts) if moves_markers else {},
        curves={name: tuple(map(float, curve)) for name, curve in strides.curves[method].items()},
        from_truth_m=metres,
        from_truth_rad=radians,
    )


def _find_imaged(model: body.BodyModel, images: ImageEvidence | None) -> frozenset[str]:
    """Lengths that images show, and joint centres in segments that they show; each counts by itself."""
    if images is None:
        return frozenset()
    parts = find_imaged_parts(model, images)
    hips = [f"hip_{side}" for side in "rl" if parts.pelvis is not None and f"hip_{side}" in images.centres]
    knees, ankles = (
        [f"{joint}_{s}" for s in found] for joint, found in (("knee", parts.thighs), ("ankle", parts.shanks))
    )
    return frozenset([*hips, *knees, *ankles, *find_lengths(images, model)])


def _select_judged_trials(session: Session) -> list[str]:
    """The trials on which models are compared in space: held out, where any trial is."""
    return [trial.name for trial in session.evaluation or session.calibration]


def _measure_centres(
    results: result.Results, imaged: frozenset[str], truth: Truth | None
) -> dict[str, dict[str, dict[str, body.Vector]]]:
    trials = _select_judged_trials(results.session)
    if not trials:
        return {}
    found: dict[str, dict[str, dict[str, body.Vector]]] = {}
    models = {
        method: (scaling.calibration.model, np.concatenate([scaling.motions[t].q for t in trials]))
        for method, scaling in results.scalings.items()
    }
    if IMAGED in models:
        seen = _express_centres(models, *models[IMAGED])
        found[IMAGED] = {m: {j: at for j, at in by.items() if j in imaged} for m, by in seen.items()}
    if truth is not None:
        true = truth.model, np.concatenate([truth.motions[t] for t in trials])
        found[TRUTH] = _express_centres({**models, TRUTH: true}, *true)
    return found


def _express_centres(
    models: Mapping[str, tuple[body.BodyModel, Array]], reference: body.BodyModel, q: Array
) -> dict[str, dict[str, body.Vector]]:
    return {name: geometry.place_centres(model, own, reference, q) for name, (model, own) in models.items()}
