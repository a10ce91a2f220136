"""Scale a subject's model and compare methods: what ``scale`` and ``compare`` do on the command line."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from scaling_service.capabilities.scaling.request import OfRecordings, ScalingRequest
from scaling_service.capabilities.scaling.run import Results, compare
from scaling_service.capabilities.scaling.saving import save
from scaling_service.capabilities.scaling.scene import scene_of_results
from scaling_service.core.progress import Progress
from scaling_service.documents.names import DOCUMENT
from scaling_service.documents.results import ComparisonDocument

_COMPUTING, _WRITING = 0.6, 0.35
"""Chosen: about the shares of computing and of writing, of which models in OpenSim's form take most; the rest
is what is played back."""


def work(request: ScalingRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write each method's folder, ``comparison.json`` and ``report.html``; the comparison is the result.

    Raises
    ------
    InputError
        Whatever in the subject, the model or the recordings cannot be used.
    """
    return compared(request, inputs, outputs, progress)[1].model_dump(mode="json")


def compared(
    request: ScalingRequest, inputs: Path, outputs: Path, progress: Progress
) -> tuple[Results, ComparisonDocument]:
    """Compare methods, and write all that the command line does."""
    return scaled(request, request.methods, inputs, outputs, progress, comparison=True)


def scaled(
    request: OfRecordings,
    methods: Sequence[str] | None,
    inputs: Path,
    outputs: Path,
    progress: Progress,
    *,
    comparison: bool,
) -> tuple[Results, ComparisonDocument]:
    """Scale by methods, and write their folders and, where wanted, the comparison and its report."""
    results = compare(
        inputs / request.subject / DOCUMENT,
        methods,
        request.settings,
        progress=lambda what, share: progress(what, _COMPUTING * share),
    )
    document = save(
        results,
        outputs,
        comparison=comparison,
        progress=lambda what, share: progress(what, _COMPUTING + _WRITING * share),
    )
    progress("writing what is played back", _COMPUTING + _WRITING)
    scene_of_results(results, outputs)
    return results, document
