"""From results in memory to the documents that are written, in mm and degrees."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from scaling_service.capabilities.motion.kinematic_error import KinematicError
from scaling_service.capabilities.scaling.clinical.gait import ClinicalGait, clinical_document
from scaling_service.capabilities.scaling.comparison.evidence import Verdict, following
from scaling_service.capabilities.scaling.run import Results, Scaling
from scaling_service.capabilities.subject.provenance import provenance, stated_sizes
from scaling_service.documents.results import (
    ComparisonDocument,
    FittedParameter,
    JointCentre,
    KneeAxis,
    LengthEstimate,
    MethodResult,
    PersonCentre,
    Provenance,
    ScalingDocument,
    TrialError,
    TruthDocument,
    VerdictDocument,
    WallTime,
)
from scaling_service.model.results import Calibration


def comparison_document(
    results: Results, methods: dict[str, MethodResult], truth: TruthDocument | None, verdict: Verdict
) -> ComparisonDocument:
    """``comparison.json``."""
    session, settings = results.session, results.settings
    trials = [trial for trial in (session.static, *session.dynamic) if trial is not None]
    return ComparisonDocument(
        **provenance(results.loaded, trials, settings.resolved(), results.subject_file, settings.seed),
        sizes=stated_sizes(session.subject),
        verdict=VerdictDocument.model_validate(verdict, from_attributes=True),
        methods=methods,
        warnings=list(results.warnings),
        wall_s=round(results.wall_s, 3),
        truth=truth,
    )


def scaling_documents(document: ComparisonDocument) -> dict[str, ScalingDocument]:
    """``scaling.json`` of each method; the warnings of the whole session stand before the method's own."""
    shared = {name: getattr(document, name) for name in Provenance.model_fields}
    return {
        name: ScalingDocument(**shared, **dict(method) | {"warnings": [*document.warnings, *method.warnings]})
        for name, method in document.methods.items()
    }


def method_document(
    scaling: Scaling,
    results: Results,
    gait: ClinicalGait,
    files: Sequence[str] = (),
    warnings: Sequence[str] = (),
) -> MethodResult:
    """One method's results, with the files and warnings that writing them added."""
    calibration, shape = scaling.calibration, scaling.geometry
    fitted = following(scaling.errors, [trial.name for trial in results.session.calibration])
    held_out = following(scaling.errors, results.held_out)
    return MethodResult(
        method=calibration.method,
        kinematic_error_mm={
            name: _error(error, held_out=name in results.held_out) for name, error in scaling.errors.items()
        },
        fitted_mean_mm=None if fitted is None else _mm(fitted.mean),
        held_out_mean_mm=None if held_out is None else _mm(held_out.mean),
        held_out_ratio=None
        if fitted is None or held_out is None or fitted.mean <= 0.0
        else round(held_out.mean / fitted.mean, 4),
        segment_lengths_mm={name: _mm(length) for name, length in shape.lengths.items()},
        length_estimates=_length_estimates(calibration, shape.lengths),
        joint_centres_mm={
            name: JointCentre(frame=frame, xyz=_mm3(at)) for name, (frame, at) in shape.joint_centres.items()
        },
        person_centres={
            name: PersonCentre(source=centre.source, sd_mm=_mm3(centre.sd))
            for name, centre in calibration.centres.items()
        },
        knee_axis_deg={
            side: KneeAxis(x=round(math.degrees(x), 4), y=round(math.degrees(y), 4))
            for side, (x, y) in shape.knee_axes.items()
        },
        marker_shift_mm={name: _mm(shift) for name, shift in shape.marker_shifts.items()},
        scale_factors=dict(calibration.scale_factors),
        parameters=[
            FittedParameter(
                name=p.name,
                value=p.value,
                unit=p.unit,
                sd=p.sd if math.isfinite(p.sd) else None,
                at_bound=p.at_bound,
                identifiable=p.identifiable,
            )
            for p in calibration.parameters
        ],
        cumulative_error_mm2=None if math.isnan(calibration.cost) else round(calibration.cost * 1e6, 2),
        iterations=calibration.iterations,
        wall_s=WallTime(
            calibration=round(calibration.wall_s, 4),
            inverse_kinematics=round(scaling.inverse_kinematics_s, 4),
        ),
        clinical=clinical_document(gait),
        warnings=[*calibration.warnings, *warnings],
        files=list(files),
    )


def _length_estimates(calibration: Calibration, lengths: Mapping[str, float]) -> dict[str, LengthEstimate]:
    """By name of the length; a planar model's has no side and is estimated as the right one."""
    sizes = {size.dimension: size for size in calibration.sizes.values()}
    found = {name: sizes.get(name) or sizes.get(f"{name}_r") for name in lengths}
    return {
        name: LengthEstimate(
            sd_mm=_mm(size.sd * lengths[name]),
            measured=round(size.measured, 4),
            others=round(size.others, 4),
            expected=round(size.expected, 4),
        )
        for name, size in found.items()
        if size is not None
    }


def _error(error: KinematicError, *, held_out: bool) -> TrialError:
    anatomical, tracking = error.anatomical_mean, error.tracking_mean
    return TrialError(
        role="evaluation" if held_out else "calibration",
        mean=_mm(error.mean),
        sd=_mm(error.sd),
        rms=_mm(error.rms),
        max=_mm(error.max),
        anatomical_mean=None if math.isnan(anatomical) else _mm(anatomical),
        tracking_mean=None if math.isnan(tracking) else _mm(tracking),
        frames=error.n_frames,
        per_marker={name: _mm(value) for name, value in error.per_marker.items()},
    )


def _mm(metres: float) -> float:
    """A tenth of a micrometre is beyond any measurement."""
    return round(metres * 1e3, 4)


def _mm3(metres: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = (_mm(v) for v in metres)
    return (x, y, z)
