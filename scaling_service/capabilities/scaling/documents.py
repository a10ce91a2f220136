"""From results in memory to the documents that are written, in mm and degrees."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from scaling_service.capabilities.scaling.clinical.document import clinical_document, clinical_of
from scaling_service.capabilities.scaling.clinical.gait import ClinicalGait
from scaling_service.capabilities.scaling.comparison.generalisation import generalisation
from scaling_service.capabilities.scaling.comparison.kinematic_error import KinematicError
from scaling_service.capabilities.scaling.run import Results, Scaling
from scaling_service.capabilities.subject.reading import input_hashes
from scaling_service.documents.results import (
    ComparisonDocument,
    FittedParameter,
    JointCentre,
    KneeAxis,
    LengthEstimate,
    MethodResult,
    PersonCentre,
    Provenance,
    RepairNote,
    ScalingDocument,
    TrialError,
    TruthDocument,
    VerdictDocument,
    WallTime,
)
from scaling_service.documents.subject import SIZE_UNIT
from scaling_service.model.results import Calibration, EstimatedParameter
from scaling_service.model.subject import Subject
from scaling_service.model.trial import Repair

_MM = 1e3


def code_version() -> str:
    """The installed package's version."""
    try:
        return version("scaling-service")
    except PackageNotFoundError:
        return "not installed"


def comparison_document(
    results: Results,
    documents: dict[str, MethodResult],
    truth: TruthDocument | None = None,
    verdict: VerdictDocument | None = None,
) -> ComparisonDocument:
    """``comparison.json``."""
    return ComparisonDocument(
        **_fields(provenance(results)),
        verdict=verdict,
        methods=documents,
        warnings=list(results.warnings),
        wall_s=_rounded(results.wall_s, 3),
        truth=truth,
    )


def scaling_document(results: Results, document: MethodResult) -> ScalingDocument:
    """``scaling.json``; the warnings that concern the whole session stand before the method's own."""
    fields = _fields(document) | {"warnings": [*results.warnings, *document.warnings]}
    return ScalingDocument(**_fields(provenance(results)), **fields)


def provenance(results: Results) -> Provenance:
    """What is needed to get the same results again."""
    session = results.session
    trials = [*([session.static] if session.static is not None else []), *session.dynamic]
    return Provenance(
        code_version=code_version(),
        subject=session.subject.id,
        settings=results.settings.resolved(),
        input_hashes=input_hashes(session.subject, results.subject_file),
        seed=results.settings.seed,
        markers_used={name: list(labels) for name, labels in results.loaded.markers_used.items()},
        repairs={trial.name: repair_notes(trial.repairs) for trial in trials},
        sizes=stated_sizes(session.subject),
    )


def stated_sizes(subject: Subject) -> dict[str, float]:
    """Height, mass and sizes measured by hand, each with its unit in the name, as subject files have them."""
    whole = {"height_m": subject.height_m, "mass_kg": subject.mass_kg}
    lengths = {f"{name}{SIZE_UNIT}": _rounded(value * _MM, 2) for name, value in subject.sizes_m.items()}
    return {name: value for name, value in whole.items() if value is not None} | lengths


def method_document(
    scaling: Scaling,
    results: Results,
    files: Sequence[str] = (),
    warnings: Sequence[str] = (),
    gait: ClinicalGait | None = None,
) -> MethodResult:
    """One method's results, with the files and warnings that writing them added."""
    calibration, shape = scaling.calibration, scaling.geometry
    fitted = {trial.name for trial in results.session.calibration}
    overall = generalisation(scaling.errors, fitted)
    return MethodResult(
        method=calibration.method,
        kinematic_error_mm={name: _error(error, name in fitted) for name, error in scaling.errors.items()},
        fitted_mean_mm=_mm_or_none(overall.fitted),
        held_out_mean_mm=_mm_or_none(overall.held_out),
        held_out_ratio=None if math.isnan(overall.ratio) else _rounded(overall.ratio, 4),
        segment_lengths_mm={name: _mm(length) for name, length in shape.lengths.items()},
        length_estimates=_length_estimates(calibration, shape.lengths),
        person_centres={
            name: PersonCentre(source=centre.source, sd_mm=(_mm(x), _mm(y), _mm(z)))
            for name, centre in calibration.centres.items()
            for x, y, z in (centre.sd,)
        },
        joint_centres_mm={
            name: JointCentre(frame=frame, xyz=(_mm(x), _mm(y), _mm(z)))
            for name, (frame, (x, y, z)) in shape.joint_centres.items()
        },
        knee_axis_deg={
            side: KneeAxis(x=_rounded(math.degrees(x), 4), y=_rounded(math.degrees(y), 4))
            for side, (x, y) in shape.knee_axes.items()
        },
        marker_shift_mm={name: _mm(shift) for name, shift in shape.marker_shifts.items()},
        scale_factors=dict(calibration.scale_factors),
        parameters=[_parameter(parameter) for parameter in calibration.parameters],
        cumulative_error_mm2=None if math.isnan(calibration.cost) else _rounded(calibration.cost * _MM**2, 2),
        iterations=calibration.iterations,
        wall_s=WallTime(
            calibration=_rounded(calibration.wall_s, 4),
            inverse_kinematics=_rounded(scaling.inverse_kinematics_s, 4),
        ),
        clinical=clinical_document(clinical_of(scaling, results) if gait is None else gait),
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
            measured=_rounded(size.measured, 4),
            others=_rounded(size.others, 4),
            expected=_rounded(size.expected, 4),
        )
        for name, size in found.items()
        if size is not None
    }


def _error(error: KinematicError, fitted: bool) -> TrialError:
    return TrialError(
        role="calibration" if fitted else "evaluation",
        mean=_mm(error.mean),
        sd=_mm(error.sd),
        rms=_mm(error.rms),
        max=_mm(error.max),
        anatomical_mean=_mm_or_none(error.anatomical_mean),
        tracking_mean=_mm_or_none(error.tracking_mean),
        frames=error.n_frames,
        per_marker={name: _mm(value) for name, value in error.per_marker.items()},
    )


def _parameter(parameter: EstimatedParameter) -> FittedParameter:
    return FittedParameter(
        name=parameter.name,
        value=parameter.value,
        unit=parameter.unit,
        sd=parameter.sd if math.isfinite(parameter.sd) else None,
        at_bound=parameter.at_bound,
        identifiable=parameter.identifiable,
    )


def repair_notes(repairs: Iterable[Repair]) -> list[RepairNote]:
    """What was changed in a recording, as results tell it."""
    return [RepairNote(what=r.what, where=r.where, detail=r.detail, frames=r.frames) for r in repairs]


def _fields(document: Provenance | MethodResult) -> dict[str, Any]:
    """A document's fields as they are, nested documents kept."""
    return {name: getattr(document, name) for name in type(document).model_fields}


def _mm(metres: float) -> float:
    return _rounded(metres * _MM, 4)


def _mm_or_none(metres: float) -> float | None:
    return None if math.isnan(metres) else _mm(metres)


def _rounded(value: float, digits: int) -> float:
    """Figures that are written for people; a tenth of a micrometre is beyond any measurement."""
    return round(value, digits)
