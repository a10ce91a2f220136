"""The comparison on a virtual person, beside what is true of it."""

from __future__ import annotations

import math
from itertools import count

from scaling_service.capabilities.scaling.comparison.geometry import (
    compute_angle_errors,
    compute_centre_errors,
    compute_length_errors,
)
from scaling_service.capabilities.scaling.result import Results, Scaling
from scaling_service.capabilities.scaling.run import run
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.loading import Loaded
from scaling_service.core.progress import Progress, report_part, show_nothing
from scaling_service.documents.results import TruthDocument
from scaling_service.model.anatomy.lengths import measure_segment_lengths
from scaling_service.virtual.example import make_demo_session
from scaling_service.virtual.subject import VirtualSubject

_BONES = 0.3  # chosen: about the share of making bones and reading their landmarks in the whole
_STEPS = 10  # of five bones: making them, finding their landmarks


def run_demo(
    settings: Settings = Settings(), *, progress: Progress | None = None
) -> tuple[Results, TruthDocument]:
    """Scale a virtual person, bones imaged, by every method, and measure each against the truth.

    ``settings``: its seed decides the person.
    Distances from the truth are taken on the gait trials, which no method was fitted to.
    """
    report, steps = progress or show_nothing, count()
    session, person = make_demo_session(
        settings.seed,
        images=True,
        progress=lambda what: report(what, _BONES * min(1.0, next(steps) / _STEPS)),
    )
    results = run(Loaded(session=session), None, settings, progress=report_part(report, _BONES, 1 - _BONES))
    lengths = {name: round(1e3 * value, 4) for name, value in measure_segment_lengths(person.model).items()}
    errors = {method: _list_errors(scaling, results, person) for method, scaling in results.scalings.items()}
    return results, TruthDocument(segment_lengths_mm=lengths, errors=errors)


def _list_errors(scaling: Scaling, results: Results, person: VirtualSubject) -> dict[str, float]:
    model = scaling.calibration.model
    held_out = [scaling.motions[trial.name] for trial in results.session.evaluation]
    lengths = compute_length_errors(model, person.model).values()
    found = {"lengths_mm": 1e3 * sum(map(abs, lengths)) / len(lengths)}
    for name, gap in compute_centre_errors(model, held_out, person.model, person.motions).items():
        found[f"{name}_centre_mm"] = 1e3 * gap
    for name, gap in compute_angle_errors(held_out, person.model, person.motions).items():
        found[f"{name}_deg"] = math.degrees(gap)
    return {name: round(value, 4) for name, value in found.items()}
