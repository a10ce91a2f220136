"""Puchaud et al. 2019 done again on virtual persons."""

from __future__ import annotations

import time
from collections.abc import Sequence

from scaling_service.capabilities.cohort.executors import workers
from scaling_service.capabilities.cohort.outcomes import Outcome, run_members
from scaling_service.capabilities.cohort.run import Watcher
from scaling_service.capabilities.cohort.statistics import cohort_statistics
from scaling_service.capabilities.cohort.summary import SubjectSummary
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.core.errors import InputError
from scaling_service.core.threads import cores
from scaling_service.documents.writing import code_version
from scaling_service.studies.claims import answer_claims, person_seeds
from scaling_service.studies.puchaud2019.claims import CLAIMS
from scaling_service.studies.puchaud2019.paper import (
    METHODS,
    Puchaud2019Document,
    errors,
    knee_axes,
    length_differences,
    lengths,
    marker_shifts,
    paper,
)
from scaling_service.studies.puchaud2019.persons import DIFFERENCES, SUBJECTS, WALKERS, Generic, VirtualPerson


def reproduce_puchaud2019(
    settings: Settings = Settings(),
    *,
    subjects: int | None = None,
    generic: Generic = "mean",
    worker_count: int | None = None,
    watcher: Watcher | None = None,
) -> Puchaud2019Document:
    """Scale virtual persons by the five methods of Puchaud et al. 2019, and ask what the paper claims.

    ``settings``: its seed decides who the persons are. ``subjects``: more than the six whose gait is also
    looked at alone; the paper's 26 unless given. ``generic``: the model that scaling starts from. Results do
    not depend on ``worker_count``. InputError: too few subjects, or a person that could not be scaled.
    """
    count = SUBJECTS if subjects is None else subjects
    if count <= WALKERS:
        raise InputError(
            f"{count} subjects are too few", field="--subjects", remedy=f"Take at least {WALKERS + 1}"
        )
    clock = time.perf_counter()
    settings = settings.model_copy(
        update={"calibration": settings.calibration.model_copy(update={"sizes": "measured"})}
    )  # as the paper
    people = [
        VirtualPerson(seed, images=True, generic=generic) for seed in person_seeds(settings.seed, count)
    ]
    processes = min(worker_count or cores(), count)
    if watcher is not None:
        watcher.started(count, processes)
    with workers(processes, None if watcher is None else watcher.stage) as executor:
        outcomes = run_members(
            people, executor, METHODS, settings, finished=None if watcher is None else watcher.finished
        )
    slowest = max(outcome.wall_s for outcome in outcomes)
    return build_document(
        _all_summaries(outcomes), settings, generic=generic, slowest_s=slowest, started=clock
    )


def _all_summaries(outcomes: Sequence[Outcome]) -> list[SubjectSummary]:
    """A study with a person missing is another study."""
    for outcome in outcomes:
        if outcome.status != "done":
            raise InputError(
                f"{outcome.name} could not be scaled: {outcome.reason}",
                field="--seed",
                remedy="Take another seed, and report this one",
            )
    return [outcome.summary for outcome in outcomes if outcome.summary is not None]


def build_document(
    summaries: Sequence[SubjectSummary],
    settings: Settings,
    *,
    generic: Generic = "mean",
    slowest_s: float,
    started: float,
) -> Puchaud2019Document:
    """Compare the methods over all persons and over the walkers alone, and ask what the paper claims.

    ``slowest_s``: the most time that one person's models took. ``started``: by ``time.perf_counter``.
    """
    everybody, walkers = (
        cohort_statistics(some, METHODS, seed=settings.seed) for some in (summaries, summaries[:WALKERS])
    )
    document = Puchaud2019Document(
        source=paper().source,
        code_version=code_version(),
        settings={**settings.resolved(), "generic": generic},
        seed=settings.seed,
        subjects=[summary.subject for summary in summaries],
        walkers=[summary.subject for summary in summaries[:WALKERS]],
        segment_lengths_mm=lengths(everybody),
        knee_axis_deg=knee_axes(everybody),
        kinematic_error_mm=errors(everybody),
        literature_error_mm=dict(paper().literature_errors_mm),
        length_difference_mm=length_differences(everybody),
        marker_shift_mm=marker_shifts(everybody),
        notes=list(DIFFERENCES),
        statistics=everybody,
        walkers_statistics=walkers,
        slowest_subject_s=round(slowest_s, 3),
        wall_s=round(time.perf_counter() - started, 3),
    )
    return answer_claims(document, CLAIMS)
