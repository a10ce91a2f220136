"""Reports of results in memory, read back, and results with trials taken away."""

from __future__ import annotations

from dataclasses import replace

from scaling_service.capabilities.scaling.result import Results
from scaling_service.capabilities.scaling.saving import (
    make_comparison_document,
    make_method_document,
    make_report,
)
from scaling_service.documents.results import ComparisonDocument, TruthDocument
from tests.report.reading import Node, read

MOST_BYTES = 5e6
"""Of a report: chosen, what a mail server takes with ease; the page's views have 2.3 MB."""


def document_of(results: Results, truth: TruthDocument | None = None) -> ComparisonDocument:
    methods = {
        name: make_method_document(scaling, results, results.gait[name])
        for name, scaling in results.scalings.items()
    }
    return make_comparison_document(results, methods, truth)


def html_of(results: Results, document: ComparisonDocument) -> str:
    return make_report(results, document).html()


def page_of(results: Results, truth: TruthDocument | None = None) -> Node:
    return read(html_of(results, document_of(results, truth)))


def without(results: Results, *, calibration: bool = False, evaluation: bool = False) -> Results:
    """The results as if those trials had not been recorded."""
    session = results.session
    session = replace(
        session,
        calibration=() if calibration else session.calibration,
        evaluation=() if evaluation else session.evaluation,
    )
    kept = {trial.name for trial in session.dynamic}
    scalings = {
        name: replace(
            s,
            motions={t: m for t, m in s.motions.items() if t in kept},
            errors={t: e for t, e in s.errors.items() if t in kept},
        )
        for name, s in results.scalings.items()
    }
    return replace(results, loaded=replace(results.loaded, session=session), scalings=scalings)
