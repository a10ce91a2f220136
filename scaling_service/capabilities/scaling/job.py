"""Scaling and the comparison of methods as jobs."""

from __future__ import annotations

import typing
from collections.abc import Sequence
from pathlib import Path

import pydantic

from scaling_service.capabilities.scaling import comparison_views
from scaling_service.capabilities.scaling.options import ComparisonOptions, ScaleOptions
from scaling_service.capabilities.shared import job, names
from scaling_service.core.progress import Progress, report_part
from scaling_service.documents import results as documents
from scaling_service.documents.base import DOCUMENT

if typing.TYPE_CHECKING:
    from scaling_service.capabilities.scaling.result import Results

_COMPUTING, _WRITING = 0.6, 0.95
"""Chosen: about the shares of computing and of writing, of which models in OpenSim's form take most; the rest
is what is played back."""

ChosenMethods = typing.Annotated[list[str] | None, pydantic.AfterValidator(names.check_methods)]


class ScalingRequest(job.OfRecordings, ComparisonOptions):
    """Scale a subject's model by one or several methods and compare them."""

    methods: ChosenMethods = pydantic.Field(
        default=None,
        description=f"Of {', '.join(names.list_method_names())}; all that the recordings allow unless given.",
        examples=[["MB", "MB_am"]],
    )


class KinematicErrorRequest(ScalingRequest):
    """Compare how closely the methods' models follow the markers, on recordings fitted and held out."""

    view: typing.ClassVar[str] = "kinematic_error"


class SegmentLengthsRequest(ScalingRequest):
    """Compare the segment lengths and joint centres of the methods' models."""

    view: typing.ClassVar[str] = "segment_lengths"


class JointAnglesRequest(ScalingRequest):
    """Compare the joint angles that the methods' models give in the same recordings."""

    view: typing.ClassVar[str] = "joint_angles"


class LinearRequest(job.OfRecordings, ScaleOptions):
    """Scale a subject's model in closed form: from marker distances, or from images."""

    method: typing.Literal["MB", "EB"] = pydantic.Field(
        default="MB", description="MB from marker distances, EB from bones.", examples=["MB"]
    )


class OptimisedRequest(job.OfRecordings, ScaleOptions):
    """Scale a subject's model by optimisation over its calibration trials."""

    method: str = pydantic.Field(
        default="MB_am",
        description="What is free, and what it starts from.",
        examples=["MB_am"],
        json_schema_extra={"enum": [name for name in names.list_method_names() if name not in ("MB", "EB")]},
    )


def compare_methods(request: ScalingRequest, inputs: Path, outputs: Path, progress: Progress) -> typing.Any:
    """Write each method's folder, ``comparison.json`` and ``report.html``; the comparison is the result."""
    options = request.part(ComparisonOptions)
    _, document = _scale(request, request.methods, inputs, outputs, progress, options)
    return document.model_dump(mode="json")


def scale_by_one(
    request: LinearRequest | OptimisedRequest, inputs: Path, outputs: Path, progress: Progress
) -> typing.Any:
    """Write the method's folder; its ``scaling.json`` is the result."""
    from scaling_service.capabilities.scaling.saving import make_scaling_documents

    options = ComparisonOptions(**request.part(ScaleOptions).model_dump())
    _, document = _scale(request, (request.method,), inputs, outputs, progress, options, comparison=False)
    return make_scaling_documents(document)[request.method].model_dump(mode="json")


def view_comparison(
    request: KinematicErrorRequest | SegmentLengthsRequest | JointAnglesRequest,
    inputs: Path,
    outputs: Path,
    progress: Progress,
) -> typing.Any:
    """Write the comparison, and its view as JSON and CSV."""
    from scaling_service.capabilities.scaling.comparison_views import write_view

    options = request.part(ComparisonOptions)
    results, document = _scale(request, request.methods, inputs, outputs, progress, options)
    return write_view(outputs, request.view, results, document).model_dump(mode="json")


def _scale(
    request: job.OfRecordings,
    methods: Sequence[str] | None,
    inputs: Path,
    outputs: Path,
    progress: Progress,
    options: ComparisonOptions = ComparisonOptions(),
    *,
    comparison: bool = True,
) -> tuple[Results, documents.ComparisonDocument]:
    """Scale by methods, and write their folders and, where wanted, the comparison and its report."""
    from scaling_service.capabilities.scaling.run import compare
    from scaling_service.capabilities.scaling.saving import save
    from scaling_service.capabilities.scaling.scene import write_results_scene
    from scaling_service.capabilities.shared.tables import make_table_writer

    write_tables = make_table_writer(request.tables, outputs)
    subject, computing = inputs / request.subject / DOCUMENT, report_part(progress, 0.0, _COMPUTING)
    results = compare(subject, methods, request.settings, options, progress=computing)
    writing = report_part(progress, _COMPUTING, _WRITING - _COMPUTING)
    document = save(results, outputs, comparison=comparison, progress=writing)
    write_tables(results.tables, document)
    progress("writing what is played back", _WRITING)
    write_results_scene(results, outputs)
    return results, document


def list_kinds() -> dict[str, job.Kind]:
    """What the service offers of this capability."""
    one, both = documents.ScalingDocument, documents.ComparisonDocument
    errors, lengths = comparison_views.KinematicErrorComparison, comparison_views.SegmentLengthComparison
    angles = comparison_views.JointAngleComparison
    offered: tuple[tuple[str, type[job.JobRequest], job.Work, str, type[pydantic.BaseModel]], ...] = (
        ("linear-scaling", LinearRequest, scale_by_one, "scalings/linear", one),
        ("optimised-scaling", OptimisedRequest, scale_by_one, "scalings/optimised", one),
        ("scaling", ScalingRequest, compare_methods, "comparisons", both),
        ("kinematic-error", KinematicErrorRequest, view_comparison, "comparisons/kinematic-error", errors),
        ("segment-lengths", SegmentLengthsRequest, view_comparison, "comparisons/segment-lengths", lengths),
        ("joint-angles", JointAnglesRequest, view_comparison, "comparisons/joint-angles", angles),
    )
    return {
        name: job.Kind(request=request, work=work, route=route, result=result)
        for name, request, work, route, result in offered
    }
