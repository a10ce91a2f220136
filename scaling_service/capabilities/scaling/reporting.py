"""The report of one person: what it is made of gathered from results, and written as one HTML file."""

from __future__ import annotations

from scaling_service.capabilities.playback.overlay import overlay
from scaling_service.capabilities.scaling.comparison.verdict_evidence import Verdict
from scaling_service.capabilities.scaling.curves import angle_curves, error_curves, gait_curves
from scaling_service.capabilities.scaling.judging import evidence_of
from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.capabilities.scaling.report.data import Gait, SubjectData
from scaling_service.capabilities.scaling.report.page import subject_page
from scaling_service.capabilities.scaling.run import Results
from scaling_service.documents.results import ComparisonDocument
from scaling_service.model.trial import Trial

REPORT = "report.html"


def report_html(results: Results, document: ComparisonDocument, verdict: Verdict) -> str:
    """The report as one HTML document that needs nothing else.

    Parameters
    ----------
    results : Results
    document : ComparisonDocument
        What is written as ``comparison.json``; the report's tables take their numbers from it.
    verdict : Verdict
    """
    return subject_page(subject_data(results, document, verdict)).html()


def subject_data(results: Results, document: ComparisonDocument, verdict: Verdict) -> SubjectData:
    """What the report shows; see :func:`report_html`."""
    evidence = evidence_of(results)
    trial = shown_trial(results)
    return SubjectData(
        document,
        verdict,
        {name: METHODS[name].title for name in results.scalings},
        imaged_lengths=evidence.imaged_lengths,
        reference=None if evidence.reference is None else evidence.reference.method,
        scene=None if trial is None else overlay(results, trial, verdict.method),
        errors=error_curves(results),
        angles=() if trial is None else angle_curves(results, trial),
        gait=Gait(reason="no movement was recorded")
        if trial is None
        else gait_curves(results, verdict.method),
    )


def shown_trial(results: Results) -> Trial | None:
    """The trial that the overlay shows: the first that was held out, else the first of all."""
    session = results.session
    fitted = {trial.name for trial in session.calibration}
    held_out = [trial for trial in session.dynamic if trial.name not in fitted]
    return next(iter((*held_out, *session.dynamic)), None)
